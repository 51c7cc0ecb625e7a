"""Damaged recordings through everything that reads them: only errors of robo's, and a bounded memory.

One seed is one file. As a program it makes many and tells what came out:

    python -m tests.hostile_bags --files 10000
"""

import argparse
import contextlib
import random
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from robo import bag
from robo.errors import BagError
from tests import bags

MEMORY = 2**30
"""What the process may ask for beyond what it has before the first file, bytes: 1 GB."""
LONGEST = 20.0
"""That one file may take, s: a machine may be busy."""


def forms(folder: Path) -> dict[str, bytes]:
    """Whole files of all forms."""
    bags.drive(folder / "plain.mcap", count=60)
    bags.drive(folder / "chunks.mcap", bag.Options(compression="none", sync=False, chunk_size=700), count=60)
    bags.drive(folder / "parts", bag.Options(compression="none", sync=False, split_duration=0.3), count=60)
    plain = (folder / "plain.mcap").read_bytes()
    chunks = (folder / "chunks.mcap").read_bytes()
    found = {
        "plain": plain,
        "chunks": chunks,
        "split": (folder / "parts" / "parts_1.mcap").read_bytes(),
        "no summary": bags.without_summary(chunks),
        "no chunks": bags.without_chunks(chunks),
    }
    for name, compress in compressors().items():
        found[name] = bags.with_chunks(chunks, name, compress)
        found[f"{name}, no checksum"] = bags.with_chunks(chunks, name, compress, crc=False)
    return found


def bombs(plain: bytes) -> dict[str, bytes]:
    """Files that unfold to much, and to more than they say."""
    return {
        f"{name} bomb {size:,}": bags.with_bomb(plain, name, compress, size)
        for name, compress in compressors().items()
        for size in (2**28, 2**31)
    }


def compressors() -> dict[str, Callable[[bytes], bytes]]:
    """What is installed."""
    from robo.bag import compression

    found = {}
    if (zstd := compression._module(compression._ZSTD)) is not None:
        found["zstd"] = zstd.compress
    if (lz4 := compression._module("lz4.frame")) is not None:
        found["lz4"] = lz4.compress
    return found


def torture(path: Path, data: bytes) -> Counter[str]:
    """Everything that reads, on one file; what came out, by name.

    Raises:
        Exception: anything that is no error of robo's with the file's name in it.
    """
    path.write_bytes(data)
    whole = path.with_name("whole.mcap")
    whole.unlink(missing_ok=True)
    outcomes: Counter[str] = Counter()
    for name, use in _USES.items():
        try:
            use(path, whole)
        except BagError as error:
            refused = error
        else:
            outcomes[f"{name}: done"] += 1
            continue
        assert refused.path or "the message that came" in str(refused), f"{name} names no file: {refused}"
        assert len(str(refused)) < 2_000, f"{name} says too much"
        outcomes[f"{name}: {type(refused).__name__}"] += 1
    return outcomes


def _read(path: Path, _: Path) -> None:
    with bag.open(path) as opened:
        for message in (*opened.messages(), *opened.messages(order="published")):
            with contextlib.suppress(BagError):
                assert message.value is not None
        opened.latched(opened.end)


def _beside(path: Path, _: Path) -> None:
    with bag.open(path) as opened:
        assert len(opened.metadata) < 100
        for name in opened.attachments:
            opened.attachment(name)


def _column(path: Path, _: Path) -> None:
    with bag.open(path) as opened:
        opened.column("r1/cmd_vel", "linear.x")


def _info(path: Path, _: Path) -> None:
    bag.info(path, quick=True)
    bag.info(path)


def _check(path: Path, _: Path) -> None:
    bag.check(path)


def _cut(path: Path, whole: Path) -> None:
    other = whole.with_name("part.mcap")
    other.unlink(missing_ok=True)
    bag.cut(path, other, bags.START + 100 * bags.MS, compression="none")


def _recover(path: Path, whole: Path) -> None:
    bag.recover(path, whole)
    with bag.open(whole) as opened:
        assert not opened.faults, opened.faults
        assert sum(1 for _ in opened.messages()) == opened.count
    report = bag.check(whole)
    wrong = [found for found in report.findings if found.kind in (bag.Kind.CUT, bag.Kind.DAMAGED, bag.Kind.INDEX)]
    assert not wrong, wrong


_USES: dict[str, Callable[[Path, Path], None]] = {
    "read": _read, "beside": _beside, "column": _column, "info": _info, "check": _check, "cut": _cut,
    "recover": _recover,
}  # fmt: skip


def _memory() -> int:
    """Of this process, as it is, bytes."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[0]) * resource.getpagesize()


def main() -> None:
    """Make and torture many; the first that goes wrong ends it, and its seed is told."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=200)
    parser.add_argument("--seed", type=int, default=None)
    asked = parser.parse_args()
    seed = asked.seed if asked.seed is not None else random.SystemRandom().randrange(10**9)
    print(f"seed {seed}", flush=True)
    outcomes: Counter[str] = Counter()
    longest = 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = forms(folder)
        unfolding = bombs(whole["chunks"])
        if sys.platform == "linux":
            most = _memory() + MEMORY
            resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))
        for data in (*whole.values(), *unfolding.values()):
            outcomes += torture(folder / "form.mcap", data)
        for number in range(asked.files):
            chance = random.Random(seed + number)
            form = chance.choice(list(whole))
            began = time.monotonic()
            try:
                outcomes += torture(folder / "damaged.mcap", bags.damaged(whole[form], chance))
            except BaseException:
                print(f"--files 1 --seed {seed + number}, of {form}", flush=True)
                raise
            longest = max(longest, time.monotonic() - began)
            assert longest < LONGEST, f"--files 1 --seed {seed + number} took {longest:.1f} s"
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:7,}  {outcome}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"{asked.files} files, peak memory {peak} MB, the longest took {longest:.2f} s")


if __name__ == "__main__":
    main()
