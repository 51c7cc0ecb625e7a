"""`python -m benchmarks`: measure, print, and write RESULTS.md.

Messages are timed in short blocks, the variants in turn and in an order that changes, so that a slow
second of the machine hits all alike; figures are medians over the rounds, with the smallest and
largest. Both ends are processes of their own on one unix socket, with the same message types and the
same encoder. `raw` is zenoh-python with the settings that it comes with, used in each of the ways it
offers; `tuned` the same with robo's settings.
"""

import argparse
import os
import platform
import random
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple, TypeVar

import msgspec
import psutil

from benchmarks import laser, quality

RESULTS = Path(__file__).parent / "RESULTS.md"

RAW_TRIPS = ("raw fifo", "raw ring", "raw callback")
TUNED_TRIPS = ("tuned ring", "tuned callback")
RAW_FLOODS = ("raw fifo-block", "raw callback-block", "raw callback-drop", "raw ring-drop")
TUNED_FLOODS = ("tuned fifo-block", "tuned fifo-stamped")
REFERENCE = ("velocity_controller", "position_tracker", "safety_monitor", "diff_drive_sim")
BLOCK, WARM_UP = 100, 10
"""Round trips of a block, and those before them that do not count."""
FLOOD_MS = 250
"""How long a block of one-way messages lasts, ms."""
N = TypeVar("N", int, float)
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


class Worker:
    """A process at one end of a measurement (see `benchmarks.worker`)."""

    def __init__(self, module: str, *arguments: str) -> None:
        command = [sys.executable, "-m", f"benchmarks.{module}", *arguments]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._answer()

    def ask(self, number: int) -> bytes:
        """Its answer to a number, JSON."""
        assert self._process.stdin is not None
        self._process.stdin.write(b"%d\n" % number)
        self._process.stdin.flush()
        return self._answer()

    def resident(self) -> int:
        """Its memory, bytes."""
        size: int = psutil.Process(self._process.pid).memory_info().rss
        return size

    def _answer(self) -> bytes:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit(f"a worker ended with {self._process.wait()}: {self._process.args!r}")
        return line

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


