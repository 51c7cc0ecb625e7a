import contextlib

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

import robo_messages
from robo.wire import codec
from robo.wire.codec import Decoder, Malformed, jsonable
from robo_messages import Bool, Twist, Vector3

TWIST = Twist(Vector3(x=0.5), Vector3(z=-1.0))


def decode(payload: bytes, encoding: str = "zenoh/bytes") -> Twist:
    decoder = Decoder(Twist)
    try:
        return decoder.fast(payload)
    except Exception:
        return decoder.decode_other(payload, encoding)


@pytest.mark.parametrize(
    ("payload", "encoding"),
    [
        (robo_messages.encode(TWIST), "application/msgpack;geometry/Twist"),
        (robo_messages.encode(TWIST), "zenoh/bytes"),
        (robo_messages.encode_json(TWIST), "application/json"),
        (robo_messages.encode_json(TWIST), "zenoh/bytes"),
        (b' \n{"linear": {"x": 0.5}, "angular": {"z": -1}}', "text/json"),
    ],
)
def test_msgpack_and_json_are_told_apart_by_themselves(payload: bytes, encoding: str) -> None:
    assert decode(payload, encoding) == TWIST


@pytest.mark.parametrize(
    ("payload", "encoding", "reason"),
    [
        (b"", "zenoh/bytes", "not a geometry/Twist in MessagePack"),
        (b"\xc1\xff\x00", "zenoh/bytes", "not a geometry/Twist in MessagePack"),
        (robo_messages.encode(TWIST)[:-3], "zenoh/bytes", "truncated"),
        (b'{"linear": {"x": "fast"}}', "application/json", r"not a geometry/Twist in JSON: .*linear"),
        (b"{nope", "zenoh/bytes", "in JSON"),
        (robo_messages.encode(Bool(True)), "application/msgpack;std/Bool", "it is a std/Bool, expected geometry/Twist"),
    ],
)
def test_what_is_no_message_gives_a_reason(payload: bytes, encoding: str, reason: str) -> None:
    with pytest.raises(Malformed, match=reason):
        decode(payload, encoding)


@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_malformed(payload: bytes) -> None:
    with contextlib.suppress(Malformed):
        assert isinstance(decode(payload), Twist)


data = st.recursive(
    st.none() | st.booleans() | st.integers(-100, 100) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(data)
def test_plain_data_is_read_back(value: object) -> None:
    assert codec.decode_any(msgpack.packb(value)) == value


def test_plain_data_reads_json_too() -> None:
    assert codec.decode_any(b'{"a": [1]}') == {"a": [1]}
    assert codec.decode_any(b"{") == 123  # MessagePack's number 123
    with pytest.raises(Malformed):
        codec.decode_any(b"\xc1")


@given(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**63), 2**63 - 1), st.binary(max_size=17))
def test_attachments(number: int, time: int, more: bytes) -> None:
    data = codec.pack_attachment(number, time)
    assert len(data) == 16
    assert data == number.to_bytes(8, "little", signed=True) + time.to_bytes(8, "little", signed=True)
    assert codec.unpack_attachment(data + more) == (number, time)
    assert codec.unpack_attachment(data[:15]) is None


def test_what_json_cannot_hold_is_written_as_text() -> None:
    value = {"a": [float("inf"), float("-inf"), float("nan"), 1.5], "b": b"\x00\x01"}
    assert jsonable(value) == {"a": ["inf", "-inf", "nan", 1.5], "b": "AAE="}
