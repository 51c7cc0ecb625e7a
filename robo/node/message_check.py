"""Whether a message is what its type says, found where it is published: encoding alone does not look.

Decoding each message again would cost half as much as publishing it. A value of another type nearly always takes
another number of bytes, so that only the first message is looked at and those whose size differs from
the one before; large ones at most once a second.
"""

import time
from typing import Generic, TypeVar

import msgspec

import robo_messages
from robo_messages import Message

M = TypeVar("M", bound=Message)

LARGE = 4096
"""Bytes from which on a message is checked at most once in PERIOD."""

PERIOD = 1.0
"""How long a large message goes unchecked after another one, s."""


class MessageCheck(Generic[M]):
    """Checks the messages of one publisher."""

    def __init__(self, message_type: type[M], topic: str) -> None:
        self._type = message_type
        self._topic = topic
        self._decode: msgspec.msgpack.Decoder[M] | None = None  # made when it is needed: publishers may never publish
        self._next = 0.0

    def __call__(self, payload: bytes) -> int:
        """Look at an encoded message.

        Returns:
            Its size, for the caller, who need not ask again for messages of the same size.

        Raises:
            TypeError: a field holds what its type does not allow; says which.
        """
        size, now = len(payload), time.monotonic()
        if size >= LARGE and now < self._next:
            return size
        self._next = now + PERIOD
        if self._decode is None:
            self._decode = robo_messages.decoder_of(self._type)
        try:
            self._decode.decode(payload)
        except msgspec.ValidationError as error:
            what, _, where = str(error).replace("`", "").partition(" - at $.")
            field = where or "a field"
            name = robo_messages.type_name(self._type)
            raise TypeError(f"{self._topic}: {field} of {name}: {what[:1].lower()}{what[1:]}") from None
        return size