class Bench:
    """Starts workers that meet on one unix socket."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._number = 0

    def pair(self, stack: ExitStack, server: str, client: str, variant: str, kind: str) -> tuple[Worker, Worker]:
        """Both ends of a measurement, ready."""
        endpoint = self.endpoint()
        listening = stack.enter_context(Worker("worker", server, variant, kind, endpoint, ""))
        return listening, stack.enter_context(Worker("worker", client, variant, kind, "", endpoint))

    def memory(self, variant: str) -> float:
        """Resident memory of a process that has joined and waits, MB."""
        endpoint = self.endpoint()
        with (
            Worker("worker", "echo", "raw ring", "twist", endpoint, ""),
            Worker("memory", variant, endpoint) as worker,
        ):
            return worker.resident() / 1e6

    def start(self, stack: ExitStack, module: str, *arguments: str) -> Worker:
        """A worker, ready."""
        return stack.enter_context(Worker(module, *arguments))

    def port(self) -> str:
        """A port that nobody listens at."""
        return f"tcp/127.0.0.1:{_free_port()}"

    def endpoint(self) -> str:
        """A unix socket that nobody has."""
        self._number += 1
        return f"unixsock-stream/{self._folder}/{self._number}.sock"


def measure(rounds: int, variants: Sequence[str], once: Callable[[str], float], what: str) -> dict[str, list[float]]:
    """Run every variant once a round; the order changes from round to round."""
    found: dict[str, list[float]] = {variant: [] for variant in variants}
    for index in range(rounds):
        shift = index % len(variants)
        for variant in (*variants[shift:], *variants[:shift]):
            found[variant].append(once(variant))
        print(f"  {what}: round {index + 1} of {rounds}", file=sys.stderr)
    return found


def in_blocks(rounds: int, blocks: int, variants: Sequence[str], block: Callable[[str], None], what: str) -> None:
    """Run a block of every variant, in an order that changes, `blocks` times a round."""
    order = list(variants)
    shuffle = random.Random(0).shuffle
    for index in range(rounds):
        for _ in range(blocks):
            shuffle(order)
            for variant in order:
                block(variant)
        print(f"  {what}: round {index + 1} of {rounds}", file=sys.stderr)


def trips_table(bench: Bench, rounds: int, blocks: int, kind: str) -> list[str]:
    variants = (*RAW_TRIPS, *TUNED_TRIPS, "robo")
    times: dict[str, list[int]] = {variant: [] for variant in variants}
    with ExitStack() as stack:
        pings = {variant: bench.pair(stack, "echo", "ping", variant, kind)[1] for variant in variants}

        def block(variant: str) -> None:
            trips = msgspec.json.decode(pings[variant].ask(WARM_UP + BLOCK), type=list[int])
            times[variant] += trips[WARM_UP:]

        for ping in pings.values():
            ping.ask(300)
        in_blocks(rounds, blocks, variants, block, f"round trip of {kind}")
    found: dict[str, list[float]] = {}
    tails: dict[str, list[float]] = {}
    for variant, all_times in times.items():
        for one in _batches(all_times, blocks * BLOCK):
            ordered = sorted(one)
            found.setdefault(variant, []).append(ordered[len(ordered) // 2] / 1e3)
            tails.setdefault(variant, []).append(ordered[len(ordered) * 99 // 100] / 1e3)
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


def floods_table(bench: Bench, rounds: int, blocks: int) -> list[str]:
    variants = (*RAW_FLOODS, *TUNED_FLOODS, *ROBO_FLOODS)
    rates: dict[str, list[float]] = {variant: [] for variant in variants}
    with ExitStack() as stack:
        pairs = {variant: bench.pair(stack, "sink", "flood", variant, "twist") for variant in variants}

        def block(variant: str) -> None:
            sink, source = pairs[variant]
            before = settled(sink)
            source.ask(FLOOD_MS)
            rates[variant].append((settled(sink) - before) / FLOOD_MS * 1e3)

        in_blocks(rounds, blocks, variants, block, "one way")
    found = {
        variant: [statistics.mean(one) for one in _batches(all_rates, blocks)] for variant, all_rates in rates.items()
    }
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


def settled(sink: Worker, pause: float = 0.01) -> int:
    """How many messages a sink has received, once none has come for a `pause`, s."""
    count = -1
    while count != (count := msgspec.json.decode(sink.ask(0), type=int)):
        time.sleep(pause)
    return count


def _batches(values: list[N], size: int) -> list[list[N]]:
    return [values[start : start + size] for start in range(0, len(values), size)]


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
    found |= _tool_times(rounds * 2)
    lines = ["### Start", "", "| command | ms, whole process |", "|---|---|"]
    lines += [f"| `{name}` | {Spread.of(values).text('.0f')} |" for name, values in found.items()]
    return [*lines, ""]


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port: int = s.getsockname()[1]
        return port


def _tool_times(rounds: int) -> dict[str, list[float]]:
    """Tools on the running reference robot, and one where nothing runs; whole processes, ms."""
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    robo = [sys.executable, "-m", "robo"]

    def once(verb: str) -> float:
        begin = time.perf_counter()
        subprocess.run([*robo, *verb.split()[1:], "--connect", endpoint], capture_output=True, check=False)
        return (time.perf_counter() - begin) * 1e3

    nothing = [once("robo topic list") for _ in range(rounds)]
    subprocess.run(
        [*robo, "up", "-d", "--wait", "--robot-name", "bench", "--listen", endpoint], capture_output=True, check=True
    )
    try:
        found = measure(rounds, ("robo topic list", "robo node list", "robo graph", "robo ps"), once, "tools")
    finally:
        subprocess.run([*robo, "down", "--connect", endpoint], capture_output=True, check=True)
    return found | {"robo topic list, where nothing runs": nothing}


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
    rounds, trip_blocks, flood_blocks = (1, 4, 2) if options.quick else (options.rounds, 20, 8)
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
            lines += trips_table(bench, rounds, trip_blocks, kind)
        lines += floods_table(bench, rounds, flood_blocks)
        lines += quality.latched_table(bench, rounds)
        lines += quality.mixed_table(bench, rounds)
        lines += memory_table(bench, rounds)
        lines += start_table(rounds)
        lines += laser.table(rounds)
    text = "\n".join(lines)
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
