"""Time, headers and the plain one-value messages (ROS: builtin_interfaces, std_msgs)."""

import time
from typing import Annotated

from msgspec import Meta, field

from robo_messages._registry import Message, message
from robo_messages._types import Int32

NANOSECONDS = 1_000_000_000


@message("std/Time")
class Time(Message, order=True):
    """A point in time since the Unix epoch, or since the start of a simulation."""

    sec: Int32 = 0
    """Whole seconds."""
    nanosec: Annotated[int, Meta(ge=0, lt=NANOSECONDS, extra={"ros": "uint32"})] = 0
    """Nanoseconds on top, 0 to 999,999,999."""

    @classmethod
    def now(cls) -> "Time":
        """The wall clock's time."""
        return cls.from_nanoseconds(time.time_ns())

    @classmethod
    def from_nanoseconds(cls, nanoseconds: int) -> "Time":
        """From ns since the epoch; a time before it has a negative `sec`, as in ROS."""
        return cls(*divmod(nanoseconds, NANOSECONDS))

    @classmethod
    def from_seconds(cls, seconds: float) -> "Time":
        """From s since the epoch, rounded to the nearest ns that a float can tell."""
        return cls.from_nanoseconds(round(seconds * NANOSECONDS))

    def to_nanoseconds(self) -> int:
        """The time since the epoch, ns."""
        return self.sec * NANOSECONDS + self.nanosec

    def to_seconds(self) -> float:
        """The time since the epoch, s; a float keeps about 0.2 µs of today's times."""
        return self.sec + self.nanosec / NANOSECONDS


@message("std/Duration")
class Duration(Message, order=True):
    """A span of time; negative spans have a negative `sec` and a positive `nanosec`."""

    sec: Int32 = 0
    """Whole seconds."""
    nanosec: Annotated[int, Meta(ge=0, lt=NANOSECONDS, extra={"ros": "uint32"})] = 0
    """Nanoseconds on top, 0 to 999,999,999."""

    @classmethod
    def from_seconds(cls, seconds: float) -> "Duration":
        """From s."""
        return cls(*divmod(round(seconds * NANOSECONDS), NANOSECONDS))

    def to_seconds(self) -> float:
        """The span, s."""
        return self.sec + self.nanosec / NANOSECONDS


@message("std/Header")
class Header(Message):
    """When data were taken and in which coordinate frame they stand (frames: REP-105)."""

    stamp: Time = field(default_factory=Time)
    """When the data were taken."""
    frame_id: str = ""
    """The frame, for example `odom`, `base_link`, `base_laser`."""

    @classmethod
    def now(cls, frame_id: str = "") -> "Header":
        """A header stamped with the wall clock's time."""
        return cls(Time.now(), frame_id)


@message("std/Bool")
class Bool(Message):
    """One truth value."""

    data: bool = False
    """True or false."""


@message("std/String")
class String(Message):
    """One text."""

    data: str = ""
    """The text."""
