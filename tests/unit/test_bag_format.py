"""The bytes of MCAP files: what is packed is read again, and nothing is read beyond the end."""

import struct
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from robo.bag.definitions import differs
from robo.bag.look.losses import Losses
from robo.bag.mcap import format as mcap
from robo.bag.mcap import packing
from robo.bag.mcap.compression import MOST, CannotRestore, compressor, restored
from robo.bag.mcap.format import PREFIX, Malformed, rows
from robo.bag.offered import OFFERED, publishers_of, qos_of, words_of
from robo.wire.qos import KEEP_ALL, QoS
from tests import bags

u16 = st.integers(1, 2**16 - 1)
u32 = st.integers(0, 2**32 - 1)
u64 = st.integers(0, 2**64 - 1)
text = st.text(max_size=20)
words = st.dictionaries(text, text, max_size=5)
numbers = st.dictionaries(u16, u64, max_size=5)

RECORDS: dict[str, tuple[st.SearchStrategy[Any], Callable[[Any], bytes], Callable[[bytes], Any]]] = {
    "header": (st.builds(mcap.Header, text, text), packing.header, mcap.header),
    "schema": (st.builds(mcap.Schema, u16, text, text, st.binary()), packing.schema, mcap.schema),
    "channel": (st.builds(mcap.Channel, u16, u16, text, text, words), packing.channel, mcap.channel),
    "chunk index": (
        st.builds(mcap.ChunkIndex, u64, u64, u64, u64, numbers, u64, text, u64, u64),
        packing.chunk_index,
        mcap.chunk_index,
    ),
    "attachment index": (
        st.builds(mcap.AttachmentIndex, u64, u64, u64, u64, u64, text, text),
        packing.attachment_index,
        mcap.attachment_index,
    ),
    "metadata": (st.builds(mcap.Metadata, text, words), packing.metadata, mcap.metadata),
    "metadata index": (st.builds(mcap.MetadataIndex, u64, u64, text), packing.metadata_index, mcap.metadata_index),
    "statistics": (
        st.builds(mcap.Statistics, u64, u16, u32, u32, u32, u32, u64, u64, numbers),
        packing.statistics,
        mcap.statistics,
    ),
}


@pytest.mark.parametrize("kind", RECORDS)
@given(data=st.data())
def test_what_is_packed_is_read_again_and_nothing_less_will_do(kind: str, data: st.DataObject) -> None:
    records, pack, parse = RECORDS[kind]
    record = data.draw(records)
    packed = pack(record)
    assert PREFIX.unpack_from(packed)[1] == len(packed) - PREFIX.size
    content = packed[PREFIX.size :]
    assert parse(content) == record
    if content:
        with pytest.raises(Malformed):
            parse(content[: data.draw(st.integers(0, len(content) - 1))])


@given(st.lists(st.tuples(u16, u32, u64, u64, st.binary(max_size=30)), max_size=10))
def test_messages_of_a_block_come_with_their_places(messages: list[tuple[int, int, int, int, bytes]]) -> None:
    data = b"".join(bags.message(*message) for message in messages)
    found = [(row.channel, row.sequence, row.arrived, row.published, data[row.begin : row.end]) for row in rows(data)]
    assert found == messages


def test_other_records_of_a_block_are_told() -> None:
    schema = mcap.Schema(1, "a/msg/B", "ros2msg", b"")
    told: list[tuple[int, bytes]] = []
    block = packing.schema(schema) + bags.message(1, 2, 3, 4, b"x")
    assert len(list(rows(block, lambda kind, content: told.append((kind, bytes(content)))))) == 1
    assert [(kind, mcap.schema(content)) for kind, content in told] == [(mcap.SCHEMA, schema)]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (bags.message(1, 2, 3, 4, b"x")[:-1], "claims 23 bytes, and 22 are left"),
        (bags.message(1, 2, 3, 4, b"")[:5], "too few for a record"),
        (struct.pack("<BQ", mcap.MESSAGE, 21) + bytes(21), "too short for its head"),
        (struct.pack("<BQ", mcap.MESSAGE, 2**64 - 1) + bytes(21), "claims 18,446,744,073,709,551,615 bytes"),
        (bytes(9), "of no kind"),
    ],
)
def test_a_block_that_makes_no_sense_says_so(data: bytes, reason: str) -> None:
    with pytest.raises(Malformed, match=reason):
        list(rows(data))


def test_an_attachment_is_what_its_checksum_says() -> None:
    packed = packing.attachment(1, 2, "map.yaml", "text/yaml", b"image: map.png")[PREFIX.size :]
    assert mcap.attachment(packed).data == b"image: map.png"
    at = packed.index(b"image")
    with pytest.raises(Malformed, match=r"'map\.yaml' has another checksum"):
        mcap.attachment(packed[:at] + b"I" + packed[at + 1 :])


def test_a_map_of_too_many_words_is_refused() -> None:
    many = packing.metadata(mcap.Metadata("many", {str(number): "" for number in range(10_001)}))
    with pytest.raises(Malformed, match="more than 10,000 words"):
        mcap.metadata(many[PREFIX.size :])


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_is_restored_to_the_size_that_it_says_and_no_other(compression: str) -> None:
    if not bags.readable(compression):
        pytest.skip("needs the extra record")
    from tests.hostile_bags import compressors

    packed = memoryview(compressors()[compression](bytes(100_000)))
    assert restored(compression, packed, 100_000) == bytes(100_000)
    with pytest.raises(Malformed, match="claims 99,999 bytes and holds more"):
        restored(compression, packed, 99_999)
    with pytest.raises(Malformed, match="claims 100,001 bytes and holds 100,000"):
        restored(compression, packed, 100_001)
    with pytest.raises(Malformed, match="at most 268,435,456"):
        restored(compression, packed, MOST + 1)
    with pytest.raises(Malformed):
        restored(compression, memoryview(b"no such thing"), 10)


