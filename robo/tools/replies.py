"""What comes back when many are asked at once: anybody may answer, and in any form."""

import logging
from collections.abc import Iterable, Iterator
from typing import TypeVar

import msgspec
import zenoh

from robo.text.brief import brief, shown
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE

T = TypeVar("T")

_logger = logging.getLogger("robo.tools")


def samples(replies: Iterable[zenoh.Reply]) -> Iterator[zenoh.Sample]:
    """The answers among replies; errors are left out."""
    return (reply.ok for reply in replies if reply.ok is not None)


def read(sample: zenoh.Sample, kind: type[T]) -> T | None:
    """The MessagePack of an answer or a message; None for one that is of no use, which is told once."""
    try:
        return msgspec.msgpack.decode(sample.payload.to_bytes(), type=readable(kind))
    except UNREADABLE as error:
        _tell_once(kind, str(sample.key_expr), str(error))
        return None


_told: set[object] = set()


def _tell_once(kind: object, key: str, why: str) -> None:
    if kind not in _told:
        _told.add(kind)
        what = f"{shown(key, 200)}: {brief(why)}"
        _logger.warning("left out what cannot be read on %s; a stranger's, or of another version of robo?", what)
