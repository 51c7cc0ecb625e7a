"""Services of whoever plays a recording (ROS: rosbag2_interfaces). Imported when one of its types is asked for."""

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages.std import Time


class Seek:
    """Go to another time of a recording."""

    @message("rosbag2/Seek_Request")
    class Request(Message):
        """Where to."""

        time: Time = field(default_factory=Time)
        """As messages have it when they were recorded: since the epoch."""

    @message("rosbag2/Seek_Response")
    class Response(Message):
        """How it went."""

        success: bool = False
        """Whether this time is within what is played; otherwise it is at its beginning, or at its end."""


class SetRate:
    """Play quicker or slower."""

    @message("rosbag2/SetRate_Request")
    class Request(Message):
        """How fast."""

        rate: float = 0.0
        """Without unit: 1 for as recorded, 2 for twice as fast, 0 for as fast as nothing is lost."""

    @message("rosbag2/SetRate_Response")
    class Response(Message):
        """How it went."""

        success: bool = False
        """Whether it is done."""


class GetRate:
    """How fast a recording is played."""

    @message("rosbag2/GetRate_Request")
    class Request(Message):
        """Nothing to say."""

    @message("rosbag2/GetRate_Response")
    class Response(Message):
        """How fast."""

        rate: float = 0.0
        """Without unit: 1 for as recorded, 0 for as fast as nothing is lost."""


class IsPaused:
    """Whether a player stands."""

    @message("rosbag2/IsPaused_Request")
    class Request(Message):
        """Nothing to say."""

    @message("rosbag2/IsPaused_Response")
    class Response(Message):
        """Whether it does."""

        paused: bool = False
        """True where it stands."""
