"""`python -m benchmarks.transforms`: what a buffer of transforms costs; writes TRANSFORMS.md.

A tree of 1,000 moving frames, 100 arms of 10 links each: a base that drives and nine joints that turn, every frame at
100 Hz with stamps of its own. The buffer keeps 10 s, and its histories are full. Times are those of the processor, in
one process and one thread, without a network; `share` is the part of one core that it takes at the rate that is named.

**Taken in**: `insert_all` of what was decoded from a `tf2/TFMessage`. **Looked up**: where one frame stands in another,
over 2 or 10 links, from a tip to the root or from one arm to another, each link interpolated. `one time`: all at the
same time of the last 0.1 s, so that three lookups share the motion of a link between two samples; `again`: all 1 µs
later, with motions that are known; `newest`: without a time; `any time`: each at another time of all that is kept, so
that each motion is worked out anew. **Both**: 1,000 frames at 100 Hz in messages of 20, and 10,000 lookups a second
over 10 links, 30 ms back, beside each other: there a motion is asked for once.
"""

import argparse
import math
import random
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import psutil

from benchmarks.__main__ import Spread, machine
from robo.tf import Buffer, Transform3
from robo_messages import Header, TFMessage, Time, TransformStamped, encode
from robo_messages._registry import decoder_of

RESULTS = Path(__file__).parent / "TRANSFORMS.md"

ARMS, LINKS, RATE = 100, 10, 100
FRAMES = ARMS * LINKS
LOOKUPS = 10_000
"""A second."""
KEPT = 10.0
"""s."""
MOST_TO_INSERT, MOST_SHARE = 1.0, 20.0
"""µs for each transform; percent of a core for the lookups."""
KINDS = ("one time", "again", "newest", "any time")
BEGIN = 1_700_000_000_000_000_000
PERIOD = 1_000_000_000 // RATE
_decode = decoder_of(TFMessage).decode


def frame(arm: int, link: int) -> str:
    """A link of an arm; link 0 is the root of all."""
    return f"arm_{arm}/link_{link}" if link else "map"


def turn(step: int) -> list[TransformStamped]:
    """All transforms of one period. Their stamps lie within it, each link's at a place of its own."""
    found = []
    for arm in range(ARMS):
        for link in range(1, LINKS + 1):
            stamp = BEGIN + step * PERIOD + (arm * LINKS + link) * 7919 % FRAMES * PERIOD // FRAMES
            angle = math.sin(0.02 * step + arm + link)
            driven = 0.0 if link > 1 else 0.001 * step
            where = Transform3.from_rpy(0.3 + driven, 0.1 * link, 0.05, 0.1, 0.2, angle)
            header = Header(Time.from_nanoseconds(stamp), frame(arm, link - 1))
            found.append(where.to_stamped(header, frame(arm, link)))
    return found


def packed(step: int, size: int) -> list[bytes]:
    """The transforms of one period as messages of so many."""
    transforms = turn(step)
    return [encode(TFMessage(transforms[i : i + size])) for i in range(0, FRAMES, size)]


def pairs(links: int) -> list[tuple[str, str]]:
    """Frames between which there are so many links: root and tip, tip and root, or one arm and another."""
    half = links // 2
    found = []
    for arm in range(ARMS):
        other = frame((arm + 1) % ARMS, half)
        found += [("map", frame(arm, links)), (frame(arm, links), "map"), (frame(arm, half), other)]
    random.Random(0).shuffle(found)
    return found


class Costs:
    """The processor's time for what was done, by what it was."""

    def __init__(self) -> None:
        self.found: dict[str, list[float]] = {}

    def measure(self, what: str, count: int, work: Callable[[], object]) -> None:
        """Do something `count` times at once, and note the µs of each."""
        begin = time.process_time_ns()
        work()
        self.found.setdefault(what, []).append((time.process_time_ns() - begin) / count / 1e3)

    def row(self, title: str, what: str, per_second: int) -> str:
        """A line of a table: µs each, and the share of a core at a rate."""
        spread = Spread.of(self.found[what])
        return f"| {title} | {spread.text('.2f')} | {spread.median * per_second / 1e4:.1f} % |"


def full_buffer(steps: int) -> tuple[Buffer, float]:
    """A buffer with full histories, and the memory that it takes, MB."""
    process = psutil.Process()
    before = process.memory_info().rss
    buffer = Buffer(KEPT)
    for step in range(steps):
        for payload in packed(step, 20):
            buffer.insert_all(_decode(payload).transforms, source="arms")
    return buffer, (process.memory_info().rss - before) / 1e6


def take_in(costs: Costs, buffer: Buffer, steps: Iterator[int], rounds: int) -> None:
    """Decode and insert what comes, in messages of one size after the other."""
    for _ in range(rounds):
        for size in (1, 20, FRAMES):
            payloads = packed(next(steps), size)
            decoded: list[TFMessage] = []
            costs.measure(f"decode {size}", FRAMES, partial(decode_all, payloads, decoded))
            costs.measure(f"insert {size}", FRAMES, partial(insert_all, buffer, decoded))


def decode_all(payloads: Sequence[bytes], decoded: list[TFMessage]) -> None:
    """One message after the other."""
    for payload in payloads:
        decoded.append(_decode(payload))


