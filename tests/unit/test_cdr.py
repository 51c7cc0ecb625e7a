"""Messages as CDR: the bytes, what they hold, and what is said of those that are wrong."""

import math
import struct
import tracemalloc
from typing import Any

import pytest
from hypothesis import given, settings
from msgspec import field

import robo_messages
from robo.errors import MessageError
from robo.interfaces.cdr import decoder, encoder
from robo_messages import (
    UUID,
    BatteryState,
    Bool,
    CameraInfo,
    DiagnosticStatus,
    Empty,
    Float32MultiArray,
    Header,
    Image,
    Int8,
    JointState,
    LaserScan,
    Message,
    Parameter,
    ParameterEvent,
    Path,
    Polygon,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    String,
    Time,
    Trigger,
    Twist,
    UInt64,
    Vector3,
)
from robo_messages.scans import LaserScanArray
from tests.random_messages import SHIPPED as ALL
from tests.random_messages import messages, rounded

HEAD = b"\x00\x01\x00\x00"


def same(one: Message, other: Message) -> bool:
    """Whether two messages are equal, NaN being equal to NaN."""
    return type(one) is type(other) and robo_messages.encode(one) == robo_messages.encode(other)


@pytest.mark.parametrize("name", ALL)
def test_what_is_read_is_what_was_written(name: str) -> None:
    type_ = robo_messages.find_type(name)

    @settings(max_examples=25, deadline=None, database=None)
    @given(messages(type_))
    def check(message: Message) -> None:
        data = encoder(type_)(message)
        expected = rounded(message)
        assert same(decoder(type_)(data), expected)
        assert same(decoder(type_)(memoryview(b"12345" + data)[5:]), expected), "wherever it lies"
        assert same(decoder(type_)(data + b"more"), expected), "what follows is left alone"
        assert encoder(type_)(expected) == data

    check()


