"""Large messages into shared memory: laid out once, the bytes last, and written where the receiver reads them."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar, get_type_hints

import msgspec
import zenoh

from robo.node.shapes import BYTES, holds
from robo.wire import shared_buffers, shared_memory
from robo.wire.shared_buffers import LARGE, SharedMemory
from robo_messages import Message

M = TypeVar("M", bound=Message)

_EMPTY = b"\xc4\x00"
"""No bytes, in MessagePack."""


class Carrier(Generic[M]):
    """Puts the large messages of one publisher into shared memory.

    A message whose bulk is one field is never encoded as a whole: its other fields are, then its bytes are copied
    behind them. Any other one, of several pictures, is encoded and copied.
    """

    def __init__(self, message_type: type[M], memory: SharedMemory, *, wait: bool) -> None:
        """`wait` says whether a reader that is slow slows the publisher down."""
        self._memory = memory
        self._wait = wait
        self._encode = msgspec.msgpack.Encoder().encode
        self._bulk = _bulk_field(message_type)
        if self._bulk is None:
            return
        keys = dict(zip(message_type.__struct_fields__, message_type.__struct_encode_fields__, strict=True))
        # A map of up to 15 fields begins with one byte, which says how many there are, a larger one with three.
        count = len(keys)
        self._start = bytes([0x80 | count]) if count < 16 else b"\xde" + count.to_bytes(2, "big")
        self._others = [(name, self._encode(key)) for name, key in keys.items() if name != self._bulk]
        self._last = self._encode(keys[self._bulk])

    def __call__(self, message: M, check: Callable[[bytes], int]) -> Any:
        """A message in shared memory, as Zenoh sends it; None of one that is not large, or where there is no memory.

        Args:
            message: of the carrier's type.
            check: looks at the message encoded without its bytes.
        """
        if self._bulk is None:
            return self._whole(message, check)
        data: Any = getattr(message, self._bulk)
        if not isinstance(data, BYTES):
            return None  # what is wrong with it is found where it is encoded
        view = memoryview(data)
        if view.nbytes < LARGE or not view.c_contiguous or view.nbytes >= 2**32:
            return None
        head = self._start + b"".join([key + self._encode(getattr(message, name)) for name, key in self._others])
        head += self._last
        check(head + _EMPTY)
        head += b"\xc6" + view.nbytes.to_bytes(4, "big")
        buffer = self._memory.buffer(len(head) + view.nbytes, wait=self._wait)
        if buffer is not None:
            shared_buffers.fill(buffer, head, view.cast("B"))
        return buffer

    def _whole(self, message: M, check: Callable[[bytes], int]) -> Any:
        payload = self._encode(message)
        if len(payload) < LARGE:
            return None
        check(payload)
        buffer = self._memory.buffer(len(payload), wait=self._wait)
        if buffer is not None:
            buffer[:] = payload
        return buffer


def carrier_of(session: zenoh.Session, message_type: type[M], *, wait: bool) -> Carrier[M] | None:
    """What carries the large messages of a publisher; None where shared memory is off."""
    memory = shared_memory.of_session(session)
    return Carrier(message_type, memory, wait=wait) if memory is not None else None


def _bulk_field(message_type: type[Message]) -> str | None:
    """The one field of bytes; None where there are others, or the type is not laid out as a map of all its fields."""
    config = message_type.__struct_config__
    if config.array_like or config.omit_defaults or config.tag is not None:
        return None
    hints = get_type_hints(message_type)
    bulks = [name for name in message_type.__struct_fields__ if holds(hints[name], BYTES)]
    return bulks[0] if len(bulks) == 1 and hints[bulks[0]] in BYTES else None