def insert_all(buffer: Buffer, messages: Sequence[TFMessage]) -> None:
    """One message after the other."""
    for message in messages:
        buffer.insert_all(message.transforms, source="arms")


def look_up(costs: Costs, buffer: Buffer, steps: Iterator[int], rounds: int, kept: float) -> None:
    """Look up between frames that are 2 or 10 links apart, up to `kept` s back."""
    rng = random.Random(1)
    for links in (2, 10):
        asked = pairs(links)
        for target, source in asked:
            buffer.lookup(target, source)
        for _ in range(rounds):
            step = next(steps)
            insert_all(buffer, [TFMessage(turn(step))])
            newest = BEGIN + (step - 1) * PERIOD
            one = newest - rng.randrange(100_000_000)
            times: list[list[int | None]] = [
                [one] * len(asked),
                [one + 1000] * len(asked),
                [None] * len(asked),
                [newest - rng.randrange(round(0.9e9 * kept)) for _ in asked],
            ]
            for kind, when in zip(KINDS, times, strict=True):
                work = partial(ask, buffer, [(*pair, at) for pair, at in zip(asked, when, strict=True)])
                costs.measure(f"{kind} {links}", len(asked), work)


def ask(buffer: Buffer, questions: Sequence[tuple[str, str, int | None]]) -> None:
    """One lookup after the other."""
    for target, source, at in questions:
        buffer.lookup(target, source, at)


def both(buffer: Buffer, steps: Iterator[int], seconds: float) -> float:
    """The share of a core, in percent, of taking in and looking up beside each other."""
    asked = pairs(LINKS)
    rng = random.Random(2)
    spent = 0
    for _ in range(round(seconds * RATE)):
        step = next(steps)
        payloads = packed(step, 20)
        now = BEGIN + step * PERIOD
        questions = [
            (*rng.choice(asked), now - 30_000_000 + i * PERIOD * RATE // LOOKUPS) for i in range(LOOKUPS // RATE)
        ]
        begin = time.process_time_ns()
        for payload in payloads:
            buffer.insert_all(_decode(payload).transforms, source="arms")
        for target, source, at in questions:
            buffer.lookup(target, source, at)
        spent += time.process_time_ns() - begin
    return spent / seconds / 1e7


def table(rounds: int, kept: float) -> list[str]:
    """All figures."""
    costs = Costs()
    steps = iter(range(10**9))
    filled = round(kept * 1.3 * RATE)
    buffer, memory = full_buffer(filled)
    for _ in range(filled):
        next(steps)
    take_in(costs, buffer, steps, rounds)
    look_up(costs, buffer, steps, rounds, kept)
    share = Spread.of([both(buffer, steps, 1.0) for _ in range(max(1, rounds // 4))])
    lines = ["| transforms in a message | µs each | share, 1,000 frames at 100 Hz |", "|---|---|---|"]
    for size in (1, 20, FRAMES):
        lines.append(costs.row(f"{size:,}: decoded", f"decode {size}", FRAMES * RATE))
        lines.append(costs.row(f"{size:,}: inserted", f"insert {size}", FRAMES * RATE))
    lines += ["", "| lookup over | µs each | share, 10,000 a second |", "|---|---|---|"]
    for links in (2, 10):
        for kind in KINDS:
            lines.append(costs.row(f"{links} links, {kind}", f"{kind} {links}", LOOKUPS))
    return [
        *lines,
        "",
        f"Both: {share.text('.0f')} % of a core. Memory of the full buffer: {memory:.0f} MB.",
        "",
        *verdicts(costs),
        "",
    ]


def verdicts(costs: Costs) -> list[str]:
    """Whether what is promised holds."""
    inserted = max(Spread.of(costs.found[f"insert {size}"]).median for size in (20, FRAMES))
    lines = [
        f"To insert a transform takes at most {MOST_TO_INSERT:g} µs, in messages of several: "
        f"{_verdict(inserted, MOST_TO_INSERT)}, {inserted:.2f} µs."
    ]
    for kind in KINDS[:2]:
        share = Spread.of(costs.found[f"{kind} {LINKS}"]).median * LOOKUPS / 1e4
        lines.append(
            f"10,000 lookups a second over 10 links take at most {MOST_SHARE:g} % of a core, {kind}: "
            f"{_verdict(share, MOST_SHARE)}, {share:.1f} %."
        )
    return [line for text in lines for line in (text, "")][:-1]


def _verdict(value: float, most: float) -> str:
    return "holds" if value <= most else "DOES NOT HOLD"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.transforms", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=20, help="rounds of each measurement (default 20)")
    parser.add_argument("--quick", action="store_true", help="a few rounds with short histories; writes no results")
    options = parser.parse_args()
    rounds, kept = (4, 1.0) if options.quick else (options.rounds, KEPT)
    head = f"Written by `python -m benchmarks.transforms`: medians over {rounds} rounds (smallest-largest)."
    about = (__doc__ or "").split("\n\n", 1)[1].splitlines()
    text = "\n".join(["# A buffer of transforms", "", head, "", *machine(), *about, "", *table(rounds, kept)])
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