GOLDEN = [
    (Empty(), b"\0"),
    (Bool(True), b"\1"),
    (Int8(-2), b"\xfe"),
    (UInt64(2**64 - 1), b"\xff" * 8),
    (String("aä"), b"\4\0\0\0a\xc3\xa4\0"),
    (String(""), b"\1\0\0\0\0"),
    (Time(-1, 999_999_999), struct.pack("<iI", -1, 999_999_999)),
    (Twist(Vector3(1.0, 2.0, 3.0), Vector3(4.0, 5.0, -0.0)), struct.pack("<6d", 1, 2, 3, 4, 5, -0.0)),
    (Header(Time(1, 2), "abcd"), struct.pack("<iII", 1, 2, 5) + b"abcd\0"),
    (UUID(bytes(range(16))), bytes(range(16))),
    (Trigger.Response(True, "x"), b"\1\0\0\0\2\0\0\0x\0"),
    (  # a gap before the first number of eight bytes, and none where there is no number
        JointState(Header(frame_id="abcd"), [], [1.0], [], [2.0]),
        struct.pack("<iII5s3xI I4xd I I d", 0, 0, 5, b"abcd\0", 0, 1, 1.0, 0, 1, 2.0),
    ),
    (
        JointState(Header(), ["a", "bc"], [1.0], [], [2.0]),
        struct.pack("<iII1s3xI I2s2xI3sx Id I I d", 0, 0, 1, b"\0", 2, 2, b"a\0", 3, b"bc\0", 1, 1.0, 0, 1, 2.0),
    ),
    (  # numbers that lie alike begin at a multiple of their own size
        Polygon([robo_messages.Point32(1.0, 2.0, 3.0), robo_messages.Point32(z=4.0)]),
        struct.pack("<I6f", 2, 1, 2, 3, 0, 0, 4),
    ),
    (PoseArray(Header(), []), struct.pack("<iII1s3xI", 0, 0, 1, b"\0", 0)),
    (
        Parameter("p", [1, -1]),
        struct.pack("<I2sBB", 2, b"p\0", 7, 0)
        + struct.pack("<qdI1s3xI I I4xqq I I", 0, 0.0, 1, b"\0", 0, 0, 2, 1, -1, 0, 0),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("message", "data"), GOLDEN, ids=lambda value: type(value).__name__)
def test_these_bytes_are_those_of_ros(message: Message, data: bytes) -> None:
    assert encoder(type(message))(message) == HEAD + data
    assert decoder(type(message))(HEAD + data) == message


def test_an_empty_message_within_another_is_a_byte() -> None:
    @robo_messages.message("test_cdr/Holder")
    class Holder(Message):
        nothing: Empty = field(default_factory=Empty)
        many: list[Empty] = field(default_factory=list)
        number: float = 0.0

    data = encoder(Holder)(Holder(many=[Empty()] * 3, number=1.0))
    assert data == HEAD + struct.pack("<BxxxI3x5xd", 0, 3, 1.0)
    assert decoder(Holder)(data) == Holder(many=[Empty()] * 3, number=1.0)


def test_the_higher_byte_may_come_first() -> None:
    data = b"\0\0\0\0" + struct.pack(">iII4sxxxI", 1, 2, 4, b"odo\0", 7)[:16]
    assert decoder(Header)(data) == Header(Time(1, 2), "odo")
    scan = b"\0\0\0\0" + struct.pack(">iII1s3x7fI2fI", 0, 0, 1, b"\0", 1, 2, 3, 4, 5, 6, 7, 2, 1.5, math.inf, 0)
    seven = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0
    assert decoder(LaserScan)(scan) == LaserScan(Header(), *seven, [1.5, math.inf], [])
    expected = LaserScanArray(Header(), *seven, *packed([1.5, math.inf]))
    assert same(decoder(LaserScanArray)(scan), expected)
    points = b"\0\0\0\0" + struct.pack(">iII1s3xI4x7d", 0, 0, 1, b"\0", 1, *range(7))
    assert decoder(PoseArray)(points).poses[0].orientation.w == 6.0
    assert_refused(decoder(Header), data[:-1], "std/Header.frame_id: cut short: 4 bytes are wanted, and 3 are left")


def packed(values: list[float]) -> list[Any]:
    """As `LaserScanArray` has its ranges, and no intensities."""
    import numpy as np

    scan = LaserScanArray()
    scan.ranges = np.array(values, np.float32)
    return [scan.packed_ranges, scan.packed_intensities]


@pytest.mark.parametrize("values", [[], [1.5, math.inf, -math.inf, 0.1], [math.nan, 1e-45]])
def test_a_scan_as_an_array_is_the_same_bytes(values: list[float]) -> None:
    plain = LaserScan(Header(Time(1, 2), "laser"), -1.0, 1.0, ranges=values, intensities=[])
    data = encoder(LaserScan)(plain)
    as_array = robo_messages.decode(robo_messages.encode(plain), LaserScanArray)
    assert encoder(LaserScanArray)(as_array) == data
    assert encoder(LaserScanArray)(decoder(LaserScanArray)(data)) == data
    assert same(robo_messages.decode(robo_messages.encode(decoder(LaserScanArray)(data)), LaserScan), rounded(plain))


def test_bulk_data_are_not_copied_when_read_and_once_when_written() -> None:
    image = Image(data=memoryview(bytes(5_000_000)))
    tracemalloc.start()
    try:
        data = encoder(Image)(image)
        assert tracemalloc.get_traced_memory()[1] < 5_500_000
        tracemalloc.reset_peak()
        there = decoder(Image)(data)
        assert tracemalloc.get_traced_memory()[1] < 5_500_000
    finally:
        tracemalloc.stop()
    assert there.data.obj is data
    assert decoder(Image)(memoryview(data)).data.obj is data


def with_covariance(count: int) -> PoseWithCovariance:
    message = PoseWithCovariance()
    message.covariance = (0.0,) * count
    return message


def with_last(message: Any, attribute: str, value: object) -> Any:
    setattr(message, attribute, value)
    return message


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (LaserScan(ranges=[1.0, 1e39]), r"sensor/LaserScan.ranges\[1\]: float 1e\+39 is beyond float32"),
        (BatteryState(voltage=-4e38), r"sensor/BatteryState.voltage: float -4e\+38 is beyond float32"),
        (Twist(angular=Vector3(y=10**400)), r"geometry/Twist.angular.y: int 1000.* is beyond float64"),
        (Int8(128), "std/Int8.data: expected int from -128 to 127, got int 128"),
        (UInt64(-1), "std/UInt64.data: expected int from 0 to 18446744073709551615, got int -1"),
        (Time(0, 10**9), "std/Time.nanosec: expected int from 0 to 999999999, got int 1000000000"),
        (DiagnosticStatus(level=4), "diagnostic/DiagnosticStatus.level: expected int from 0 to 3, got int 4"),
        (robo_messages.Int32(data=1.5), "std/Int32.data: expected int from .*, got float 1.5"),  # type: ignore[arg-type]
        (Bool("no"), "std/Bool.data: expected true or false, got str 'no'"),  # type: ignore[arg-type]
        (Bool(1), "std/Bool.data: expected true or false, got int 1"),  # type: ignore[arg-type]
        (Header(frame_id="a\0b"), "std/Header.frame_id: a text in CDR ends at its first NUL, and .* has one within"),
        (String("\ud800"), "std/String.data: .* is no Unicode text: surrogates not allowed"),
        (String(b"x"), "std/String.data: expected a text, got bytes .*"),  # type: ignore[arg-type]
        (JointState(name=["a", "\0"]), r"sensor/JointState.name\[1\]: a text in CDR ends at its first NUL, .*"),
        (JointState(effort=[1.0, "2"]), r"sensor/JointState.effort\[1\]: expected a number, got str .*"),  # type: ignore[list-item]
        (JointState(effort=None), "sensor/JointState.effort: expected a list, got NoneType None"),  # type: ignore[arg-type]
        (with_covariance(35), "geometry/PoseWithCovariance.covariance: expected 36 elements, got 35"),
        (with_last(CameraInfo(), "p", (0.0,) * 9), "sensor/CameraInfo.p: expected 12 elements, got 9"),
        (UUID(b"short"), "action/UUID.uuid: expected 16 elements, got 5"),
        (Path(poses=[PoseStamped(), Twist()]), r"nav/Path.poses\[1\]: expected geometry/PoseStamped, got Twist .*"),  # type: ignore[list-item]
        (PoseArray(poses=[None]), r"geometry/PoseArray.poses\[0\]: expected geometry/Pose, got NoneType None"),  # type: ignore[list-item]
        (Image(data="text"), "sensor/Image.data: expected bytes, got str .*"),  # type: ignore[arg-type]
        (Image(data=memoryview(b"abcd")[::2]), "sensor/Image.data: its bytes do not lie side by side; .*"),
        (Parameter("p", 2**63), "system/Parameter.value.integer_value: expected int from .*"),
        (ParameterEvent(new_parameters=[Parameter("p", object())]),
         r"system/ParameterEvent.new_parameters\[0\].value: .*"),
    ],
)  # fmt: skip
def test_a_message_that_does_not_fit_is_refused_by_its_field(message: Message, said: str) -> None:
    with pytest.raises(MessageError, match=rf"^{said}$") as caught:
        encoder(type(message))(message)
    assert caught.value.__suppress_context__


