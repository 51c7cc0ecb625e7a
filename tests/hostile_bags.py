"""Damaged recordings through everything that reads them: only errors of robo's, and a bounded memory.

One seed is one file. As a program it makes many and tells what came out; with a file that keeps what is done it goes on
where it was, so that many are done in short pieces:

    python -m tests.hostile_bags --files 10000
    python -m tests.hostile_bags --files 500 --done done.txt
"""

import argparse
import contextlib
import gzip
import random
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from robo import bag
from robo.bag.forms.from_carmen import from_carmen
from robo.bag.forms.from_csv import from_csv
from robo.bag.forms.json_lines import from_json_lines, to_json_lines
from robo.bag.forms.to_csv import to_csv
from robo.bag.look.series import series
from robo.bag.mcap import format as mcap
from robo.bag.mcap.compression import restored
from robo.bag.of_robot import robots_of
from robo.bag.progress import silent
from robo.bag.read.reader import Order
from robo.cli.views.pictures import panels_of
from robo.errors import BagError, UsageError
from robo.recording.map.picture import as_svg
from robo.recording.map.sources import Wanted, walk_of
from robo.recording.play.tape import BagTape, Ready
from robo.recording.play.topics import Choice, select
from robo.text.patterns import chosen
from robo.text.svg import curves
from tests import bags

MEMORY = 2**30
"""What the process may ask for beyond what it has before the first file, bytes: 1 GB."""
LONGEST = 20.0
"""That one file may take, s of the processor: a machine may be busy."""


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
    from robo.bag.mcap import compression

    found = {}
    if (zstd := compression._module(compression._ZSTD)) is not None:
        found["zstd"] = zstd.compress
    if (lz4 := compression._module("lz4.frame")) is not None:
        found["lz4"] = lz4.compress
    return found


def texts(folder: Path) -> dict[str, bytes]:
    """Whole files in other forms."""
    bags.drive(folder / "whole.mcap", count=20)
    with bag.open(folder / "whole.mcap") as opened:
        to_json_lines(opened, folder / "whole.jsonl")
        to_csv(opened, folder / "whole.csv", wanted="r1/scan".__eq__)
    log = b"PARAM robot_frontlaser_offset 0.25 nohost 0\n" + b"".join(
        b"ODOM 1.5 -2 0.5 0.3 0.1 0 %d host 10.5\nFLASER 3 1.0 2.5 81.83 9 9 9 8 8 8 %d.5 host 12.25\n"
        % (number, number)
        for number in range(20)
    )
    return {
        "jsonl": (folder / "whole.jsonl").read_bytes(),
        "csv": (folder / "whole.csv").read_bytes(),
        "log": log,
        "log.gz": gzip.compress(log, mtime=0),
    }


def torture(path: Path, data: bytes) -> Counter[str]:
    """Everything that reads recordings, on one file; what came out, by name.

    Raises:
        Exception: anything that is no error of robo's with the file's name in it.
    """
    return _torture(path, data, _USES)


def torture_text(path: Path, data: bytes, form: str) -> Counter[str]:
    """What makes a recording of another form, on one file; as `torture`."""
    return _torture(path.with_name(f"damaged.{form}"), data, {f"from {form}": _FROM[form]})


def _torture(path: Path, data: bytes, uses: dict[str, Callable[[Path, Path], None]]) -> Counter[str]:
    path.write_bytes(data)
    whole = path.with_name("whole.mcap")
    outcomes: Counter[str] = Counter()
    for name, use in uses.items():
        whole.unlink(missing_ok=True)
        try:
            use(path, whole)
        except UsageError:
            outcomes[f"{name}: UsageError"] += 1
            continue
        except BagError as error:
            refused = error
        else:
            outcomes[f"{name}: done"] += 1
            continue
        assert refused.path or "the message that came" in str(refused), f"{name} names no file: {refused}"
        assert len(str(refused)) < 2_000, f"{name} says too much"
        assert not whole.exists(), f"{name} leaves half a file"
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
    bag.cut(path, whole, bags.START + 100 * bags.MS, compression="none")
    _is_whole(whole)


def _filter(path: Path, whole: Path) -> None:
    with bag.open(path) as opened:
        try:
            wanted = chosen(opened.topics, ["**"], ["**/scan"])
        except UsageError as error:  # there is no topic
            raise BagError(str(error), str(path)) from None
    bag.keep(path, whole, wanted, "none")
    _is_whole(whole)


def _merge(path: Path, whole: Path) -> None:
    bag.merge([path, path.with_name("plain.mcap")], whole, "none")
    _is_whole(whole)


def _diff(path: Path, _: Path) -> None:
    bag.diff(path, path.with_name("plain.mcap"))
    assert bag.diff(path, path).same


