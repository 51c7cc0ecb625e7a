"""What actions say on the network beside their own three types (ROS: action_msgs, unique_identifier_msgs).

An action's three types stand in one class and are named `group/Name_Goal`, `group/Name_Result` and
`group/Name_Feedback`; `robo_messages.example.Fibonacci` is one.
"""

from typing import Annotated, ClassVar

from msgspec import Meta, field

from robo_messages._registry import Message, message, type_name
from robo_messages._types import Int8
from robo_messages.std import Time

GOAL, RESULT, FEEDBACK = "_Goal", "_Result", "_Feedback"
"""How the names of an action's three types end."""


@message("action/UUID")
class UUID(Message):
    """A number that nobody else has."""

    uuid: Annotated[bytes, Meta(min_length=16, max_length=16, extra={"ros": "uint8[16]"})] = bytes(16)
    """16 bytes; in JSON base64."""


@message("action/GoalInfo")
class GoalInfo(Message):
    """Which goal, and since when."""

    goal_id: UUID = field(default_factory=UUID)
    """Chosen by the client."""
    stamp: Time = field(default_factory=Time)
    """When the server took it."""


@message("action/GoalStatus")
class GoalStatus(Message):
    """How far a goal has come."""

    STATUS_UNKNOWN: ClassVar[Int8] = 0
    STATUS_ACCEPTED: ClassVar[Int8] = 1
    STATUS_EXECUTING: ClassVar[Int8] = 2
    STATUS_CANCELING: ClassVar[Int8] = 3
    STATUS_SUCCEEDED: ClassVar[Int8] = 4
    STATUS_CANCELED: ClassVar[Int8] = 5
    STATUS_ABORTED: ClassVar[Int8] = 6

    goal_info: GoalInfo = field(default_factory=GoalInfo)
    """Which goal."""
    status: Int8 = 0
    """One of the above."""


@message("action/GoalStatusArray")
class GoalStatusArray(Message):
    """The goals of an action: all that are under way, and the last ones that have ended."""

    status_list: list[GoalStatus] = []
    """In the order in which they were taken."""


class CancelGoal:
    """Cancel one goal, several or all."""

    @message("action/CancelGoal_Request")
    class Request(Message):
        """An id: that goal. A stamp: those that were taken until then. Both: both. Neither: all."""

        goal_info: GoalInfo = field(default_factory=GoalInfo)
        """Which."""

    @message("action/CancelGoal_Response")
    class Response(Message):
        """What becomes of it."""

        ERROR_NONE: ClassVar[Int8] = 0
        ERROR_REJECTED: ClassVar[Int8] = 1
        ERROR_UNKNOWN_GOAL_ID: ClassVar[Int8] = 2
        ERROR_GOAL_TERMINATED: ClassVar[Int8] = 3

        return_code: Int8 = 0
        """One of the above."""
        goals_canceling: list[GoalInfo] = []
        """Those that are being canceled."""


def action_type_name(goal: type[Message], result: type[Message], feedback: type[Message]) -> str:
    """The name of an action's type, from its three parts: `example/Fibonacci`.

    Raises:
        ValueError: they are not named as one action's.
        UnknownType: one of them was never registered.
    """
    names = type_name(goal), type_name(result), type_name(feedback)
    name = names[0].removesuffix(GOAL)
    if names != (name + GOAL, name + RESULT, name + FEEDBACK):
        wanted = f"{name}{GOAL}, {name}{RESULT} and {name}{FEEDBACK}"
        raise ValueError(f"{', '.join(names)} are not the types of one action; name them {wanted}")
    return name


def parts_of(action_type: str) -> tuple[str, str, str]:
    """The names of an action's goal, result and feedback."""
    return action_type + GOAL, action_type + RESULT, action_type + FEEDBACK
