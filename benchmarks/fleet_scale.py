"""`python -m benchmarks.fleet_scale`: up to a thousand robots at one site's router; writes FLEET_SCALE.md.

One real robot is started and looked at; robots are played by sessions that declare the same tokens, subscribers and
queryables, many in a process. They dial the site as clients do, which costs the site what a robot costs it at least,
and as routers do, as every robot has one: routers tell each other all that they know. They come some at a time, the
next ones when those before are seen; after the loss of the site's router all of them come at once.

Told is how long it takes until a tool at the site sees all of them, the processor time until then, what the site's
router holds and uses at rest, what a played robot holds, what crosses each link, how long it takes to ask all for `ps`
and to get all tokens, and how soon one more, and all after the loss of the site's router, are seen. What takes longer
than `PATIENCE` is told as such, and no more robots are tried in that way.
"""

import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, NamedTuple

import msgspec
import psutil
import zenoh

from benchmarks.__main__ import machine
from benchmarks.fleet_scale_worker import NAME, Part, Seen
from robo.tools import runs
from robo.tools.replies import samples
from robo.wire import admin
from robo.wire.keys import ALL_TOKENS, control_key, parse_supervisor_token, parse_token, supervisors_key
from robo.wire.network import Mode, Network
from robo.wire.session import close_session, open_session

RESULTS = Path(__file__).parent / "FLEET_SCALE.md"
PORT = 17447
SITE = f"tcp/127.0.0.1:{PORT}"
PATIENCE = 60.0
"""How long anything may take, s."""
CALM = 5.0
"""How long the site is left alone before it is looked at, s."""
START = 0.15
"""What the start of a process that plays robots takes of a processor, s."""
REST = 10.0
"""How long it is looked at, s."""
ROOM = 3e9
"""How much memory has to stay free, bytes: no more robots are played where there is less."""


class Way(NamedTuple):
    """How robots dial the site."""

    name: str
    mode: Mode
    counts: tuple[int, ...]
    """How many robots are tried."""
    per_process: int
    """How many one process plays: routers that share one would also share its few threads."""
    only: str = ""
    """The only node of a robot; empty for all that the real one has."""


WAYS = (
    Way("clients", "client", (50, 100, 200, 500, 1000), 125),
    Way("clients, robots of one node", "client", (50, 200, 500, 1000), 125, "position_tracker"),
    Way("routers", "router", (10, 20, 30, 40, 50, 70), 10),
    Way("routers, robots of one node", "router", (50, 100, 200), 10, "position_tracker"),
)


class Figures(msgspec.Struct):
    """What was measured with so many robots; None where it took too long."""

    robots: int
    seen: float | None = None
    """Until all were seen, some after the other, s."""
    site_work: float = 0.0
    """Processor time of the site's router until then, s."""
    robot_work: float = 0.0
    """That of a played robot, without the start of its process, s."""
    one_more: float | None = None
    """Until one that came later was seen, s."""
    healed: float | None = None
    """Until all were seen again after the site's router had been killed and started again, s."""
    ps: float | None = None
    """Until all had answered `ps`, s."""
    tokens: float | None = None
    """Until a new tool had all tokens of all robots, s."""
    site_memory: float = 0.0
    """Resident, of the site's router, bytes."""
    site_cpu: float = 0.0
    """At rest, of one core."""
    robot_memory: float = 0.0
    """Resident, of a process that plays robots, for each of them, bytes."""
    robot_cpu: float = 0.0
    """At rest, of one core."""
    joined_up: float = 0.0
    """From a robot to the site until all were there, bytes."""
    joined_down: float = 0.0
    rest_up: float = 0.0
    """From a robot to the site at rest, bytes/s."""
    rest_down: float = 0.0
    load: float = 0.0
    """Of the machine when it began."""


