"""`python -m benchmarks.abuse`: a stranger throws 100,000 random things at a running robot.

Tokens, queries, messages and requests about parameters, 1,000 a second, from a plain client: random bytes,
MessagePack of the wrong shape, megabytes, deep nesting, odd encodings and attachments. It fails if a log
holds a traceback, a process has ended, memory is not back within 5 MB of what plain Zenoh keeps of the same things,
or a control loop paused for more than 50 ms (on a machine that is otherwise quiet).
"""

import argparse
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import psutil
import zenoh

from benchmarks.stranger import Stranger
from robo.wire.codec import unpack_attachment
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

ROBOT = "r1"
LOOPS = ("cmd_vel", "odom")
"""Topics by which the control loops are timed."""

LONGEST_GAP = 0.05
"""s."""
MOST_GROWTH = 5e6
"""Bytes."""
SETTLING = 10.0
"""How long memory and counters may take to settle, s."""


class LoopWatch:
    """How long a robot's control loops paused, by the times at which their messages were published."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self._last: dict[str, tuple[int, int]] = {}
        self.longest = dict.fromkeys(LOOPS, 0.0)
        """s, by topic."""
        self._subscribers = [session.declare_subscriber(f"{robot}/{topic}", self._notice) for topic in LOOPS]

    def _notice(self, sample: zenoh.Sample) -> None:
        topic = str(sample.key_expr).rpartition("/")[2]
        stamp = unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
        if stamp is None or abs(stamp.source_time - time.time_ns()) > 60e9:
            return  # not the robot's own
        number, at = self._last.get(topic, (0, 0))
        if stamp.sequence_number == number + 1 and number:
            self.longest[topic] = max(self.longest[topic], (stamp.source_time - at) / 1e9)
        self._last[topic] = (stamp.sequence_number, stamp.source_time)

    def close(self) -> None:
        """Look no more."""
        for subscriber in self._subscribers:
            subscriber.undeclare()


def log_lines(folder: Path) -> list[tuple[str, str]]:
    """What a robot's processes have logged: node and text."""
    records = [
        json.loads(line) for file in sorted(folder.rglob("*.jsonl")) for line in file.read_text().splitlines() if line
    ]
    return [(record["node"], record["message"]) for record in records]


def kinds(lines: list[tuple[str, str]]) -> Counter[str]:
    """How often each kind of line stands there; figures and quoted words make no difference."""
    shape = re.compile(r"'[^']*'|\"[^\"]*\"|[-+]?[\d,.]+(e[-+]?\d+)?|nan|inf")
    return Counter(f"{node}: {shape.sub('#', text)[:100]}" for node, text in lines)


def throw(stranger: Stranger, count: int, rate: float) -> float:
    """Throw so many things, so many a second. Returns the rate that was reached."""
    begin = time.monotonic()
    for i in range(count):
        ahead = begin + i / rate - time.monotonic()
        if ahead > 0:
            time.sleep(ahead)
        stranger.throw()
    stranger.leave()
    return count / (time.monotonic() - begin)


def processes(supervisor: psutil.Process) -> dict[int, str]:
    """The robot's processes that run: pid and last word of the command."""
    found: dict[int, str] = {}
    with suppress(psutil.Error):
        for process in [supervisor, *supervisor.children(recursive=True)]:
            with suppress(psutil.Error):
                found[process.pid] = process.cmdline()[-1][:60]
    return found


def memory(pids: dict[int, str]) -> dict[str, int]:
    """Resident memory by process, bytes."""
    return {f"{name} ({pid})": psutil.Process(pid).memory_info().rss for pid, name in pids.items()}


_PLAIN = """\
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", sys.argv[1])
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/delay", "0")
config.insert_json5(sys.argv[2], sys.argv[3])
session = zenoh.open(config)
subscriber = session.liveliness().declare_subscriber("@robo/**", lambda _: None) if "client" in sys.argv[1] else None
print("open", flush=True)
sys.stdin.read()
"""
"""A router, or a client that watches tokens, of plain Zenoh."""


