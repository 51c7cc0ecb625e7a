"""Types to try things with (ROS: example_interfaces)."""

from robo_messages._registry import Message, message
from robo_messages._types import Int32


class Fibonacci:
    """Count as Fibonacci did: an action."""

    @message("example/Fibonacci_Goal")
    class Goal(Message):
        """How far to count."""

        order: Int32 = 0
        """How many numbers to find after the first two."""

    @message("example/Fibonacci_Result")
    class Result(Message):
        """What was counted."""

        sequence: list[Int32] = []
        """All numbers."""

    @message("example/Fibonacci_Feedback")
    class Feedback(Message):
        """What has been counted so far."""

        sequence: list[Int32] = []
        """The numbers so far."""
