"""Messages as records of data, to print, to store, and to publish again byte for byte. Pure but for the clock."""

import base64
from typing import Any

import msgspec

from robo.errors import MessageError
from robo.interfaces import catalogue
from robo.interfaces.message_input import restored
from robo.samples.stream import Arrival
from robo.wire import codec
from robo.wire.codec import Malformed, jsonable


class Record(msgspec.Struct, frozen=True, omit_defaults=True):
    """One message of a topic: what `robo topic echo --json` prints and `robo topic pub -` reads."""

    key: str
    type: str
    """From the encoding; empty where the publisher does not say."""
    time: int
    """When it was published, ns since the epoch; when it came, where the publisher does not say."""
    sequence_number: int | None
    message: Any
    """Plain data, as JSON can hold them: bytes as base64, NaN and infinities as "nan", "inf", "-inf". None where the
    payload cannot be read."""
    error: str = ""
    """Why it cannot be read."""
    encoding: str = ""
    """Where it is not MessagePack of the type."""
    payload: str = ""
    """The bytes, base64, where `message` does not tell them all: of a client that encodes in its own way."""


class Received(msgspec.Struct, frozen=True):
    """A message as it came, read."""

    arrival: Arrival
    type: str
    message: object
    """Plain data; None where the payload cannot be read."""
    error: str = ""

    @property
    def time(self) -> int:
        """When it was published, ns since the epoch; when it came, where the publisher does not say."""
        attachment = self.arrival.attachment
        return attachment.source_time if attachment is not None else self.arrival.arrived

    @property
    def sequence_number(self) -> int | None:
        """Which message of its publisher it is; None where that does not say."""
        return self.arrival.attachment.sequence_number if self.arrival.attachment is not None else None

    def record(self) -> Record:
        """The message as data that tell every byte of it."""
        plain = jsonable(self.message)
        payload = self.arrival.sample.payload.to_bytes()
        encoding = str(self.arrival.sample.encoding)
        usual = f"{codec.MSGPACK};{self.type}" if self.type else ""
        try:
            exact = not self.error and payload_of(self.type, plain) == payload
        except MessageError:
            exact = False
        return self.view(
            plain,
            encoding="" if encoding == usual else encoding,
            payload="" if exact else base64.b64encode(payload).decode("ascii"),
        )

    def view(self, message: object, *, encoding: str = "", payload: str = "") -> Record:
        """The record with another message in it: a part of it, or a short form."""
        return Record(
            self.arrival.key,
            self.type,
            self.time,
            self.sequence_number,
            jsonable(message),
            self.error,
            encoding,
            payload,
        )


def read(arrival: Arrival) -> Received:
    """A message as plain data, whatever its type."""
    kind, _, schema = str(arrival.sample.encoding).partition(";")
    type_name = schema if kind in (codec.MSGPACK, codec.JSON) else ""
    try:
        return Received(arrival, type_name, codec.decode_any(arrival.sample.payload.to_bytes()))
    except Malformed as reason:
        return Received(arrival, type_name, None, str(reason))


def payload_of(type_name: str, message: object) -> bytes:
    """The MessagePack of a record's message.

    Of types that are not known here, bytes stay base64 and NaN stays text.

    Raises:
        MessageError: the message does not fit its type.
    """
    type_ = catalogue.find_here(type_name)
    return msgspec.msgpack.encode(restored(type_, message) if type_ is not None else message)


def sample_of(record: Record) -> tuple[bytes, str]:
    """Payload and encoding of the message that a record tells of.

    The exact bytes stand in the record where they matter; they count as long as nobody has changed the message
    beside them.

    Raises:
        MessageError: the message does not fit its type, or the record's payload cannot be read.
    """
    encoding = record.encoding or (f"{codec.MSGPACK};{record.type}" if record.type else codec.MSGPACK)
    if record.payload or record.error:
        try:
            payload = base64.b64decode(record.payload, validate=True)
        except ValueError as error:  # also where it is not ASCII
            raise MessageError(f"{record.key}: payload is no base64: {error}") from None
        if record.message is None or _tells(payload, record.message):
            return payload, encoding
    if encoding.partition(";")[0] == codec.JSON:
        return msgspec.json.encode(record.message), encoding
    return payload_of(record.type, record.message), encoding


def _tells(payload: bytes, message: object) -> bool:
    try:
        return jsonable(codec.decode_any(payload)) == message
    except Malformed:
        return False