def plain_growth(count: int, rate: float, seed: int) -> dict[str, int]:
    """By how much a router and a client of plain Zenoh grow where the same things are thrown, bytes.

    Zenoh 1.10 keeps some of the memory of each key of a token or a query that it has ever seen.
    """
    where = json.dumps([free_endpoint()])
    with ExitStack() as ending:
        programs: dict[str, psutil.Process] = {}
        for name, mode, path in (("router", "router", "listen/endpoints"), ("client", "client", "connect/endpoints")):
            words = [sys.executable, "-c", _PLAIN, json.dumps(mode), path, where]
            program = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            ending.callback(program.wait)
            ending.callback(program.terminate)
            assert program.stdout is not None
            program.stdout.readline()
            programs[name] = psutil.Process(program.pid)
        session = open_session(Network(mode="client", connect=tuple(json.loads(where))))
        before = {name: program.memory_info().rss for name, program in programs.items()}
        throw(Stranger(session, ROBOT, seed), count, rate)
        close_session(session)
        time.sleep(SETTLING)
        return {name: program.memory_info().rss - before[name] for name, program in programs.items()}


def free_endpoint() -> str:
    """An endpoint on loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def running(folder: str, endpoint: str) -> Iterator[psutil.Process]:
    """The reference robot with its logs in a folder; its supervisor."""
    command = [sys.executable, "-m", "robo", "up", "robot.yaml", "--robot-name", ROBOT, "--listen", endpoint]
    with Path(folder, "console.txt").open("w") as console:
        run = subprocess.Popen(command, stdout=console, stderr=console, env={**os.environ, "ROBO_LOG_DIR": folder})
    try:
        end = time.monotonic() + 30
        while "is ready" not in Path(folder, "console.txt").read_text():
            if run.poll() is not None or time.monotonic() > end:
                sys.exit("the robot did not start:\n" + Path(folder, "console.txt").read_text())
            time.sleep(0.1)
        yield psutil.Process(run.pid)
    finally:
        run.terminate()
        run.wait()


def main() -> None:
    """Run, print, and exit with 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--rate", type=float, default=1_000.0, help="per second")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--lines", type=int, default=40, help="kinds of log lines that are shown")
    options = parser.parse_args()
    endpoint = free_endpoint()
    with tempfile.TemporaryDirectory() as folder, running(folder, endpoint) as supervisor:
        faults = abuse(supervisor, folder, endpoint, options)
    for fault in faults:
        print("FAILED:", fault)
    sys.exit(1 if faults else 0)


def abuse(supervisor: psutil.Process, folder: str, endpoint: str, options: argparse.Namespace) -> list[str]:
    """Abuse a robot and print what comes of it. Returns what must not have come of it."""
    network = Network(mode="client", connect=(endpoint,))
    watching, abusing = open_session(network), open_session(network)
    quiet = LoopWatch(watching, ROBOT)
    time.sleep(SETTLING)
    quiet.close()
    stranger = Stranger(abusing, ROBOT, options.seed)
    before = processes(supervisor)
    sizes = memory(before)
    loops = LoopWatch(watching, ROBOT)
    reached = throw(stranger, options.count, options.rate)
    time.sleep(1.0)
    loops.close()
    close_session(abusing)
    time.sleep(SETTLING)
    after = processes(supervisor)
    growth = {name: size - sizes.get(name, 0) for name, size in memory(after).items()}
    lines = log_lines(Path(folder))
    console = Path(folder, "console.txt").read_text()
    close_session(watching)
    print(
        f"{options.count} things at {reached:.0f} a second: {dict(stranger.thrown)}; Zenoh refused {stranger.refused}"
    )
    for when, watch in (("before", quiet), ("meanwhile", loops)):
        print(f"longest pause of a loop {when}, ms:", {k: round(gap * 1e3, 1) for k, gap in watch.longest.items()})
    plain = plain_growth(options.count, 2.5 * options.rate, options.seed)
    print("growth, MB:", {name: round(grown / 1e6, 2) for name, grown in growth.items()})
    print("growth of plain Zenoh by the same things, MB:", {name: round(size / 1e6, 2) for name, size in plain.items()})
    print(f"{len(lines)} log lines")
    for kind, often in kinds(lines).most_common(options.lines):
        print(f"  {often:5} {kind}")
    if "Traceback" in console or supervisor.pid not in after:
        print(console[-5000:])
    faults = [f"a process has ended: {name} ({pid})" for pid, name in before.items() if pid not in after]
    for name, grown in growth.items():
        most = MOST_GROWTH + plain["router" if "robo.process.router" in name else "client"]
        faults += [f"{name} grew by {grown / 1e6:.1f} MB"] * (grown > most)
    faults += [f"{topic} paused for {gap:.3f} s" for topic, gap in loops.longest.items() if gap > LONGEST_GAP]
    faults += ["a traceback in the log"] * ("Traceback" in console or any("Traceback" in text for _, text in lines))
    return faults


if __name__ == "__main__":
    main()