def test_of_an_unknown_compression_is_told() -> None:
    with pytest.raises(CannotRestore, match="compressed as 'br'; robo reads zstd and lz4"):
        restored("br", memoryview(b""), 0)


def test_a_library_that_is_missing_is_told_with_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    from robo.bag.mcap import compression
    from robo.errors import BagError

    monkeypatch.setattr(compression, "_module", lambda _: None)
    with pytest.raises(BagError, match=r"pip install 'robo-zenoh\[record\]'"):
        compressor("zstd")
    for name in ("zstd", "lz4"):
        with pytest.raises(CannotRestore, match=r"pip install 'robo-zenoh\[record\]'"):
            restored(name, memoryview(b""), 0)
    assert compressor("none") == ("", None)
    assert restored("", memoryview(b"abc"), 3) == b"abc"


QOS = st.builds(
    QoS,
    depth=st.integers(1, 1000),
    latched=st.booleans(),
    deadline=st.none() | st.sampled_from([0.1, 2.5]),
    priority=st.sampled_from(["data", "background"]),
)


@given(QOS)
@example(QoS(depth=KEEP_ALL))
def test_what_publishers_offer_is_read_again(qos: QoS) -> None:
    assert qos_of(words_of(qos)) == qos
    as_ros = qos_of({OFFERED: words_of(qos)[OFFERED]})
    assert (as_ros.depth, as_ros.latched) == (qos.depth, qos.latched)


def test_what_publishers_of_older_recordings_offer_is_understood() -> None:
    humble = "- history: 1\n  depth: 3\n  reliability: 1\n  durability: 1\n"
    assert qos_of({OFFERED: humble}) == QoS(depth=3, latched=True)
    assert qos_of({OFFERED: humble.replace("durability: 1", "durability: 2")}) == QoS(depth=3)
    assert qos_of({OFFERED: humble.replace("history: 1", "history: 2")}) == QoS(depth=KEEP_ALL, latched=True)
    assert qos_of({OFFERED: humble.replace("history: 1", "history: 3").replace("3\n  r", "0\n  r")}) == QoS(
        depth=1, latched=True
    )
    assert publishers_of({OFFERED: humble * 3}) == 3
    assert publishers_of({}) == publishers_of({OFFERED: ""}) == 1
    assert qos_of({OFFERED: ""}) == QoS.DEFAULT
    assert qos_of({}) == QoS.DEFAULT


RULER = "=" * 80
TWIST = f"Vector3 linear\nVector3 angular\n{RULER}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
SAME_TWIST = f"""# A command.
geometry_msgs/Vector3  linear  # m/s
geometry_msgs/msg/Vector3 angular
int8 CONSTANT=3
{RULER}
MSG: geometry_msgs/msg/Vector3
float64 x 1.5
float64 y
float64 z
"""


def test_definitions_are_the_same_whatever_is_said_beside_the_fields() -> None:
    assert differs("geometry_msgs/msg/Twist", SAME_TWIST, TWIST) == ""
    header = f"{RULER}\nMSG: std_msgs/Header\nstring frame_id\n"
    assert differs("a/msg/B", f"byte[<=5] d\nHeader h\n{header}", f"uint8[] d\nstd_msgs/Header h\n{header}") == ""
    assert differs("a/msg/B", "string<=10 name\n", "string name\n") == ""


@pytest.mark.parametrize(
    ("theirs", "reason"),
    [
        (TWIST.replace("float64 z", "float32 z"), "geometry_msgs/Vector3 has float32 z where robo has float64 z"),
        (TWIST.replace("Vector3 angular", "Vector3 turning"), "geometry_msgs/Twist has geometry_msgs/Vector3 turning"),
        (TWIST + "float64 w\n", "geometry_msgs/Vector3 has float64 w in the file only"),
        (TWIST.replace("float64 z\n", ""), "geometry_msgs/Vector3 has float64 z in robo only"),
        (TWIST.partition("=")[0], "geometry_msgs/Vector3 is defined in one of them only"),
        ("", "geometry_msgs/Twist has geometry_msgs/Vector3 linear in robo only"),
    ],
)
def test_definitions_that_differ_are_told_with_the_place(theirs: str, reason: str) -> None:
    assert reason in differs("geometry_msgs/msg/Twist", theirs, TWIST)


@given(st.integers(1, 2**40), st.lists(st.integers(1, 10), min_size=1, max_size=50))
@example(2**32 - 3, [1, 1, 1, 1, 1, 1])
@example(2**32 - 3, [1, 1, 7, 1])
def test_losses_are_exact_from_the_last_32_bits_of_the_numbers(first: int, steps: list[int]) -> None:
    assume(first % 2**32)  # a first number 0 says that nobody counts
    losses = Losses()
    number, published = first, 0
    losses.add(number % 2**32, published)
    for step in steps:
        number += step
        published += step * 1000
        losses.add(number % 2**32, published)
    assert losses.lost == number - first - len(steps)


def test_where_nobody_counts_nothing_is_lost() -> None:
    losses = Losses()
    for at in range(5):
        losses.add(0, at)
    assert (losses.lost, losses.counted) == (0, 0)
