"""Files that are cut or damaged, and whole ones made of them."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robo import bag
from robo.bag.mcap import format as mcap
from robo.bag.mcap import packing
from robo.bag.mcap.format import PREFIX
from robo.errors import BagError, DamagedBag
from tests import bags


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A file with many small chunks."""
    path = tmp_path_factory.mktemp("bag") / "drive.mcap"
    bags.drive(path, bag.Options(compression="none", sync=False, chunk_size=700))
    return path.read_bytes()


def messages_before(whole: bytes, end: int) -> int:
    """In the chunks that are whole before a place."""
    found = 0
    for kind, at, after in bags.records_of(whole):
        if kind == mcap.CHUNK and after <= end:
            chunk = mcap.chunk(whole[at + PREFIX.size : after])
            found += sum(1 for _ in mcap.rows(chunk.data))
    return found


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(data=st.data())
def test_a_file_that_is_cut_anywhere_keeps_all_chunks_before(data: st.DataObject, whole: bytes, tmp_path: Path) -> None:
    cut, made = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    made.unlink(missing_ok=True)
    end = data.draw(st.integers(0, len(whole) - 1))
    cut.write_bytes(whole[:end])
    header = next(after for kind, _, after in bags.records_of(whole) if kind == mcap.HEADER)
    if end < header:
        with pytest.raises(DamagedBag):
            bag.recover(cut, made)
        assert not made.exists()
        return
    recovered = bag.recover(cut, made)
    expected = messages_before(whole, end)
    assert recovered.messages == expected
    assert recovered.faults[0].cut
    assert bag.check(made).whole
    with bag.open(made) as opened, bag.open(cut) as before:
        assert not opened.faults
        assert before.faults[0].cut
        assert opened.count == len(list(opened.messages())) == len(list(before.messages())) == expected
        assert opened.metadata == before.metadata
        assert opened.attachments == before.attachments


