"""`python -m benchmarks.limits`: a control loop beside nodes that use too much memory and log; writes LIMITS.md.

The reference robot drives on a simulated base. Beside it, in the same run, a node takes 160 MB more each second and has
a limit of 150 MB, so that it is killed and started again the whole time; and a process prints 100 MB a second, as far
as it is read. The control loop is what commands the base: `cmd_vel` of the safety monitor, 50 times a second. Its
jitter is how far the time between two commands is from 20 ms, by the stamps of their publisher, so that neither the
network nor whoever measures is in it.
"""

import argparse
import itertools
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from benchmarks.__main__ import Spread, machine
from robo import Network, Node, open_session, subscribe
from robo.machine.output import Budget
from robo.node.message_info import MessageInfo
from robo_messages import Twist

RESULTS = Path(__file__).parent / "LIMITS.md"
LIMIT = 10.0
"""Within this, at its 99th percentile, the control loop keeps its time, ms."""
PERIOD = 20.0
"""From one command to the next, ms."""
MEMORY = "150M"
RUN_LIMIT = 5
"""What the log files of the run may take, MB."""

_BESIDE = f"""
include: simulation.yaml
groups:
  beside:
    namespace: ${{robot_name}}
    nodes:
      eater:
        service: benchmarks.limits:Eater
        restart: {{policy: always, delay: 0.1, max_delay: 0.1, max: 1000}}
        limits: {{memory: {MEMORY}}}
      flood: {{run: [python, -m, benchmarks.limits, --flood]}}
"""


class Eater(Node):
    """Need ever more memory: 160 MB more each second."""

    def on_start(self) -> None:
        self.kept: list[bytearray] = []
        threading.Thread(target=self.eat, daemon=True).start()

    def eat(self) -> None:
        while True:
            self.kept.append(bytearray(b"x" * 8_000_000))
            time.sleep(0.05)


class Watcher(Node):
    """Notes when commands were sent."""

    def on_start(self) -> None:
        self.stamps: list[int] = []

    @subscribe("cmd_vel", depth=1000)
    def on_command(self, _: Twist, info: MessageInfo) -> None:
        if info.source_time is not None:
            self.stamps.append(info.source_time)


class Found(NamedTuple):
    """What was measured of one run."""

    jitter: list[float]
    """Of each command, ms."""
    kills: int
    """How often the eater has ended."""
    told: str
    """What `robo why` says of it."""
    printed: float
    """MB that the flood was rid of each second."""
    logs: float
    """What the log files of the run take, MB."""


def flood() -> None:
    """Print 100 MB a second."""
    block = (b"x" * 99 + b"\n") * 10_000
    count, begin = 0, time.monotonic()
    while True:
        view = memoryview(block)
        while view:
            view = view[os.write(1, view) :]
        count += 1
        time.sleep(max(0.0, begin + count / 100 - time.monotonic()))


@contextmanager
def _run(folder: str, manifest: str, endpoint: str) -> Iterator["subprocess.Popen[bytes]"]:
    environment = {**os.environ, "ROBO_LOG_DIR": folder, "ROBO_LOG_RUN_LIMIT": str(RUN_LIMIT)}
    command = [sys.executable, "-m", "robo", "up", manifest, "--robot-name", "r1", "--listen", endpoint]
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as run:
        try:
            yield run
        finally:
            run.send_signal(signal.SIGTERM)


def measure(manifest: str, seconds: float) -> Found:
    """Drive for some seconds."""
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as folder, _run(folder, manifest, endpoint) as run:
        session = open_session(Network(mode="client", connect=(endpoint,), timeout=30.0))
        try:
            with Watcher(namespace="r1", session=session) as watcher:
                while len(watcher.stamps) < 100:  # it drives
                    time.sleep(0.05)
                    assert run.poll() is None, "the robot has ended"
                begin, written = len(watcher.stamps), _written(run.pid)
                time.sleep(seconds)
                stamps = watcher.stamps[begin:]
                printed = (_written(run.pid) - written) / seconds / 1e6
            kills, told = _eater(endpoint)
        finally:
            session.close()
        logs = sum(file.stat().st_size for file in Path(folder).rglob("*.jsonl*")) / 1e6
    gaps = [(after - before) / 1e6 for before, after in itertools.pairwise(stamps)]
    return Found([abs(gap - PERIOD) for gap in gaps], kills, told, printed, logs)


