"""`python -m benchmarks.batch`: a hundred recordings through `robo batch replay`, by one worker and by two.

Each recording is a minute of driving, 3,000 odometries, and each a different one; they are replayed to the node
`position_tracker`. Times are of the whole command, from its words to its table, with the start of Ray and its end; all
are of one run of this program, one and two workers in turn. `busy` is how many cores everything on the machine took
meanwhile. `--engine local` is beside it: threads in the place of Ray.
"""

import argparse
import math
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import psutil

from benchmarks.__main__ import machine
from robo import bag
from robo.bag.types import topic_of
from robo.interfaces import cdr
from robo_messages import Header, Odometry, Time

RESULTS = Path(__file__).parent / "BATCH.md"
LEAST = 1.7
"""How many times faster two workers of Ray's have to be than one."""
_START = 1_700_000_000_000_000_000
_PERIOD = 20_000_000
"""From one odometry to the next, ns."""


class Took(NamedTuple):
    seconds: float
    busy: float
    """Cores."""
    load: float
    """Of the machine before, processes."""


def record(path: Path, seed: int, count: int) -> None:
    """A drive that turns now and then."""
    chance = random.Random(seed)
    x = y = heading = turn = 0.0
    encode = cdr.encoder(Odometry)
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        topic = recording.topic(topic_of("r1/odom", Odometry))
        for number in range(count):
            if number % 50 == 0:
                turn = chance.uniform(-0.5, 0.5)
            heading += turn * 0.02
            x, y = x + 0.004 * math.cos(heading), y + 0.004 * math.sin(heading)
            at = _START + number * _PERIOD
            said = Odometry(Header(Time.from_nanoseconds(at), "odom"), "base_link")
            said.pose.pose.position.x, said.pose.pose.position.y = x, y
            said.pose.pose.orientation.z, said.pose.pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)
            recording.write(topic, encode(said), at, at, number + 1, "base")


def measure(folder: Path, engine: str, workers: int, number: int) -> Took:
    """Run all of it, into a folder of results of its own."""
    words = ["batch", "replay", "bags/*.mcap", "--node", "robo_services.position_tracker", "-o", f"results_{number}"]
    command = [sys.executable, "-m", "robo", *words, "--engine", engine, "--workers", str(workers)]
    load = os.getloadavg()[0]
    before, begun = psutil.cpu_times(), time.monotonic()
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    seconds, after = time.monotonic() - begun, psutil.cpu_times()
    count = len(list((folder / "bags").iterdir()))
    assert f"{count} runs: {count} passed, 0 failed" in done.stdout, done.stdout + done.stderr
    used = sum(after) - sum(before) - (after.idle - before.idle) - (after.iowait - before.iowait)
    return Took(seconds, used / seconds, load)


def main() -> None:
    """Measure, and write what came of it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.batch", description=__doc__.partition("\n")[0])
    parser.add_argument("--recordings", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--seconds", type=int, default=60, help="of each recording")
    parser.add_argument("--quick", action="store_true", help="10 recordings, one round; writes no results")
    options = parser.parse_args()
    recordings, rounds = (10, 1) if options.quick else (options.recordings, options.rounds)
    took: dict[tuple[str, int], list[Took]] = {}
    with tempfile.TemporaryDirectory(prefix="b-") as name:
        folder = Path(name)
        (folder / "bags").mkdir()
        for number in range(recordings):
            record(folder / "bags" / f"{number:03}.mcap", number, options.seconds * 50)
        for number in range(rounds):
            for engine, workers in (("ray", 1), ("ray", 2), ("local", 1), ("local", 2)):
                found = measure(folder, engine, workers, len(took) * 100 + number)
                took.setdefault((engine, workers), []).append(found)
                print(engine, workers, found, flush=True)
    lines = [
        "# Batches",
        "",
        f"Written by `python -m benchmarks.batch`: {recordings} recordings of {options.seconds} s, "
        f"{rounds} rounds, of which the medians.",
        "",
        *machine(),
        *__doc__.split("\n\n", 1)[1].splitlines(),
        "",
        f"Two workers of Ray's have to be {LEAST:g} times as fast as one.",
        "",
        "| engine | workers | time | recordings a second | times one worker | busy | load before |",
        "|---|---|---|---|---|---|---|",
    ]
    ratios: dict[str, float] = {}
    for (engine, workers), several in took.items():
        seconds = statistics.median(one.seconds for one in several)
        alone = statistics.median(one.seconds for one in took[engine, 1])
        ratios[engine] = alone / seconds
        busy, load = (statistics.median(getattr(one, which) for one in several) for which in ("busy", "load"))
        lines.append(
            f"| {engine} | {workers} | {seconds:.1f} s | {recordings / seconds:.2f} | {alone / seconds:.2f} | "
            f"{busy:.2f} | {load:.1f} |"
        )
    print("\n".join(lines[-4:]))
    if not options.quick:
        RESULTS.write_text("\n".join(lines) + "\n")
    sys.exit(0 if ratios["ray"] >= LEAST else 1)


if __name__ == "__main__":
    main()