class Watch:
    """A tool at the site: which robots it sees, as they come and go."""

    def __init__(self, endpoint: str) -> None:
        self.session = open_session(Network(mode="client", connect=(endpoint,), timeout=20))
        self._there: set[str] = set()
        self._changed = threading.Condition()
        self._subscriber = self.session.liveliness().declare_subscriber(
            supervisors_key("**"), self._notice, history=True
        )

    def _notice(self, sample: zenoh.Sample) -> None:
        token = parse_supervisor_token(str(sample.key_expr))
        if token is not None:
            with self._changed:
                (self._there.add if sample.kind == zenoh.SampleKind.PUT else self._there.discard)(token.robot)
                self._changed.notify()

    def wait_for(self, robots: int, begin: float) -> float | None:
        """How long after the beginning so many are there, s; None where it takes too long."""
        with self._changed:
            if not self._changed.wait_for(lambda: len(self._there) == robots, PATIENCE):
                return None
        return time.monotonic() - begin

    def close(self) -> None:
        close_session(self.session)


class Site:
    """A router of robo's own, and the unix socket at which the tools of its machine meet it."""

    def __init__(self, folder: str) -> None:
        self.endpoint = f"unixsock-stream/{folder}/site.sock"
        self.start()

    def start(self) -> None:
        words = ["router", "--name", "site", "--listen", SITE, "--listen", self.endpoint]
        self._running = subprocess.Popen(
            [sys.executable, "-m", "robo", *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.process = psutil.Process(self._running.pid)

    def kill(self) -> None:
        self._running.kill()
        self._running.wait()


def look_at_one(folder: str) -> Seen:
    """Start the reference robot, and take down what it declares."""
    listen = f"tcp/127.0.0.1:{PORT - 1}"
    robo = [sys.executable, "-m", "robo"]
    subprocess.run(
        [*robo, "up", "-d", "--wait", "--robot-name", NAME, "--listen", listen],
        check=True,
        capture_output=True,
        cwd=folder,
    )
    session = open_session(Network(mode="client", connect=(listen,), timeout=20))
    try:
        keys = [str(one.key_expr) for one in samples(session.liveliness().get(ALL_TOKENS, timeout=5))]
        tokens = [key for key in keys if parse_token(key) is not None]
        (answer,) = samples(session.get(control_key(NAME, "ps"), timeout=5))
        declared = {word: _declared(session, word) for word in ("subscriber", "queryable")}
        return Seen(tokens, declared["subscriber"], declared["queryable"], answer.payload.to_bytes())
    finally:
        close_session(session)
        subprocess.run([*robo, "down", "--connect", listen], check=True, capture_output=True)


def _declared(session: zenoh.Session, word: str) -> list[str]:
    """The keys of subscribers or queryables that the robot's router knows, this tool's own and Zenoh's left out."""
    keys = set()
    for router in admin.routers(session, 5):
        for one in samples(session.get(f"@/{router.zid}/router/{word}/**", timeout=5)):
            key = "/".join(str(one.key_expr).split("/")[4:])
            if NAME in key:
                keys.add(key)
    return sorted(keys)


def of_node(seen: Seen, node: str) -> Seen:
    """What one node of the robot declares, or all of it."""

    def kept(keys: Sequence[str]) -> list[str]:
        return [key for key in keys if node in key]

    return Seen(kept(seen.tokens), kept(seen.subscribers), kept(seen.queryables), seen.ps)


def declared(seen: Seen) -> int:
    """How many things a robot declares."""
    return len(seen.tokens) + len(seen.subscribers) + len(seen.queryables)


class Play:
    """Robots that are played."""

    def __init__(self, ends: ExitStack, way: Way, seen: Seen) -> None:
        self._ends, self._way, self._seen = ends, way, seen
        self._processes: list[subprocess.Popen[bytes]] = []

    def begin(self, first: int, robots: int) -> None:
        """Some more robots, in a process of their own."""
        self._begin(Part(SITE, self._way.mode, first, robots, self._seen))

    def _begin(self, part: Part) -> None:
        process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.fleet_scale_worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._ends.callback(process.wait)
        self._ends.callback(process.kill)
        self._tell(process.stdin, msgspec.json.encode(part))
        self._processes.append(process)

    def add(self, name: str) -> None:
        """One more robot."""
        self._tell(self._processes[-1].stdin, name.encode())

    def _tell(self, pipe: IO[bytes] | None, line: bytes) -> None:
        assert pipe is not None
        pipe.write(line + b"\n")
        pipe.flush()

    @property
    def processes(self) -> list[psutil.Process]:
        return [psutil.Process(process.pid) for process in self._processes]


def used(processes: Sequence[psutil.Process]) -> float:
    """Processor time so far, s."""
    return float(sum(sum(one.cpu_times()[:2]) for one in processes))


def carried() -> tuple[float, float]:
    """Bytes that the site has received and sent so far over all links of robots."""
    shown = subprocess.run(
        ["ss", "-tinH", "state", "established", f"( sport = :{PORT} )"], capture_output=True, text=True, check=True
    ).stdout
    received = sum(map(int, re.findall(r"bytes_received:(\d+)", shown)))
    return received, sum(map(int, re.findall(r"bytes_sent:(\d+)", shown)))


def measure(way: Way, robots: int, seen: Seen) -> Figures:
    """All that is told of so many robots."""
    found = Figures(robots, load=os.getloadavg()[0])
    with tempfile.TemporaryDirectory() as folder, ExitStack() as ends:
        site = Site(folder)
        ends.callback(site.kill)
        watch = Watch(site.endpoint)
        ends.callback(watch.close)
        begin = time.monotonic()
        play = Play(ends, way, seen)
        for first in range(0, robots, way.per_process):  # the next ones come when these are seen
            some = min(way.per_process, robots - first)
            play.begin(first, some)
            found.seen = watch.wait_for(first + some, begin)
            if found.seen is None:
                break
        found.site_work = used([site.process])
        found.robot_work = max(0.0, used(play.processes) - START * len(play.processes)) / robots
        found.site_memory = site.process.memory_info().rss
        if found.seen is None:
            return found
        time.sleep(CALM)
        _at_rest(found, site, play)
        _ask(found, watch)
        begin = time.monotonic()
        play.add("late")
        found.one_more = watch.wait_for(robots + 1, begin)
        site.kill()
        begin = time.monotonic()
        site.start()
        if watch.wait_for(0, begin) is not None:
            found.healed = watch.wait_for(robots + 1, begin)
        if found.healed is not None:
            found.tokens = all_tokens(site.endpoint, (robots + 1) * len(seen.tokens))
    return found


def _at_rest(found: Figures, site: Site, play: Play) -> None:
    robots, processes = found.robots, play.processes
    up, down = carried()
    found.joined_up, found.joined_down = up / robots, down / robots
    before, begin = [used([site.process]), used(processes)], time.monotonic()
    time.sleep(REST)
    span = time.monotonic() - begin
    found.site_cpu = (used([site.process]) - before[0]) / span
    found.robot_cpu = (used(processes) - before[1]) / span / robots
    later_up, later_down = carried()
    found.rest_up, found.rest_down = (later_up - up) / span / robots, (later_down - down) / span / robots
    found.site_memory = site.process.memory_info().rss
    found.robot_memory = sum(one.memory_info().rss for one in processes) / robots


def _ask(found: Figures, watch: Watch) -> None:
    begin = time.monotonic()
    answered = {status.run for status in runs.processes(watch.session, timeout=PATIENCE)}
    found.ps = time.monotonic() - begin if answered else None


def all_tokens(endpoint: str, expected: int) -> float | None:
    """Until a new tool has all tokens of all robots, as `robo topic list` asks for them, s; None where it has not."""
    fresh = open_session(Network(mode="client", connect=(endpoint,), timeout=20))
    begin = time.monotonic()
    told = len(list(samples(fresh.liveliness().get(ALL_TOKENS, timeout=PATIENCE))))
    took = time.monotonic() - begin
    close_session(fresh)
    return took if told >= expected else None


def main() -> None:
    lines = ["# Many robots at one site's router", "", *machine()]
    with tempfile.TemporaryDirectory() as folder:
        seen = look_at_one(folder)
    lines += [
        f"A robot declares {len(seen.tokens)} tokens ({sum(map(len, seen.tokens))} bytes of keys), "
        f"{len(seen.subscribers)} subscribers and {len(seen.queryables)} queryables; its `ps` is {len(seen.ps)} bytes.",
        "",
    ]
    for way in WAYS:
        played = of_node(seen, way.only)
        lines += [f"## {way.name}", "", f"D = {declared(played)} declarations a robot.", "", *_HEAD]
        measured: list[Figures] = []
        for robots in way.counts:
            if psutil.virtual_memory().available < ROOM:
                lines.append(f"\nFewer than {robots} robots fit into this machine.")
                break
            found = measure(way, robots, played)
            print(way.name, found, flush=True)
            lines.append(_row(found))
            RESULTS.write_text("\n".join([*lines, ""]))
            if found.seen is None:
                break
            measured.append(found)
        lines += ["", *fits(measured, played), ""]
        RESULTS.write_text("\n".join(lines))


_COLUMNS = (
    "robots", "all seen, s", "site's work, s", "a robot's work, s", "one more, s", "after a loss, s", "`ps`, s",
    "tokens, s", "site, MB", "site at rest, %", "robot, MB", "joining up, kB", "joining down, kB", "at rest up, B/s",
    "at rest down, B/s", "load",
)  # fmt: skip
_HEAD = ("| " + " | ".join(_COLUMNS) + " |", "|" + "---|" * len(_COLUMNS))


def _row(found: Figures) -> str:
    cells = [
        _time(found.seen), f"{found.site_work:.2f}", f"{found.robot_work:.3f}",
        _time(found.one_more), _time(found.healed), _time(found.ps), _time(found.tokens),
        f"{found.site_memory / 1e6:.0f}", f"{found.site_cpu * 100:.1f}", f"{found.robot_memory / 1e6:.1f}",
        f"{found.joined_up / 1e3:.1f}", f"{found.joined_down / 1e3:.1f}", f"{found.rest_up:.0f}",
        f"{found.rest_down:.0f}",
    ]  # fmt: skip
    if found.seen is None:
        cells[8:] = ["-"] * len(cells[8:])
    cells = [str(found.robots), *cells, f"{found.load:.1f}"]
    return "| " + " | ".join(cells) + " |"


def _time(span: float | None) -> str:
    return "-" if span is None else f"{span:.2f}"


def fits(measured: Sequence[Figures], seen: Seen) -> list[str]:
    """Straight lines through what was measured, by least squares."""
    if len(measured) < 2:
        return []
    robots = [float(one.robots) for one in measured]
    base, each = line(robots, [one.site_memory for one in measured])
    own, others = line(robots, [one.robot_memory for one in measured])
    _, down = line(robots, [one.joined_down for one in measured])
    _, work = line([count**2 * declared(seen) for count in robots], [one.site_work for one in measured])
    return [
        f"- site's router: {base / 1e6:.0f} MB and {each / 1e3:.0f} kB a robot",
        f"- a played robot: {own / 1e6:.1f} MB and {others / 1e3:.1f} kB for each robot at the site",
        f"- joining, down: {down / 1e3:.2f} kB for each robot at the site",
        f"- site's work until all are seen: {work * 1e6:.1f} µs for each declaration and robot that is told of it",
    ]


def line(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Where a straight line through points begins, and how steep it is."""
    steep, begin = statistics.linear_regression(x, y)
    return begin, steep


if __name__ == "__main__":
    main()
