"""Navigation as actions (ROS: nav2_msgs, of Kilted and later). Imported when one of its types is asked for."""

from typing import Annotated, ClassVar

from msgspec import Meta, field

from robo_messages._registry import Message, message
from robo_messages._types import UInt8, UInt16, UInt32
from robo_messages.geometry import PoseStamped


@message("nav2/WaypointStatus")
class WaypointStatus(Message):
    """What became of one waypoint."""

    PENDING: ClassVar[int] = 0
    COMPLETED: ClassVar[int] = 1
    SKIPPED: ClassVar[int] = 2
    FAILED: ClassVar[int] = 3

    waypoint_status: UInt8 = 0
    """PENDING, COMPLETED, SKIPPED or FAILED."""
    waypoint_index: UInt32 = 0
    """Its number in the goal, from 0."""
    waypoint_pose: PoseStamped = field(default_factory=PoseStamped)
    """Where it is, m."""
    error_code: UInt16 = 0
    """Why, as in the result of the action."""
    error_msg: str = ""
    """Why, in words."""


class FollowWaypoints:
    """Drive to one pose after the other: an action."""

    @message("nav2/FollowWaypoints_Goal")
    class Goal(Message):
        """Where to."""

        number_of_loops: UInt32 = 0
        """How often all of it is repeated after the first time."""
        goal_index: UInt32 = 0
        """The number of the pose to begin with, from 0."""
        poses: list[PoseStamped] = []
        """In the order in which they are to be reached, m."""

    @message("nav2/FollowWaypoints_Result")
    class Result(Message):
        """How it ended."""

        NONE: ClassVar[Annotated[int, Meta(extra={"ros": "uint16"})]] = 0
        UNKNOWN: ClassVar[Annotated[int, Meta(extra={"ros": "uint16"})]] = 600
        TASK_EXECUTOR_FAILED: ClassVar[Annotated[int, Meta(extra={"ros": "uint16"})]] = 601
        NO_VALID_WAYPOINTS: ClassVar[Annotated[int, Meta(extra={"ros": "uint16"})]] = 602
        STOP_ON_MISSED_WAYPOINT: ClassVar[Annotated[int, Meta(extra={"ros": "uint16"})]] = 603

        missed_waypoints: list[WaypointStatus] = []
        """Those that were given up."""
        error_code: UInt16 = 0
        """NONE, or why it did not go well."""
        error_msg: str = ""
        """Why, in words."""

    @message("nav2/FollowWaypoints_Feedback")
    class Feedback(Message):
        """How far it is."""

        current_waypoint: UInt32 = 0
        """The number of the pose that is next, from 0."""
