"""The pictures in docs/images, made from real output: `python -m docs_tools.site.images`.

They are committed, as a README has to show them without being built; made again where what they show has changed. Needs
a free machine of one's own for half a minute.
"""

import io
import os
import pty
import re
import select
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

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


def main() -> None:
    """Make all of them."""
    FOLDER.mkdir(exist_ok=True)
    terminal = Terminal()
    command = "robo up --robot-name r1"
    shown = terminal.run(command, "--listen", terminal.endpoint, until=r"(position \(.*\n[^$]*){3}")
    terminal.run(f"{command} -d --wait", "--listen", terminal.endpoint)
    terminal.run("robo topic hz r1/odom --count 3")  # until the supervisor knows rates and processor time
    seen = [(line, terminal.run(line)) for line in ("robo ps", "robo topic list", "robo top --once")]
    terminal.run("robo graph --robot-name r1 --hide-system --svg", str(FOLDER / "graph.svg"))
    terminal.run("robo down")
    (FOLDER / "up.svg").write_text(picture("a robot in the terminal", (command, shown), *seen[:1]))
    (FOLDER / "tools.svg").write_text(picture("another terminal", *seen[1:]))


if __name__ == "__main__":
    main()
