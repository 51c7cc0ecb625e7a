"""Messages as records that tell every byte."""

import math
from typing import Any

import msgpack
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

import robo_messages
from robo.errors import MessageError
from robo.interfaces.message_input import field_types
from robo.samples.publishing import line_of
from robo.samples.records import read
from robo.samples.stream import Arrival
from robo.wire import codec
from robo.wire.codec import Attachment
from robo_messages import LaserScan, Message, Twist, Vector3
from tests.random_messages import SHIPPED


class FakePayload:
    def __init__(self, data: bytes) -> None:
        self._data = data

    def to_bytes(self) -> bytes:
        return self._data


class FakeSample:
    def __init__(self, payload: bytes, encoding: str) -> None:
        self.payload = FakePayload(payload)
        self.encoding = encoding


def arrival(payload: bytes, encoding: str) -> Arrival:
    sample: Any = FakeSample(payload, encoding)
    return Arrival("r1/x", 7, len(payload), Attachment(3, 5), sample)


def printed(payload: bytes, encoding: str) -> str:
    """What `robo topic echo --json` prints."""
    record = read(arrival(payload, encoding)).record()
    return msgspec.json.encode(codec.jsonable(msgspec.to_builtins(record))).decode()


def encoding(type_: type[Message]) -> str:
    return codec.encoding_of(type_)


def filled(type_: type[Message]) -> Message:
    """A message whose single numbers are not what they are by default."""
    odd = {"float": math.nan, "str": 'ü\n"', "bytes": memoryview(bytes(range(256))), "list of float": [math.inf, -0.0]}
    values = {name: odd[kind] for name, kind in field_types(type_).items() if kind in odd and name != "covariance"}
    fixed = ("covariance", "k", "r", "p")  # matrices, whose length is that of the type
    values = {name: value for name, value in values.items() if not name.endswith(fixed[0]) and name not in fixed}
    return type_(**values)


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_type_is_told_byte_for_byte(name: str) -> None:
    type_ = robo_messages.find_type(name)
    for message in (type_(), filled(type_)):
        payload = robo_messages.encode(message)
        line = printed(payload, encoding(type_))
        record = msgspec.json.decode(line)
        assert {"key", "type", "time", "sequence_number", "message"} == set(record), "the message tells all"
        again = line_of(line, None, None)
        assert (again.payload, again.encoding) == (payload, encoding(type_))
        assert again.origin == (5, 3)


@pytest.mark.parametrize(
    ("payload", "kind"),
    [
        (msgpack.packb({"linear": {"x": 1}}), encoding(Twist)),
        (msgpack.packb({"angular": {"z": 0.5}, "linear": {"x": 0.1}}, use_single_float=True), encoding(Twist)),
        (robo_messages.encode(Vector3(x=-math.nan)), encoding(Vector3)),
        (b'{"linear": {"x":   1}}', "application/json"),
        (b'{"linear": {"x":   1}}', "application/json;geometry/Twist"),
        (msgpack.packb({"data": b"\x00\xff", "t": math.inf}), "application/msgpack;my_robot/Unknown"),
        (msgpack.packb([1, 2]), "application/msgpack"),
        (b"\xc1 no message", "application/msgpack;geometry/Twist"),
        (b"", "zenoh/bytes"),
        (b"\xcd\x00\x01", "zenoh/bytes"),
    ],
)
def test_what_others_encode_in_their_own_way_is_told_byte_for_byte(payload: bytes, kind: str) -> None:
    again = line_of(printed(payload, kind), None, None)
    assert (again.payload, again.encoding) == (payload, kind)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
        max_leaves=20,
    )
)
def test_any_data_are_told_byte_for_byte(value: object) -> None:
    payload = msgpack.packb({"v": value})
    assert line_of(printed(payload, "application/msgpack;x/Y"), None, None).payload == payload


def test_a_changed_message_counts_and_not_the_bytes_beside_it() -> None:
    payload = msgpack.packb({"linear": {"x": 0.25}}, use_single_float=True)
    record = msgspec.json.decode(printed(payload, encoding(Twist)))
    assert record["payload"]
    record["message"]["linear"]["x"] = 0.75
    changed = line_of(msgspec.json.encode(record).decode(), None, None)
    assert msgpack.unpackb(changed.payload) == {"linear": {"x": 0.75}}


def test_lines_may_be_plain_messages() -> None:
    line = line_of('{"ranges": [1.0, "inf"]}', "r1/scan", "sensor/LaserScan")
    assert robo_messages.decode(line.payload, LaserScan).ranges == [1.0, math.inf]
    assert line.encoding == "application/msgpack;sensor/LaserScan"


@pytest.mark.parametrize(
    ("text", "key", "type_name", "message"),
    [
        ("{", "k", "geometry/Twist", "no JSON"),
        ("[1]", "k", "geometry/Twist", "expected an object"),
        ('{"linear": {"q": 1}}', "k", "geometry/Twist", "has no field 'q'"),
        ('{"linear": {}}', None, None, "neither key nor type"),
        ('{"key": 1, "type": "x/Y", "time": 1, "message": {}}', None, None, "no record"),
        (
            '{"key": "k", "type": "std/Bool", "time": 1, "sequence_number": 1, "message": {}}',
            "k",
            "geometry/Twist",
            "k is a std/Bool, not a geometry/Twist",
        ),
        (
            '{"key": "k", "type": "std/Bool", "time": 1, "sequence_number": 1, "message": {}, "payload": "*"}',
            None,
            None,
            "payload is no base64",
        ),
    ],
)
def test_a_line_that_is_none_is_told(text: str, key: str | None, type_name: str | None, message: str) -> None:
    with pytest.raises(MessageError, match=message):
        line_of(text, key, type_name)
