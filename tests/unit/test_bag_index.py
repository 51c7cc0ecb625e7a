"""Indexes that are not what the file is: nothing is left out in silence."""

import struct
import zlib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from robo import bag
from robo.bag.mcap import format as mcap
from robo.bag.mcap import packing
from robo.errors import DamagedBag
from tests import bags
from tests.bags import MS, START


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A file with many small chunks."""
    path = tmp_path_factory.mktemp("bag") / "drive.mcap"
    bags.drive(path, bag.Options(compression="none", sync=False, chunk_size=700))
    return path.read_bytes()


def with_index(whole: bytes, change: Callable[[mcap.ChunkIndex], mcap.ChunkIndex]) -> bytes:
    """A file with other words about its chunks, and a checksum."""

    def changed(kind: int, content: bytes) -> bytes:
        return packing.chunk_index(change(mcap.chunk_index(content)))[9:] if kind == mcap.CHUNK_INDEX else content

    return bags.with_summary_changed(whole, changed)


def without_channel(index: mcap.ChunkIndex) -> mcap.ChunkIndex:
    return msgspec.structs.replace(index, channels={one: at for one, at in index.channels.items() if one != 2})


def other_times(index: mcap.ChunkIndex) -> mcap.ChunkIndex:
    return msgspec.structs.replace(index, end=index.begin)


def test_the_file_is_whole_without_changes(whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(with_index(whole, lambda index: index))
    assert bag.check(tmp_path / "a.mcap").findings == []


@pytest.mark.parametrize("change", [without_channel, other_times])
def test_an_index_that_lies_is_told_whatever_is_read(
    change: Callable[[mcap.ChunkIndex], mcap.ChunkIndex], whole: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(with_index(whole, change))
    with bag.open(path) as opened:
        assert not opened.faults
        for names in (None, ["r1/cmd_vel"], ["r1/cmd_vel", "r1/scan"]):
            with pytest.raises(DamagedBag):
                list(opened.messages(names))
    (found,) = bag.check(path).findings
    assert found.kind == bag.Kind.INDEX
    assert bag.info(path).count == 122
    bag.recover(path, tmp_path / "b.mcap")
    assert bag.check(tmp_path / "b.mcap").findings == []


def test_a_topic_that_an_index_leaves_out_altogether_is_told(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(with_index(whole, without_channel))
    with (
        bag.open(path) as opened,
        pytest.raises(DamagedBag, match=r"its index leaves out .* messages; `robo bag recover`"),
    ):
        list(opened.messages("r1/cmd_vel"))


def test_messages_beside_chunks_are_read(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    loose = bags.message(2, 101, START + 5_000 * MS, START, bags.twist(9))
    end = next(at for kind, at, _ in bags.records_of(whole) if kind == mcap.DATA_END)

    def shifted(kind: int, content: bytes) -> bytes:
        if kind != mcap.STATISTICS:
            return content
        (count,) = struct.unpack_from("<Q", content)
        at = content.index(struct.pack("<HQ", 2, 100))
        return struct.pack("<Q", count + 1) + content[8:at] + struct.pack("<HQ", 2, 101) + content[at + 10 :]

    changed = bags.with_summary_changed(whole, shifted)
    summary = bags.with_summary_changed(changed[:end] + loose + changed[end:], lambda _, content: content)
    path.write_bytes(summary)
    with bag.open(path) as opened:
        assert not opened.faults
        assert opened.count == len(list(opened.messages())) == 123
        assert len(list(opened.messages("r1/cmd_vel"))) == 101


def test_a_summary_that_counts_nothing_by_topic_is_no_empty_file(whole: bytes, tmp_path: Path) -> None:
    def uncounted(kind: int, content: bytes) -> bytes:
        return content[: 8 + 2 + 4 * 4 + 16] + bytes(4) if kind == mcap.STATISTICS else content

    path = tmp_path / "a.mcap"
    path.write_bytes(bags.with_summary_changed(whole, uncounted))
    with bag.open(path) as opened:
        assert opened.count == len(list(opened.messages())) == 122
    assert bag.check(path).findings == []


def test_one_record_is_not_named_many_times(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = bags.with_summary_changed(whole, lambda _, content: content)
    begin = next(end for kind, _, end in bags.records_of(data) if kind == mcap.DATA_END)
    parts = []
    for kind, at, end in bags.records_of(data):
        if at >= begin and kind not in (mcap.FOOTER, mcap.SUMMARY_OFFSET):
            parts += [(kind, data[at:end])] * (1_000 if kind == mcap.METADATA_INDEX else 1)
    path.write_bytes(data[:begin] + packing.summary(parts, begin) + mcap.MAGIC)
    with bag.open(path) as opened:
        assert [fault.reason for fault in opened.faults] == [
            "the index says that something is here, where it cannot be"
        ]
        assert len(list(opened.all_metadata())) == 2


def test_an_attachment_that_no_memory_holds_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.bag.mcap.source.MOST_ATTACHMENT", 60)
    path = tmp_path / "a.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        recording.attach("small", b"x", "text/plain", START)
        recording.attach("large", bytes(1_000), "text/plain", START)
    with bag.open(path) as opened:
        assert opened.attachment("small") == b"x"
        with pytest.raises(DamagedBag, match=r"an attachment has .* bytes, and at most 60 are read"):
            opened.attachment("large")
    assert len(bag.recover(path, tmp_path / "b.mcap").faults) == 1


def test_an_index_of_messages_that_lies_is_told_and_mended(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    indexes = [(at, end) for kind, at, end in bags.records_of(whole) if kind == mcap.MESSAGE_INDEX]
    begin, end = next((at, end) for at, end in indexes if end - at > 9 + 6 + 16)
    time, channel = begin + 9 + 6, begin + 9
    for at in (time, channel):
        changed = bytearray(whole)
        changed[at] ^= 1
        path.write_bytes(changed)
        (found,) = bag.check(path).findings
        assert found.kind == bag.Kind.INDEX
        assert "an index " in found.text
        bag.recover(path, tmp_path / "b.mcap", force=True)
        assert bag.check(tmp_path / "b.mcap").findings == []
    last, after = next(second for first, second in pairwise(indexes) if first[1] == second[0])
    path.write_bytes(whole[:last] + packing._record(0x90, bytes(after - last - 9)) + whole[after:])
    (found,) = bag.check(path).findings
    assert "an index leaves out a topic of the chunk" in found.text
    entries = [whole[at : at + 16] for at in range(time, end, 16)]
    path.write_bytes(whole[:time] + b"".join(reversed(entries)) + whole[end:])
    assert bag.check(path).findings == [], "in another order it says the same"


@pytest.mark.parametrize(("bits", "wrong"), [(0, False), (4, True)])
def test_a_checksum_of_the_data_is_looked_at(bits: int, wrong: bool, whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    at = next(at for kind, at, _ in bags.records_of(whole) if kind == mcap.DATA_END)
    path.write_bytes(whole[: at + 9] + struct.pack("<I", zlib.crc32(whole[:at]) ^ bits) + whole[at + 13 :])
    assert [found.text for found in bag.check(path).findings] == [
        f"{path}: the data have another checksum than the file says"
    ] * wrong
