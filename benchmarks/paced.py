"""`python -m benchmarks.paced`: round trips at the pace of a control loop, beside raw zenoh-python.

Each variant sends a Twist there and back between two processes on one unix socket, 500 times a second.
They take turns of five seconds in an order that changes, so that a slow time of the machine hits all alike, and in
each turn with new processes, since which of two processes are quick with each other is a matter of luck. Between two
messages both ends sleep: what is measured is mostly how long they take to wake up. `raw ring-stamped` sends along what
robo does: the type's name, a sequence number, a time, and whose the message is.
"""

import argparse
import random
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import msgspec

from benchmarks.__main__ import RAW_TRIPS, Bench, Worker, machine

RESULTS = Path(__file__).parent / "PACED.md"
RATE = 500.0
"""Hz."""
TURN = 5.0
"""How long one variant has it to itself, s."""


def _paced(ping: Worker, seconds: float) -> list[int]:
    """Round trips of one variant at the pace, ns."""
    found: list[int] = []
    due = time.monotonic()
    for _ in range(round(seconds * RATE)):
        found += msgspec.json.decode(ping.ask(1), type=list[int])
        due = max(due + 1 / RATE, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
    return found


def _table(times: dict[str, list[int]]) -> list[str]:
    lines = ["| variant | p50 µs | p99 µs | p99.9 µs | longest ms |", "|---|---|---|---|---|"]
    for variant, found in times.items():
        ordered = sorted(found)
        half, tail, end = (ordered[len(ordered) * part // 1000] / 1e3 for part in (500, 990, 999))
        lines.append(f"| {variant} | {half:.0f} | {tail:.0f} | {end:.0f} | {ordered[-1] / 1e6:.1f} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paced", description="Measure, print, write PACED.md.")
    parser.add_argument("--turns", type=int, default=12, help="turns of five seconds of each variant (default 12)")
    turns: int = parser.parse_args().turns
    variants = [*RAW_TRIPS, "raw ring-stamped", "robo"]
    times: dict[str, list[int]] = {variant: [] for variant in variants}
    order = random.Random(0)
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as folder:
        bench = Bench(folder)
        for _ in range(turns):
            order.shuffle(variants)
            for variant in variants:
                with ExitStack() as stack:
                    _, ping = bench.pair(stack, "echo", "ping", variant, "twist")
                    ping.ask(300)
                    times[variant] += _paced(ping, TURN)
    lines = [
        "# Round trips at the pace of a control loop",
        "",
        f"Written by `python -m benchmarks.paced`: {turns} turns of each variant.",
        "",
        *machine(),
        *(__doc__ or "").split("\n\n", 1)[1].splitlines(),
        "",
        *_table(times),
        "",
    ]
    text = "\n".join(lines)
    print(text)
    RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