def test_a_file_that_is_whole_stays_what_it_is(whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(whole)
    recovered = bag.recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert not recovered.faults
    difference = bag.diff(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert difference.same
    assert all(topic.shift == topic.delay == 0 for topic in difference.topics)
    assert bag.check(tmp_path / "b.mcap").findings == []


def test_only_what_is_damaged_is_lost_even_if_a_length_lies(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    chunks = [(at, after) for kind, at, after in bags.records_of(whole) if kind == mcap.CHUNK]
    damaged = bytearray(whole)
    damaged[chunks[3][0] + 1 : chunks[3][0] + 9] = b"\xff" * 8
    damaged[chunks[7][0] + 300] ^= 4
    path.write_bytes(damaged)
    recovered = bag.recover(path, tmp_path / "b.mcap")
    assert [fault.offset for fault in recovered.faults] == [chunks[3][0], chunks[7][0]]
    lost = sum(messages_before(whole, chunks[n][1]) - messages_before(whole, chunks[n][0]) for n in (3, 7))
    assert recovered.messages == 122 - lost
    assert bag.check(tmp_path / "b.mcap").whole


def test_what_a_damaged_chunk_said_of_topics_is_taken_from_the_summary(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    damaged = bytearray(whole)
    for kind, at, after in bags.records_of(whole):
        if kind == mcap.CHUNK and b"geometry_msgs/msg/Twist" in whole[at:after]:
            damaged[after - 1] ^= 1
    path.write_bytes(damaged)
    recovered = bag.recover(path, tmp_path / "b.mcap")
    with bag.open(tmp_path / "b.mcap") as opened:
        assert opened.topic("r1/cmd_vel").count > 90
    assert recovered.messages > 100


def test_a_file_without_chunks_is_recovered_too(whole: bytes, tmp_path: Path) -> None:
    data = bags.without_chunks(whole)
    (tmp_path / "a.mcap").write_bytes(data[: len(data) - 2_000])
    recovered = bag.recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert 100 < recovered.messages < 122
    assert bag.check(tmp_path / "b.mcap").whole


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_chunks_are_copied_as_they_are(compression: str, whole: bytes, tmp_path: Path) -> None:
    if not bags.readable(compression):
        pytest.skip("needs the extra record")
    from tests.hostile_bags import compressors

    data = bags.with_chunks(whole, compression, compressors()[compression])
    (tmp_path / "a.mcap").write_bytes(data[:-100])
    recovered = bag.recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert recovered.messages > 100
    made = (tmp_path / "b.mcap").read_bytes()
    chunks = [mcap.chunk(made[at + 9 : after]) for kind, at, after in bags.records_of(made) if kind == mcap.CHUNK]
    assert {chunk.compression for chunk in chunks[1:]} == {compression}


def test_the_last_file_of_a_folder_is_recovered_with_what_it_says_again(tmp_path: Path) -> None:
    bags.drive(tmp_path / "run", bag.Options(compression="none", sync=False, chunk_size=700, split_duration=0.5))
    last = tmp_path / "run" / "run_1.mcap"
    data = last.read_bytes()
    last.unlink()
    chunks = [after for kind, _, after in bags.records_of(data) if kind == mcap.CHUNK]
    (tmp_path / "cut.mcap").write_bytes(data[: chunks[-2] + 10])
    bag.recover(tmp_path / "cut.mcap", last)
    with bag.open(tmp_path / "run") as opened:
        assert opened.topic("r1/tf_static").count == 2
        assert len(list(opened.messages("r1/tf_static"))) == 2
        assert 110 < opened.count < 122


def test_nothing_is_overwritten_and_nothing_half_made_stays(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(whole)
    with pytest.raises(BagError, match="it is there already"):
        bag.recover(path, path)
    assert path.read_bytes() == whole
    with pytest.raises(BagError, match="cannot be written: No such file"):
        bag.recover(path, tmp_path / "nowhere" / "b.mcap")


def flipped(data: bytes, at: int, bits: int) -> bytes:
    return data[:at] + bytes([data[at] ^ bits]) + data[at + 1 :]


@pytest.mark.parametrize("summary", [True, False])
@pytest.mark.parametrize("bit", range(8))
@pytest.mark.parametrize(
    "kind", [mcap.HEADER, mcap.CHUNK, mcap.MESSAGE_INDEX, mcap.METADATA, mcap.ATTACHMENT, mcap.DATA_END]
)
def test_a_record_that_claims_to_be_another_one_is_lost_alone_and_told(
    kind: int, bit: int, summary: bool, whole: bytes, tmp_path: Path
) -> None:
    if kind == mcap.MESSAGE_INDEX and (bit == 7 if summary else bit == 1):
        pytest.skip("a record that others may use as they like; or one that looks like a message indeed")
    path = tmp_path / "a.mcap"
    data = whole if summary else bags.without_summary(whole)
    places = [(at, after) for one, at, after in bags.records_of(data) if one == kind]
    at, after = places[len(places) // 2]
    path.write_bytes(flipped(data, at, 1 << bit))
    recovered = bag.recover(path, tmp_path / "b.mcap")
    assert recovered.faults
    lost = messages_before(whole, after) - messages_before(whole, at) if kind == mcap.CHUNK else 0
    assert recovered.messages == 122 - lost
    assert bag.check(tmp_path / "b.mcap").whole
    assert not bag.check(path).whole
    assert bag.info(path).faults or (summary and kind != mcap.CHUNK), "who believes the summary needs nothing else"


def test_a_summary_that_is_damaged_costs_no_chunk(whole: bytes, tmp_path: Path) -> None:
    begin = next(after for kind, _, after in bags.records_of(whole) if kind == mcap.DATA_END)
    path = tmp_path / "a.mcap"
    for checked in (True, False):
        data = whole if checked else bags.summary_without_checksum(whole)
        for at in range(begin, len(data) - 8 - 29, 97):
            path.write_bytes(flipped(data, at, 4))
            recovered = bag.recover(path, tmp_path / "b.mcap", force=True)
            assert recovered.messages == 122
            assert recovered.faults or not checked


def test_the_end_of_the_data_is_where_the_summary_begins(whole: bytes, tmp_path: Path) -> None:
    data = bags.without_summary(whole)
    chunks = [at for kind, at, _ in bags.records_of(data) if kind == mcap.CHUNK]
    path = tmp_path / "a.mcap"
    path.write_bytes(data[: chunks[5]] + packing.data_end() + data[chunks[5] :])
    recovered = bag.recover(path, tmp_path / "b.mcap")
    (fault,) = recovered.faults
    assert fault.reason == "the data end here, and something else than the summary follows"


def test_more_definitions_than_a_file_has_are_refused(tmp_path: Path) -> None:
    parts = [packing.schema(mcap.Schema(number, "a/msg/B", "ros2msg", bytes(3_000_000))) for number in range(1, 30)]
    big = packing.schema(mcap.Schema(99, "a/msg/B", "ros2msg", bytes(5_000_000)))
    for number, records in enumerate((b"".join(parts), big)):
        path = tmp_path / f"{number}.mcap"
        chunk = packing.chunk(0, 0, len(records), 0, "", records)
        head = mcap.MAGIC + packing.header(mcap.Header("ros2", "test"))
        path.write_bytes(head + chunk + packing.data_end() + packing.summary([], 0) + mcap.MAGIC)
        with bag.open(path) as opened:
            assert "bytes" in opened.faults[0].reason
