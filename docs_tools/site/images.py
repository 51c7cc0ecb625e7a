"""The pictures in docs/images, made from real output: `python -m docs_tools.site.images [LOG]`.

They are committed, as a README has to show them without being built; made again where what they show has changed. Needs
graphviz (`dot`) and a free machine of one's own for half a minute. LOG is the CARMEN log whose track is drawn.
"""

import csv
import io
import os
import pty
import re
import select
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import escape

from rich.console import Console
from rich.text import Text

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "images"
WIDTH = 106
"""Of a terminal, characters."""


class Terminal:
    """Commands in a terminal with colours, on a network of their own."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = str(free.getsockname()[1])
        self.endpoint = f"tcp/127.0.0.1:{self._port}"
        plain = {name: value for name, value in os.environ.items() if not name.startswith("ROBO_")}
        plain.pop("NO_COLOR", None)
        self.environment: Mapping[str, str] = plain | {
            "ROBO_CONNECT": self.endpoint,
            "TERM": "xterm-256color",
            "COLORTERM": "truecolor",
            "COLUMNS": str(WIDTH),
            "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        }

    def run(self, line: str, *more: str, until: str = "") -> str:
        """What a line of the shell prints, with its colours.

        Args:
            line: what is typed, and shown.
            more: words that are not shown.
            until: end it with Ctrl-C once it has printed a line with this.
        """
        ours, theirs = pty.openpty()
        process = subprocess.Popen(
            [*line.split(), *more], stdin=theirs, stdout=theirs, stderr=theirs, env=self.environment
        )
        os.close(theirs)
        printed = b""
        while not (until and re.search(f"{until}.*\n", printed.decode(errors="replace"))):
            if not select.select([ours], [], [], 60)[0]:
                raise TimeoutError(f"{line} prints nothing more")
            try:
                printed += os.read(ours, 65536)
            except OSError:  # which is how a terminal tells that nobody writes any more
                break
        process.send_signal(2) if until else None
        process.wait()
        os.close(ours)
        return printed.decode(errors="replace").replace("\r", "").replace(self._port, "7447")


def picture(title: str, *parts: tuple[str, str]) -> str:
    """A terminal as SVG, with commands and what they printed. No font is fetched for it."""
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True, legacy_windows=False)
    for number, (command, printed) in enumerate(parts):
        console.print(Text("\n$ " if number else "$ ", "green"), Text(command, "bold"), sep="", no_wrap=True)
        console.print(Text.from_ansi(printed.rstrip("\n")), no_wrap=True, overflow="crop")
    console.print()  # else the lowest row of the last line is cut off
    return re.sub(r"@font-face \{.*?\}\n?", "", console.export_svg(title=title, unique_id="robo"), flags=re.DOTALL)


def graph(terminal: Terminal) -> str:
    """The nodes and topics of the reference robot, drawn by graphviz; what every node has is left out."""
    drawn = terminal.run("robo check robot.yaml robot_name:=r1 --graph dot")
    inner = drawn[drawn.index("digraph") : drawn.rindex("}") + 1].splitlines()
    kept = [
        line
        for line in inner
        if not re.search(r"r1/(log|parameter_events|diagnostics|reset_?\w*|emergency_stop)\b", line)
    ]
    look = '  bgcolor="white"; node [fontname="sans-serif", fontsize=11]; edge [color="#666666"];'
    text = "\n".join([kept[0], look, *kept[1:]]).replace("\\nnobody subscribes it", "").replace("color=red", "")
    text = text.replace("shape=box", 'shape=box, style="filled,rounded", fillcolor="#dbe7ff"')
    return subprocess.run(["dot", "-Tsvg"], input=text, capture_output=True, text=True, check=True).stdout


def track(terminal: Terminal, log: str) -> str:
    """The way of a robot, as the position tracker tells it while a log is played as fast as nothing is lost."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "track.csv"
        with file.open("w") as out:
            words = [
                "robo",
                "topic",
                "echo",
                "r1/current_position",
                "--csv",
                "--field",
                "x",
                "--field",
                "y",
                "--timeout",
                "20",
            ]
            listener = subprocess.Popen(words, stdout=out, env=terminal.environment)
            terminal.run("robo up replay.yaml --robot-name r1", f"log:={log}", "rate:=0", "--listen", terminal.endpoint)
            listener.send_signal(2)
            listener.wait()
        points = [(float(row[-2]), float(row[-1])) for row in list(csv.reader(file.open()))[1:]]
    return drawing(points)


def drawing(points: Sequence[tuple[float, float]]) -> str:
    """A way as SVG; x to the right, y up, with a scale.

    Args:
        points: places, m.
    """
    kept = points[:: max(1, len(points) // 2000)]
    left, low = min(x for x, _ in kept), min(y for _, y in kept)
    right, high = max(x for x, _ in kept), max(y for _, y in kept)
    scale = 640 / max(right - left, high - low, 1e-9)
    places = [((x - left) * scale + 30, (high - y) * scale + 30) for x, y in kept]
    width, height = (right - left) * scale + 60, (high - low) * scale + 80
    metres = next(m for m in (10, 5, 1, 0.5, 0.1) if m * scale <= width / 3)
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    (x0, y0), (x1, y1) = places[0], places[-1]
    caption = escape(f"{metres:g} m")
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif">
<rect width="100%" height="100%" fill="white"/>
<polyline points="{path}" fill="none" stroke="#3b6fd4" stroke-width="1.5" stroke-linejoin="round"/>
<circle cx="{x0:.1f}" cy="{y0:.1f}" r="5" fill="#2a9d4a"/><circle cx="{x1:.1f}" cy="{y1:.1f}" r="5" fill="#c8362b"/>
<path d="M30 {height - 22:.0f} h{metres * scale:.1f}" stroke="black" stroke-width="2"/>
<text x="{metres * scale + 38:.0f}" y="{height - 17:.0f}" font-size="14">{caption}; green: start, red: end</text>
</svg>
"""


def main(words: Sequence[str]) -> None:
    """Make all of them."""
    FOLDER.mkdir(exist_ok=True)
    terminal = Terminal()
    (FOLDER / "graph.svg").write_text(graph(terminal))
    (FOLDER / "track.svg").write_text(track(terminal, words[0] if words else str(ROOT / "logs" / "room.log.gz")))

    command = "robo up --robot-name r1"
    shown = terminal.run(command, "--listen", terminal.endpoint, until=r"(position \(.*\n[^$]*){3}")
    terminal.run(f"{command} -d --wait", "--listen", terminal.endpoint)
    terminal.run("robo topic hz r1/odom --count 3")  # until the supervisor knows rates and processor time
    seen = [(line, terminal.run(line)) for line in ("robo ps", "robo topic list", "robo top --once")]
    terminal.run("robo down")
    (FOLDER / "up.svg").write_text(picture("a robot in the terminal", (command, shown), *seen[:1]))
    (FOLDER / "tools.svg").write_text(picture("another terminal", *seen[1:]))


if __name__ == "__main__":
    main(sys.argv[1:])
