"""Messages to and from what travels in a Zenoh sample: payload, encoding, attachment.

Payload: MessagePack map, encoding `application/msgpack;<type name>`. JSON (`application/json`) is
read as well. Attachment: sequence number and source time, two little-endian int64.
"""

import math
import struct
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import msgspec

import robo_messages
from robo.text.brief import brief
from robo.text.unreadable import UNREADABLE
from robo_messages import Message

M = TypeVar("M", bound=Message)

MSGPACK = "application/msgpack"
JSON = "application/json"

_MOST_QUOTED = 200
"""How much of what somebody sent a reason may hold, characters."""

_ATTACHMENT = struct.Struct("<qq")
pack_attachment = _ATTACHMENT.pack
"""(sequence number, source time in ns since the epoch) to the 16 bytes of an attachment."""


class Attachment(NamedTuple):
    """What a publisher says about a message beside its payload."""

    sequence_number: int
    """Counts the publisher's messages, from 1."""
    source_time: int
    """When it was published, ns since the Unix epoch."""


def unpack_attachment(data: bytes) -> Attachment | None:
    """The attachment's numbers; None where a foreign publisher sent none that can be read.

    Longer attachments are read too: rmw_zenoh's begins with the same 16 bytes.
    """
    if len(data) < _ATTACHMENT.size:
        return None
    return Attachment(*_ATTACHMENT.unpack_from(data))


def encoding_of(type_: type[Message]) -> str:
    """The Zenoh encoding of a message type, for example `application/msgpack;geometry/Twist`.

    Raises:
        robo_messages.UnknownType: the type was never registered.
    """
    return f"{MSGPACK};{robo_messages.type_name(type_)}"


class Malformed(Exception):
    """A payload that is no message of the expected type; the text is the reason."""


class Decoder(Generic[M]):
    """Decodes payloads of one type: of a topic, or of one half of a service.

    `fast` reads MessagePack and costs no more than msgspec itself. What it refuses goes to
    `decode_other`, which reads JSON or says what is wrong. JSON needs no flag to be told apart: a JSON
    object begins with `{`, which MessagePack reads as the number 123 and never as a map.
    """

    def __init__(self, type_: type[M]) -> None:
        self._type = type_
        self.fast: Callable[[bytes], M] = robo_messages.decoder_of(type_).decode

    def decode(self, payload: bytes, encoding: str) -> M:
        """Decode a payload of either form.

        Raises:
            Malformed: the payload is neither MessagePack nor JSON of this type.
        """
        try:
            return self.fast(payload)
        except UNREADABLE:
            return self.decode_other(payload, encoding)

    def decode_other(self, payload: bytes, encoding: str) -> M:
        """Decode what `fast` refused.

        Raises:
            Malformed: the payload is neither MessagePack nor JSON of this type.
        """
        kind, _, schema = encoding.partition(";")
        is_json = kind in (JSON, "text/json") or payload.lstrip()[:1] == b"{"
        try:
            if is_json:
                return robo_messages.decode_json(payload, self._type)
            return self.fast(payload)
        except UNREADABLE as error:
            expected = robo_messages.type_name(self._type)
            if schema and schema != expected:
                raise Malformed(f"it is a {brief(schema, _MOST_QUOTED)}, expected {expected}") from None
            form = "JSON" if is_json else "MessagePack"
            # The error may quote a name of a field, which may be as long as the payload.
            raise Malformed(f"not a {expected} in {form}: {brief(str(error), _MOST_QUOTED)}") from None


def decode_any(payload: bytes) -> object:
    """A payload of unknown type as plain data (dicts, lists, numbers, text, bytes).

    Raises:
        Malformed: it is neither MessagePack nor JSON.
    """
    if payload.lstrip()[:1] in (b"{", b"["):
        try:
            return msgspec.json.decode(payload)
        except UNREADABLE:
            pass  # a MessagePack number may begin with the same byte
    try:
        return msgspec.msgpack.decode(payload)
    except UNREADABLE as error:
        raise Malformed(f"neither MessagePack nor JSON: {brief(str(error), _MOST_QUOTED)}") from None


def jsonable(value: object) -> object:
    """Plain data as JSON can hold it: bytes as base64, NaN and infinities as "nan", "inf", "-inf"."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, dict):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [jsonable(item) for item in value]
    if isinstance(value, (bytes, memoryview)):
        import base64  # nodes carry it only if they need it

        return base64.b64encode(value).decode("ascii")
    return value
