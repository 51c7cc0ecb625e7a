"""What one who plays a recording tells of itself. Imported when one of its types is asked for."""

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages.std import Time


class GetPlayback:
    """How far a recording is played, and from when to when it goes."""

    @message("playing/GetPlayback_Request")
    class Request(Message):
        """Nothing to say."""

    @message("playing/GetPlayback_Response")
    class Response(Message):
        """Where it is."""

        begin: Time = field(default_factory=Time)
        """Of what is played, as messages have it: since the epoch."""
        end: Time = field(default_factory=Time)
        """Of what is played."""
        position: Time = field(default_factory=Time)
        """How far it has come."""
        rate: float = 0.0
        """Without unit: 1 for as recorded, 0 for as fast as nothing is lost."""
        paused: bool = False
        """Whether it stands."""