def test_a_message_of_another_type_is_refused() -> None:
    with pytest.raises(MessageError, match=r"^geometry/Twist: expected geometry/Twist, got String "):
        encoder(Twist)(String("x"))  # type: ignore[arg-type]


def test_a_scan_as_an_array_is_refused_beyond_float32() -> None:
    scan = LaserScanArray()
    scan.ranges = [1.0, 1e39]
    with pytest.raises(MessageError, match=r"^sensor/LaserScan.ranges: a number is beyond float32$"):
        encoder(LaserScanArray)(scan)


def assert_refused(read: Any, data: bytes, said: str) -> None:
    with pytest.raises(MessageError) as caught:
        read(data)
    assert str(caught.value) == said


@pytest.mark.parametrize(
    ("type_", "data", "said"),
    [
        (Twist, b"", "geometry/Twist: no CDR: 0 bytes, and its head alone has 4"),
        (Twist, b"\0\7\0\0" + bytes(48), "geometry/Twist: no CDR as ROS writes it: it begins with 00 07"),
        (Twist, b"\x82\xa6linear", "geometry/Twist: no CDR as ROS writes it: it begins with 82 a6"),
        (Twist, HEAD + bytes(47), "geometry/Twist.angular.z: cut short: 8 bytes are wanted, and 7 are left"),
        (String, HEAD + b"\3\0\0\0a\xff\0", "std/String.data: no UTF-8: invalid start byte at byte 1 of 3"),
        (String, HEAD + b"\2\0\0\0ab",
         "std/String.data: a text ends with NUL and has none within, unlike 'ab'"),
        (String, HEAD + b"\4\0\0\0a\0b\0",
         "std/String.data: a text ends with NUL and has none within, unlike 'a\\x00b\\x00'"),
        (String, HEAD + b"\xff\xff\xff\xffabc\0",
         "std/String.data: cut short: 4294967295 bytes are wanted, and 4 are left"),
        (Float32MultiArray, HEAD + struct.pack("<III", 0, 0, 2**32 - 1) + bytes(8),
         "std/Float32MultiArray.data: 4294967295 elements do not fit into the 8 bytes that are left"),
        (PoseArray, HEAD + struct.pack("<iII4sI", 0, 0, 1, b"\0", 2**31),
         "geometry/PoseArray.poses: 2147483648 elements do not fit into the 0 bytes that are left"),
        (Image, HEAD + struct.pack("<iII4sIII1sB2xII", 0, 0, 1, b"\0", 1, 1, 1, b"\0", 0, 1, 2**31) + b"x",
         "sensor/Image.data: cut short: 2147483648 bytes are wanted, and 1 are left"),
        (Time, HEAD + struct.pack("<iI", 0, 10**9),
         "std/Time.nanosec: expected int from 0 to 999999999, got 1000000000"),
        (Parameter, HEAD + b"\1\0\0\0\0\x0b" + bytes(60),
         "system/Parameter.value: a ParameterValue of type 11; 0 to 9 are known"),
    ],
)  # fmt: skip
def test_bytes_that_are_no_message_are_refused_by_the_field(type_: type[Message], data: bytes, said: str) -> None:
    assert_refused(decoder(type_), data, said)


def test_a_text_without_its_nul_may_be_empty() -> None:
    assert decoder(String)(HEAD + b"\0\0\0\0") == String("")


def test_what_is_no_bytes_is_no_fault_of_the_data() -> None:
    with pytest.raises(TypeError, match="bytes-like"):
        decoder(Twist)("text")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "value",
    [None, True, False, 0, -(2**63), 0.5, math.inf, "", "text", b"bytes", [True, False], [1, 2], [0.5], ["a", ""], []],
)
def test_a_parameter_keeps_its_type(value: object) -> None:
    back = decoder(Parameter)(encoder(Parameter)(Parameter("p", value)))
    assert back == Parameter("p", value)
    assert type(back.value) is type(value)


@pytest.mark.parametrize(
    ("value", "said"), [({"a": [1]}, '{"a":[1]}'), ([1, "a"], '[1,"a"]'), ([[1.0], math.nan], '[[1.0],"nan"]')]
)
def test_a_parameter_that_ros_has_no_type_for_is_told_as_json(value: object, said: str) -> None:
    assert decoder(Parameter)(encoder(Parameter)(Parameter("p", value))).value == said
