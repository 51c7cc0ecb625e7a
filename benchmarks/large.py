"""`python -m benchmarks.large`: images and scans between two processes, beside raw Zenoh; writes LARGE.md.

Both ends are processes of their own on one unix socket; `raw` is zenoh-python as it comes. `raw implicit`
puts the encoded image and leaves shared memory to Zenoh; `raw explicit` asks for it as Zenoh's examples do,
and copies the encoded image there; `raw explicit, in place` writes head and pixels into the memory that was
read last, which is the most that zenoh-python lets one do. `robo` publishes an `Image` of `bytes`, `robo
array` one of a numpy array, `robo without` one as robo did before it had shared memory of its own. All
receivers decode. The variants take turns in short blocks, in an order that changes.
"""

import argparse
import statistics
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import msgspec

from benchmarks.__main__ import Spread, Worker, in_blocks, machine, settled

RESULTS = Path(__file__).parent / "LARGE.md"
IMAGES = ("raw implicit", "raw explicit", "raw explicit, in place", "robo without", "robo", "robo array")
EXPLICIT = ("raw explicit", "raw explicit, in place")
SCANS = ("raw bytes", "robo array", "robo list")
BLOCK_MS = 150
PAUSE = 0.03
"""After which no image comes any more that is on the way, s."""


class Ends:
    """Starts workers that meet on one unix socket."""

    def __init__(self, folder: str, stack: ExitStack) -> None:
        self._folder = folder
        self._stack = stack
        self._number = 0

    def pair(self, server: str, client: str, variant: str, kind: str) -> tuple[Worker, Worker]:
        """Both ends of a measurement, ready."""
        self._number += 1
        endpoint = f"unixsock-stream/{self._folder}/{kind}{self._number}.sock"
        listening = self._stack.enter_context(Worker("large_worker", server, variant, kind, endpoint, ""))
        return listening, self._stack.enter_context(Worker("large_worker", client, variant, kind, "", endpoint))


def images_table(folder: str, rounds: int, blocks: int, size: int, mode: str) -> list[str]:
    rates: dict[str, list[float]] = {variant: [] for variant in IMAGES}
    with ExitStack() as stack:
        ends = Ends(folder, stack)
        pairs = {variant: ends.pair("sink", "flood", f"{variant}, {mode}", str(size)) for variant in IMAGES}

        def block(variant: str) -> None:
            sink, source = pairs[variant]
            before, begun = settled(sink, PAUSE), time.monotonic()
            source.ask(BLOCK_MS)
            passed = time.monotonic() - begun
            rates[variant].append((settled(sink, PAUSE) - before) * size / passed / 1e6)

        for variant in IMAGES:
            block(variant)
            rates[variant].clear()
        in_blocks(rounds, blocks, IMAGES, block, f"{size // 10**6} MB, {mode}")
    found = {
        variant: Spread.of([statistics.mean(all_rates[i : i + blocks]) for i in range(0, len(all_rates), blocks)])
        for variant, all_rates in rates.items()
    }
    best, before = max(found[variant].median for variant in EXPLICIT), found.get("robo without", found["robo"]).median
    lines = [
        f"### Images of {size // 10**6} MB, {mode}",
        "",
        "| variant | received MB/s | / best raw explicit | / robo without |",
        "|---|---|---|---|",
    ]
    for variant, spread in found.items():
        ratios = f"{spread.median / best:.2f} | {spread.median / before:.2f}"
        lines.append(f"| {variant} | {spread.text(',.0f')} | {ratios} |")
    return [*lines, ""]


def scans_table(folder: str, rounds: int, blocks: int) -> list[str]:
    trips: dict[str, list[int]] = {variant: [] for variant in SCANS}
    pings: dict[str, Worker] = {}

    def block(variant: str) -> None:
        trips[variant] += msgspec.json.decode(pings[variant].ask(110), type=list[int])[10:]

    for number in range(rounds):
        with ExitStack() as stack:
            ends = Ends(folder, stack)
            for variant in SCANS:
                pings[variant] = ends.pair("echo", "ping", variant, "scan")[1]
                pings[variant].ask(110)
            in_blocks(1, blocks, SCANS, block, f"scans, processes {number + 1} of {rounds}")
    size = blocks * 100
    medians = {
        variant: Spread.of([statistics.median(times[i : i + size]) / 1e3 for i in range(0, len(times), size)])
        for variant, times in trips.items()
    }
    lines = [
        "### Round trip of a scan of 2,000 rays",
        "",
        "From a numpy array to one, or from a list to one. `raw bytes` are the 8,000 bytes of the ranges alone. Each",
        "round has processes of its own: which two are quick with each other is a matter of luck.",
        "",
        "| variant | p50 µs | / raw bytes |",
        "|---|---|---|",
    ]
    for variant, spread in medians.items():
        lines.append(f"| {variant} | {spread.text('.0f')} | {spread.median / medians['raw bytes'].median:.2f} |")
    return [*lines, ""]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.large", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each measurement (default 5)")
    parser.add_argument("--quick", action="store_true", help="one short round; writes no results")
    options = parser.parse_args()
    rounds, blocks = (1, 2) if options.quick else (options.rounds, 3)
    lines = [
        "# Large messages",
        "",
        f"Written by `python -m benchmarks.large`: medians over {rounds} interleaved rounds (smallest-largest).",
        "",
        *machine(),
        *__doc__.split("\n\n", 1)[1].splitlines(),
        "",
    ]
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as folder:
        for size in (1_000_000, 6_000_000):
            for mode in ("depth 10", "keep all"):
                lines += images_table(folder, rounds, blocks, size, mode)
        lines += scans_table(folder, rounds, blocks * 5)
    text = "\n".join(lines)
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