def _play(path: Path, _: Path) -> None:
    order: Order = "published" if path.stat().st_size % 2 else "arrived"
    with bag.open(path) as opened:
        chosen = select(opened.topics, Choice(robot="r2"), str(path), robots_of(opened))
        tape = BagTape(opened, chosen.played, order)
        for at in (tape.begin, (tape.begin + tape.end) // 2):
            for item in tape.run(at):
                assert isinstance(item.what, Ready)


def _each_topic(path: Path, _: Path) -> None:
    """What is read of one topic is what all of them say of it."""
    with bag.open(path) as opened:
        counts = Counter(message.topic.name for message in opened.messages())
        assert opened.count == sum(counts.values()), "a file counts what it has not"
        for name in opened.topics:
            assert sum(1 for _ in opened.messages(name)) == counts[name], name


def _is_whole(path: Path) -> None:
    with bag.open(path) as opened:
        assert not opened.faults, opened.faults
        assert sum(1 for _ in opened.messages()) == opened.count


Said = list[tuple[str, int, int, int, bytes]]


def _said(path: Path) -> Said:
    with bag.open(path) as opened:
        return sorted((one.topic.name, one.arrived, one.published, one.sequence, one.data)
                      for one in opened.messages())  # fmt: skip


def _lines(path: Path, whole: Path) -> None:
    lines = path.with_name("lines.jsonl")
    with bag.open(path) as opened:
        to_json_lines(opened, lines, force=True)
    assert not lines.exists() or lines.stat().st_size < 2**28
    from_json_lines(lines, whole, "none")
    assert _said(whole) == _said(path), "a line is not what the recording says"


def _table(path: Path, whole: Path) -> None:
    folder = path.with_name("tables")
    shutil.rmtree(folder, ignore_errors=True)
    try:
        with bag.open(path) as opened:
            to_csv(opened, folder)
    except BagError:
        assert not folder.exists(), "half a folder is left"
        raise
    from_csv(folder, whole, "none")
    _is_whole(whole)


def _curves(path: Path, _: Path) -> None:
    with bag.open(path) as opened:
        found = series(opened, [name for name, topic in opened.topics.items() if topic.known], []).series
    curves("all", panels_of(found), "s")


def _map(path: Path, _: Path) -> None:
    assert len(as_svg(walk_of(str(path), Wanted(), silent), path.name, "auto")) < 2_000_000


def _recover(path: Path, whole: Path) -> None:
    bag.recover(path, whole)
    _is_whole(whole)
    report = bag.check(whole)
    wrong = [found for found in report.findings if found.kind in (bag.Kind.CUT, bag.Kind.DAMAGED, bag.Kind.INDEX)]
    assert not wrong, wrong


_USES: dict[str, Callable[[Path, Path], None]] = {
    "read": _read, "beside": _beside, "column": _column, "info": _info, "check": _check, "cut": _cut,
    "filter": _filter, "merge": _merge, "diff": _diff, "lines": _lines, "table": _table, "recover": _recover,
    "play": _play, "each topic": _each_topic, "curves": _curves, "map": _map,
}  # fmt: skip


def _from_lines(path: Path, whole: Path) -> None:
    from_json_lines(path, whole, "none")
    _is_whole(whole)


def _from_table(path: Path, whole: Path) -> None:
    from_csv(path, whole, "none")
    _is_whole(whole)


def _from_log(path: Path, whole: Path) -> None:
    from_carmen(path, whole, None, "none")
    _is_whole(whole)


_FROM: dict[str, Callable[[Path, Path], None]] = {
    "jsonl": _from_lines, "csv": _from_table, "log": _from_log, "log.gz": _from_log,
}  # fmt: skip


def damaged_text(data: bytes, chance: random.Random) -> bytes:
    """A text as a bad disk or a hostile hand leaves it."""
    for _ in range(chance.choice((1, 1, 2, 8))):
        at = chance.randrange(len(data) + 1)
        how = chance.randrange(5)
        if how == 0:
            data = data[:at]
        elif how == 1:
            data = data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :]
        elif how == 2:
            data = data[:at] + chance.choice(_HOSTILE) + data[at + chance.randrange(20) :]
        elif how == 3:
            data = data[:at] + chance.choice(_HOSTILE) * chance.choice((2, 1_000)) + data[at:]
        else:
            lines = data.split(b"\n")
            lines.insert(chance.randrange(len(lines) + 1), chance.choice(lines))
            data = b"\n".join(lines)
    return data


_HOSTILE = (
    b'"', b",", b"\n", b"\r", b"\0", b"[", b"{", b"}", b"null", b"NaN", b"-1", b"1e999", b"99999999999999999999999",
    b"\xff", b"\xe2\x80\xae", b"true", b'""', b'{"a":', b" ",
)  # fmt: skip


