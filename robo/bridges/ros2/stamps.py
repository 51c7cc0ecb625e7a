"""What rmw_zenoh says beside each message, request and answer: 33 bytes of attachment. Pure."""

import struct
from typing import NamedTuple

_LAYOUT = struct.Struct("<qqB16s")
SIZE = _LAYOUT.size
"""Bytes."""
_GID = 16
NO_GID = bytes(_GID)


class Stamp(NamedTuple):
    """An attachment."""

    number: int
    """Counts what its sender has sent, from 1."""
    time: int
    """When it was sent, ns since the Unix epoch."""
    gid: bytes
    """16 bytes that name the sender."""

    def packed(self) -> bytes:
        """The 33 bytes."""
        return _LAYOUT.pack(self.number, self.time, _GID, self.gid)


def pack(number: int, time: int, gid: bytes) -> bytes:
    """The 33 bytes of an attachment."""
    return _LAYOUT.pack(number, time, _GID, gid)


def unpack(data: bytes) -> Stamp | None:
    """What an attachment says; None for one that is none of rmw_zenoh's. ROS leaves out messages without one."""
    if len(data) != SIZE:
        return None
    number, time, length, gid = _LAYOUT.unpack(data)
    return Stamp(number, time, gid) if length == _GID and number >= 0 else None
