"""`python -m benchmarks`: measure, print, and write RESULTS.md.

Each round runs every variant once, one after the other, so that a slow minute of the machine hits
all alike; figures are medians over the rounds, with the smallest and largest. Both ends are processes
of their own on one unix socket, with the same message types and the same encoder. `raw` is zenoh-python
with the settings that it comes with, used in each of the ways it offers; `tuned` the same with robo's
settings.
"""

import argparse
import os
import platform
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import msgspec
import psutil

from benchmarks import laser

RESULTS = Path(__file__).parent / "RESULTS.md"

RAW_TRIPS = ("raw fifo", "raw ring", "raw callback")
TUNED_TRIPS = ("tuned ring", "tuned callback")
RAW_FLOODS = ("raw fifo-block", "raw callback-block", "raw callback-drop", "raw ring-drop")
TUNED_FLOODS = ("tuned fifo-block", "tuned fifo-stamped")
REFERENCE = ("velocity_controller", "position_tracker", "safety_monitor", "diff_drive_sim")
ROBO_FLOODS = ("robo", "robo-keep-all")


class Spread(NamedTuple):
    """A figure over the rounds."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        return cls(statistics.median(values), min(values), max(values))

    def text(self, form: str) -> str:
        return f"{self.median:{form}} ({self.low:{form}}-{self.high:{form}})"


class Bench:
    """Starts workers that meet on one unix socket."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._number = 0

    def round_trip(self, variant: str, kind: str, count: int) -> tuple[float, float]:
        """p50 and p99 of a round trip, µs."""
        endpoint = self._endpoint()
        echo = _worker("echo", variant, kind, endpoint, "", 0)
        _answer(echo)
        ping = _worker("ping", variant, kind, "", endpoint, count)
        times = sorted(msgspec.json.decode(_answer(ping), type=list[int]))
        _end(ping, echo)
        return times[len(times) // 2] / 1e3, times[len(times) * 99 // 100] / 1e3

    def one_way(self, variant: str, kind: str, seconds: float) -> float:
        """Messages per second that reached the other end's callback."""
        endpoint = self._endpoint()
        sink = _worker("sink", variant, kind, endpoint, "", 0)
        _answer(sink)
        source = _worker("flood", variant, kind, "", endpoint, seconds)
        _answer(source)
        _end(source)
        assert sink.stdin is not None
        sink.stdin.write(b"\n")
        sink.stdin.flush()
        received = msgspec.json.decode(_answer(sink), type=int)
        _end(sink)
        return received / seconds

    def memory(self, variant: str) -> float:
        """Resident memory of a process that has joined and waits, MB."""
        endpoint = self._endpoint()
        other = _worker("echo", "raw ring", "twist", endpoint, "", 0)
        _answer(other)
        command = [sys.executable, "-m", "benchmarks.memory", variant, endpoint]
        worker = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        _answer(worker)
        size: int = psutil.Process(worker.pid).memory_info().rss
        _end(worker, other)
        return size / 1e6

    def _endpoint(self) -> str:
        self._number += 1
        return f"unixsock-stream/{self._folder}/{self._number}.sock"


def _worker(role: str, variant: str, kind: str, listen: str, connect: str, amount: float) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "benchmarks.worker", role, variant, kind, listen, connect]
    return subprocess.Popen([*command, str(amount)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def _answer(worker: "subprocess.Popen[bytes]") -> bytes:
    assert worker.stdout is not None
    line = worker.stdout.readline()
    if not line:
        raise SystemExit(f"a worker ended with {worker.wait()}: {worker.args!r}")
    return line


def _end(*workers: "subprocess.Popen[bytes]") -> None:
    for worker in workers:
        worker.kill()
        worker.communicate()


def measure(rounds: int, variants: Sequence[str], once: Callable[[str], float], what: str) -> dict[str, list[float]]:
    """Run every variant once a round; the order changes from round to round."""
    found: dict[str, list[float]] = {variant: [] for variant in variants}
    for index in range(rounds):
        shift = index % len(variants)
        for variant in (*variants[shift:], *variants[:shift]):
            found[variant].append(once(variant))
        print(f"  {what}: round {index + 1} of {rounds}", file=sys.stderr)
    return found


def trips_table(bench: Bench, rounds: int, count: int, kind: str) -> list[str]:
    tails: dict[str, list[float]] = {}

    def once(variant: str) -> float:
        p50, p99 = bench.round_trip(variant, kind, count)
        tails.setdefault(variant, []).append(p99)
        return p50

    found = measure(rounds, (*RAW_TRIPS, *TUNED_TRIPS, "robo"), once, f"round trip of {kind}")
    medians = {variant: statistics.median(values) for variant, values in found.items()}
    best = min(medians[variant] for variant in RAW_TRIPS)
    tuned = min(medians[variant] for variant in TUNED_TRIPS)
    head = "| variant | p50 µs | p99 µs | p50 / best raw | p50 / best tuned |"
    lines = [f"### Round trip, {kind}", "", head, "|---|---|---|---|---|"]
    for variant, values in found.items():
        ratios = f"{medians[variant] / best:.2f} | {medians[variant] / tuned:.2f}"
        lines.append(
            f"| {variant} | {Spread.of(values).text('.0f')} | {Spread.of(tails[variant]).text('.0f')} | {ratios} |"
        )
    return [*lines, ""]


def floods_table(bench: Bench, rounds: int, seconds: float) -> list[str]:
    variants = (*RAW_FLOODS, *TUNED_FLOODS, *ROBO_FLOODS)
    found = measure(rounds, variants, lambda variant: bench.one_way(variant, "twist", seconds), "one way")
    medians = {variant: statistics.median(values) for variant, values in found.items()}
    best = max(medians[variant] for variant in RAW_FLOODS)
    stamped = medians["tuned fifo-stamped"]
    lines = [
        "### One way, Twist, as fast as it goes",
        "",
        "`-block` loses nothing, `-drop` and `robo` (depth 10) keep the newest. `fifo-stamped` sends what robo",
        "sends: a sequence number and a time as an attachment, and an encoding that names the type.",
        "",
        "| variant | received per s | / best raw | / tuned fifo-stamped |",
        "|---|---|---|---|",
    ]
    for variant, values in found.items():
        m = medians[variant]
        lines.append(f"| {variant} | {Spread.of(values).text(',.0f')} | {m / best:.2f} | {m / stamped:.2f} |")
    return [*lines, ""]


def memory_table(bench: Bench, rounds: int) -> list[str]:
    services = [f"robo_services.{name}" for name in REFERENCE]
    found = measure(rounds, ("raw", *services), bench.memory, "memory")
    bare = statistics.median(found["raw"])
    lines = ["### Memory of a process", "", "| process | resident MB | over a raw session |", "|---|---|---|"]
    for variant, values in found.items():
        spread = Spread.of(values)
        lines.append(f"| {variant} | {spread.text('.1f')} | {spread.median - bare:+.1f} |")
    return [*lines, ""]


def start_table(rounds: int) -> list[str]:
    def once(variant: str) -> float:
        command = {
            "python -c pass": [sys.executable, "-c", "pass"],
            "python -c 'import zenoh, msgspec'": [sys.executable, "-c", "import zenoh, msgspec"],
            "python -c 'import robo'": [sys.executable, "-c", "import robo"],
            "robo --help": [sys.executable, "-m", "robo", "--help"],
        }[variant]
        begin = time.perf_counter()
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        return (time.perf_counter() - begin) * 1e3

    names = ("python -c pass", "python -c 'import zenoh, msgspec'", "python -c 'import robo'", "robo --help")
    found = measure(rounds * 2, names, once, "start")
    found["robo up: command to all ready"] = [_time_to_ready() for _ in range(rounds)]
    lines = ["### Start", "", "| command | ms, whole process |", "|---|---|"]
    lines += [f"| `{name}` | {Spread.of(values).text('.0f')} |" for name, values in found.items()]
    return [*lines, ""]


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port: int = s.getsockname()[1]
        return port


def _time_to_ready() -> float:
    """From the command to the line that says that all nodes are ready, ms."""
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    begin = time.perf_counter()
    command = [sys.executable, "-m", "robo", "up", "--robot-name", "bench", "--listen", endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as robot:
        assert robot.stdout is not None
        ready = next((time.perf_counter() for line in robot.stdout if " is ready: " in line), None)
        robot.terminate()
        robot.stdout.read()
    if ready is None:
        raise SystemExit("robo up did not become ready")
    return (ready - begin) * 1e3


def machine() -> list[str]:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    cpu = next((line.partition(":")[2].strip() for line in lines if "model name" in line), platform.processor())
    packages = ", ".join(f"{name} {version(name)}" for name in ("eclipse-zenoh", "msgspec"))
    return [
        f"{os.cpu_count()} cores of {cpu}, {platform.system()} {platform.release()}, "
        f"CPython {platform.python_version()}, {packages}.",
        "",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each measurement (default 5)")
    parser.add_argument("--quick", action="store_true", help="one short round; writes no results")
    options = parser.parse_args()
    rounds, count, seconds = (1, 500, 0.5) if options.quick else (options.rounds, 3000, 2.0)
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as folder:
        bench = Bench(folder)
        lines = [
            "# Results",
            "",
            f"Written by `python -m benchmarks`: medians over {rounds} interleaved rounds (smallest-largest).",
            "",
            *machine(),
            *(__doc__ or "").split("\n\n", 1)[1].splitlines(),
            "",
        ]
        for kind in ("twist", "odometry", "scan"):
            lines += trips_table(bench, rounds, count, kind)
        lines += floods_table(bench, rounds, seconds)
        lines += memory_table(bench, rounds)
        lines += start_table(rounds)
        lines += laser.table(rounds)
    text = "\n".join(lines)
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