def flip_one(path: Path, data: bytes, chance: random.Random) -> None:
    """One bit of a file is another one: at most its own chunk is lost, and never in silence.

    Raises:
        AssertionError: more is lost, or nobody says so.
    """
    at, bit = chance.randrange(8, len(data) - 8), chance.randrange(8)
    if chance.random() < 0.5:  # what a record is, and how long, are few bytes of all
        _, begin, _ = chance.choice(list(bags.records_of(data)))
        at = begin + chance.randrange(9)
    path.write_bytes(data)
    before = Counter(_said(path))
    checked = not _is_unchecked(data)
    path.write_bytes(data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :])
    whole = path.with_name("whole.mcap")
    whole.unlink(missing_ok=True)
    try:
        recovered = bag.recover(path, whole)
    except BagError:
        return  # it says so, and makes nothing
    after = Counter(_said(whole))
    lost = before - after
    if not recovered.faults:
        silent = lost.total() if checked else before.total() - after.total()  # else what is changed cannot be seen
        assert silent <= 0, f"byte {at}, bit {bit}: {silent} messages are lost in silence"
    elif (most := _most_within(data, at)) is not None:
        assert lost.total() <= most, f"byte {at}, bit {bit}: {lost.total()} messages are lost, not {most}"


def _is_unchecked(data: bytes) -> bool:
    """Whether messages stand where they have no checksum."""
    for kind, begin, end in bags.records_of(data):
        if kind == mcap.MESSAGE or (kind == mcap.CHUNK and not mcap.chunk(data[begin + 9 : end]).crc):
            return True
    return False


def _most_within(data: bytes, at: int) -> int | None:
    """How many messages the chunk around a byte has; None where the file does not say where the others are."""
    kinds = {kind for kind, _, _ in bags.records_of(data)}
    if mcap.CHUNK_INDEX not in kinds:
        return None
    for kind, begin, end in bags.records_of(data):
        if begin <= at < end and kind == mcap.CHUNK:
            chunk = mcap.chunk(data[begin + 9 : end])
            return sum(1 for _ in mcap.rows(restored(chunk.compression, chunk.data, chunk.size)))
    return 0


def _memory() -> int:
    """Of this process, as it is, bytes."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[0]) * resource.getpagesize()


def main() -> None:
    """Make and torture many; the first that goes wrong ends it, and its seed is told."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=200, help="how many")
    parser.add_argument("--seed", type=int, default=None, help="of the first; those that follow are counted on")
    parser.add_argument("--done", type=Path, default=None, help="go on where this file says, and add to it")
    asked = parser.parse_args()
    seed, before = _begin(asked.seed, asked.done)
    print(f"seed {seed}", flush=True)
    outcomes: Counter[str] = Counter()
    longest = 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = forms(folder)
        other = texts(folder)
        unfolding = bombs(whole["chunks"]) if not before else {}
        if sys.platform == "linux":
            most = _memory() + MEMORY
            resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))
        for data in (*whole.values(), *unfolding.values()):
            outcomes += torture(folder / "form.mcap", data)
        for number in range(seed, seed + asked.files):
            chance = random.Random(number)
            began = time.process_time()
            try:
                form = chance.choice(list(whole))
                outcomes += torture(folder / "damaged.mcap", bags.damaged(whole[form], chance))
                form = chance.choice(list(whole))
                flip_one(folder / "flipped.mcap", whole[form], chance)
                form = chance.choice(list(other))
                outcomes += torture_text(folder / "damaged", damaged_text(other[form], chance), form)
            except BaseException:
                print(f"--files 1 --seed {number}, of {form}", flush=True)
                raise
            longest = max(longest, time.process_time() - began)
            assert longest < LONGEST, f"--files 1 --seed {number} took {longest:.1f} s"
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:7,}  {outcome}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"{asked.files} files, peak memory {peak} MB, the longest took {longest:.2f} s")
    if asked.done is not None:
        with asked.done.open("a") as file:
            file.write(f"{seed} {asked.files}\n")
        print(f"{before + asked.files:,} files are done in all: {asked.done}")


def _begin(seed: int | None, done: Path | None) -> tuple[int, int]:
    """The first seed, and how many files were done before."""
    if done is None or not done.exists():
        return seed if seed is not None else 0 if done is not None else random.SystemRandom().randrange(10**9), 0
    pieces = [tuple(map(int, line.split())) for line in done.read_text().splitlines()]
    return seed if seed is not None else max(sum(piece) for piece in pieces), sum(files for _, files in pieces)


if __name__ == "__main__":
    main()