def _written(supervisor: int) -> int:
    """What the process that floods has written so far, bytes."""
    for name in os.listdir("/proc"):
        if name.isdecimal():
            try:
                words = Path(f"/proc/{name}/cmdline").read_bytes().split(b"\0")
                if b"--flood" in words and os.getsid(int(name)) == os.getsid(supervisor):
                    lines = Path(f"/proc/{name}/io").read_text().splitlines()
                    return int(next(line for line in lines if line.startswith("wchar:")).split()[1])
            except OSError:
                continue
    return 0


def _eater(endpoint: str) -> tuple[int, str]:
    ps = [sys.executable, "-m", "robo", "ps", "--json", "--connect", endpoint]
    listed = subprocess.run(ps, capture_output=True, text=True, check=True).stdout.splitlines()
    restarts = [row["restarts"] for row in map(json.loads, listed) if row["node"] == "/r1/eater"]
    if not restarts:
        return 0, ""
    # It ends with 1, as something is wrong.
    why = [sys.executable, "-m", "robo", "why", "eater", "--connect", endpoint]
    lines = subprocess.run(why, capture_output=True, text=True, check=False).stdout.splitlines()
    return restarts[0], next((line.strip() for line in lines if "killed by" in line), "")


def _free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _share(values: Sequence[float], part: float) -> float:
    return sorted(values)[min(len(values) - 1, int(len(values) * part))]


def table(rounds: int, seconds: float) -> list[str]:
    """The figures, a line for each variant."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", dir="launch") as beside:
        beside.write(_BESIDE)
        beside.flush()
        variants = {"alone": "simulation.yaml", "beside both": beside.name}
        found: dict[str, list[Found]] = {name: [] for name in variants}
        for index in range(rounds):
            for name, manifest in variants.items():
                found[name].append(measure(manifest, seconds))
            print(f"  limits: round {index + 1} of {rounds}", file=sys.stderr)
    lines = [
        "| the robot | jitter p50 ms | p99 ms | most ms | eater killed | printed MB/s | log files MB |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, each in found.items():
        figures = [
            Spread.of([statistics.median(one.jitter) for one in each]).text(".2f"),
            Spread.of([_share(one.jitter, 0.99) for one in each]).text(".1f"),
            Spread.of([max(one.jitter) for one in each]).text(".1f"),
            Spread.of([one.kills for one in each]).text(".0f"),
            Spread.of([one.printed for one in each]).text(".0f"),
            Spread.of([one.logs for one in each]).text(".1f"),
        ]
        lines.append(f"| {name} | {' | '.join(figures)} |")
    last = found["beside both"]
    reached = statistics.median(_share(one.jitter, 0.99) for one in last)
    verdict = "holds" if reached <= LIMIT else "DOES NOT HOLD"
    full = "holds" if max(one.logs for one in last) <= RUN_LIMIT else "DOES NOT HOLD"
    per_second = Budget.PER_SECOND / 1024
    return [
        *lines,
        "",
        f"The control loop keeps its time within {LIMIT:g} ms (p99) beside both: {verdict}, {reached:.1f} ms.",
        "",
        f"100 MB/s of output fill no more than the run's limit, {RUN_LIMIT} MB here, at {per_second:g} kB/s: {full}.",
        "",
        f"`robo why eater` says: `{last[-1].told}`.",
        "",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.limits", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each measurement (default 5)")
    parser.add_argument("--seconds", type=float, default=20.0, help="how long each takes (default 20)")
    parser.add_argument("--quick", action="store_true", help="one short round; writes no results")
    parser.add_argument("--flood", action="store_true", help="be the process that floods")
    options = parser.parse_args()
    if options.flood:
        flood()
    rounds, seconds = (1, 8.0) if options.quick else (options.rounds, options.seconds)
    head = (
        f"Written by `python -m benchmarks.limits`: medians over {rounds} rounds of {seconds:g} s (smallest-largest)."
    )
    about = (__doc__ or "").split("\n\n", 1)[1].splitlines()
    text = "\n".join(["# A control loop beside nodes that use too much", "", head, "", *machine(), *about, ""])
    text = "\n".join([text, *table(rounds, seconds)])
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
