"""`python -m benchmarks.async_callbacks`: what an async callback costs beside a plain one; writes ASYNC.md.

Round trips of a Twist between two processes on one unix socket. One end answers each message in its
callback, which is plain, or async without anything to await; the other end is the same for both. The two
are timed in short blocks in an order that changes. Memory is that of the process that answers.
"""

import argparse
import tempfile
from contextlib import ExitStack
from pathlib import Path

import msgspec

from benchmarks.__main__ import BLOCK, WARM_UP, Bench, Spread, in_blocks, machine

RESULTS = Path(__file__).parent / "ASYNC.md"
VARIANTS = {"robo": "plain", "robo-async": "async"}


def table(bench: Bench, rounds: int, blocks: int) -> list[str]:
    """A line for each kind of callback."""
    times: dict[str, list[int]] = {variant: [] for variant in VARIANTS}
    with ExitStack() as stack:
        pairs = {variant: bench.pair(stack, "echo", "ping", variant, "twist") for variant in VARIANTS}

        def block(variant: str) -> None:
            trips = msgspec.json.decode(pairs[variant][1].ask(WARM_UP + BLOCK), type=list[int])
            times[variant] += trips[WARM_UP:]

        for _, ping in pairs.values():
            ping.ask(300)
        in_blocks(rounds, blocks, tuple(VARIANTS), block, "round trip")
        memory = {variant: echo.resident() / 1e6 for variant, (echo, _) in pairs.items()}
    lines = ["| the callback is | p50 µs | p99 µs | resident MB |", "|---|---|---|---|"]
    for variant, name in VARIANTS.items():
        size = blocks * BLOCK
        batches = [sorted(times[variant][start : start + size]) for start in range(0, rounds * size, size)]
        p50, p99 = (Spread.of([one[int(size * part)] / 1e3 for one in batches]) for part in (0.5, 0.99))
        lines.append(f"| {name} | {p50.text('.0f')} | {p99.text('.0f')} | {memory[variant]:.1f} |")
    return [*lines, ""]


def main() -> None:
    about, method = (__doc__ or "").split("\n\n", 1)
    parser = argparse.ArgumentParser(prog="python -m benchmarks.async_callbacks", description=about)
    parser.add_argument("--rounds", type=int, default=5, help="rounds (default 5)")
    rounds = parser.parse_args().rounds
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as folder:
        found = table(Bench(folder), rounds, 20)
    written = "Written by `python -m benchmarks.async_callbacks`"
    head = f"{written}: medians over {rounds} interleaved rounds (smallest-largest)."
    text = "\n".join(["# Async callbacks", "", head, "", *machine(), *method.splitlines(), "", *found])
    print(text)
    RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
