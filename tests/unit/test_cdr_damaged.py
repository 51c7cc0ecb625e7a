"""Bytes that are no CDR, or that somebody has damaged: a message or an error, and never much memory."""

import random
import tracemalloc
from collections.abc import Iterator
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

import robo_messages
from robo.errors import MessageError
from robo.interfaces.cdr import decoder, encoder
from robo.interfaces.cdr_faults import decode_fault, encode_fault
from robo.interfaces.ros_shape import shape_of
from robo_messages import (
    Bool,
    CameraInfo,
    DiagnosticStatus,
    Header,
    Image,
    JointState,
    LaserScan,
    Message,
    Odometry,
    Parameter,
    ParameterEvent,
    Path,
    PointCloud2,
    PoseArray,
    PoseStamped,
    Time,
    Trigger,
)
from tests.random_messages import SHIPPED as ALL

HEAD = b"\x00\x01\x00\x00"
HOSTILE = (0, 1, 2, 0x7F, 0xFF, 0x7FFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFC, 0xFFFFFFFF)


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Bytes that somebody has damaged, or made to do damage."""
    found = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        at = rng.randrange(len(found)) if found else 0
        match rng.randrange(6):
            case 0 if found:
                found[at] ^= 1 << rng.randrange(8)
            case 1:
                del found[at:]
            case 2:
                del found[at : at + rng.randrange(9)]
            case 3:
                found[at:at] = rng.randbytes(rng.randrange(9))
            case 4:
                at -= at % 4
                found[at : at + 4] = rng.choice(HOSTILE).to_bytes(4, "little")
            case 5:
                found[at : at + 8] = rng.randbytes(8)
    return bytes(found)


def samples(rng: random.Random) -> Iterator[tuple[type[Message], bytes]]:
    """A few messages of each type, most with something in their lists."""
    for name in ALL:
        type_ = robo_messages.find_type(name)
        yield type_, encoder(type_)(type_())
    pose = PoseStamped(Header(Time(1, 2), "odom"))
    image = Image(Header(), 10, 10, "mono8", 0, 10, memoryview(rng.randbytes(100)))
    fields = [robo_messages.PointField("x", 0, 7, 1)] * 3
    full: list[Message] = [
        Path(pose.header, [pose] * 5),
        image,
        Odometry(pose.header, "base_link"),
        LaserScan(pose.header, ranges=[1.0] * 30, intensities=[2.0] * 30),
        JointState(pose.header, ["left", "right"], [1.0, 2.0], [], [3.0]),
        PointCloud2(pose.header, 1, 9, fields, False, 4, 36, memoryview(bytes(36)), True),
        PoseArray(pose.header, [pose.pose] * 4),
        DiagnosticStatus(1, "n", "m", "h", [robo_messages.KeyValue("k", "v")] * 3),
        ParameterEvent(Time(), "/n", [], [Parameter("a", [1.0]), Parameter("b", {"x": 1}), Parameter("c", ["t"])]),
        CameraInfo(pose.header, d=[0.1] * 5),
        robo_messages.MarkerArray([robo_messages.Marker(pose.header, text="hi", points=[robo_messages.Point()] * 3)]),
    ]
    for message in full * 8:
        yield type(message), encoder(type(message))(message)


def test_damaged_bytes_are_a_message_or_an_error_that_names_the_type() -> None:
    seed = random.randrange(2**32)
    rng = random.Random(seed)
    wells = list(samples(rng))
    for number in range(10_000):
        type_, well = wells[number % len(wells)]
        data = mutated(well, rng)
        where = f"seed {seed}, number {number}: {type_.__name__} of {data.hex()}"
        try:
            message = decoder(type_)(data)
        except MessageError as error:
            said = str(error)
        except BaseException as error:
            raise AssertionError(where) from error
        else:
            said = ""
        if said:
            assert said.startswith(robo_messages.type_name(type_)), where
            assert "it is no message of this type" not in said, where
        else:
            said = str(decode_fault(shape_of(type_), data, ValueError("well")))
            assert said == f"{robo_messages.type_name(type_)}: well", where
            with suppress(MessageError):
                encoder(type_)(message)


@pytest.mark.parametrize("name", ALL)
def test_hostile_lengths_take_no_memory(name: str) -> None:
    type_ = robo_messages.find_type(name)
    rng = random.Random(name)
    tracemalloc.start()
    try:
        for fill in (b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x40\x00\x00", b"\x01\x00\x00\x00", b""):
            data = HEAD + (fill * 16_384 if fill else rng.randbytes(65_536))
            tracemalloc.reset_peak()
            with suppress(MessageError):
                decoder(type_)(data)
            assert tracemalloc.get_traced_memory()[1] < 40 * len(data)
    finally:
        tracemalloc.stop()


def test_an_odd_fault_is_told_all_the_same() -> None:
    assert str(encode_fault(shape_of(Bool), Bool(True), ValueError("odd"))) == "std/Bool: odd"
    assert str(encode_fault(shape_of(Bool), Bool(True), ValueError())) == "std/Bool: it does not fit into CDR"


@given(st.binary(max_size=64))
def test_any_bytes_are_a_message_or_an_error(data: bytes) -> None:
    for type_ in (Path, Parameter, JointState, Trigger.Response):
        with suppress(MessageError):
            decoder(type_)(data)
        with suppress(MessageError):
            decoder(type_)(HEAD + data)
