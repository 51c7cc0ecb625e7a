"""What a flight recorder tells, and what it is asked. Imported when one of its types is asked for."""

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages._types import UInt64
from robo_messages.std import Time


@message("flight/Snapshot")
class Snapshot(Message):
    """A file that a flight recorder has written."""

    stamp: Time = field(default_factory=Time)
    """When that happened which it was written for, by the wall clock."""
    file: str = ""
    """Its whole path."""
    host: str = ""
    """The name of the machine that has it."""
    recorder: str = ""
    """The full name of the flight recorder."""
    reasons: list[str] = []
    """Why it was written, the first reason first."""
    nodes: list[str] = []
    """The full names of the nodes that it was written for."""
    begin: Time = field(default_factory=Time)
    """What came from then on is in it."""
    end: Time = field(default_factory=Time)
    """And what came before then."""
    size: UInt64 = 0
    """Of the file, bytes."""


class TakeSnapshot:
    """Ask a flight recorder to write what it has and what comes within seconds; it answers once that is done."""

    @message("flight/TakeSnapshot_Request")
    class Request(Message):
        """Why."""

        reason: str = ""
        """In a few words, for the file and its name; it may be empty."""

    @message("flight/TakeSnapshot_Response")
    class Response(Message):
        """What came of it."""

        success: bool = True
        """Whether there is a file."""
        message: str = ""
        """Why there is none; else which one, in words."""
        snapshot: Snapshot = field(default_factory=Snapshot)
        """The file."""
