"""Points, poses, velocities and transforms (ROS: geometry_msgs). SI units, REP-103 axes:
right-handed, x forward, y left, z up; yaw counter-clockwise from +x.
"""

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages._types import ZEROS_6X6, Covariance6, check_length
from robo_messages.std import Header


@message("geometry/Vector3")
class Vector3(Message):
    """A free vector; its unit is that of the field that holds it."""

    x: float = 0.0
    """Along x, in the unit of the field that holds the vector."""
    y: float = 0.0
    """Along y, the same."""
    z: float = 0.0
    """Along z, the same."""


@message("geometry/Point")
class Point(Message):
    """A position, m."""

    x: float = 0.0
    """Forward, m."""
    y: float = 0.0
    """To the left, m."""
    z: float = 0.0
    """Up, m."""


@message("geometry/Quaternion")
class Quaternion(Message):
    """An orientation as a unit quaternion; the default is the identity."""

    x: float = 0.0
    """x of the turn's axis times sin(a / 2), where a is its angle; without unit."""
    y: float = 0.0
    """The same of y."""
    z: float = 0.0
    """The same of z."""
    w: float = 1.0
    """cos(a / 2)."""


@message("geometry/Pose")
class Pose(Message):
    """Position (m) and orientation."""

    position: Point = field(default_factory=Point)
    """m."""
    orientation: Quaternion = field(default_factory=Quaternion)
    """The turn from the frame's axes to its own."""


@message("geometry/PoseStamped")
class PoseStamped(Message):
    """A pose in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the pose."""
    pose: Pose = field(default_factory=Pose)
    """m."""


@message("geometry/PoseWithCovariance")
class PoseWithCovariance(Message):
    """A pose and how sure it is."""

    pose: Pose = field(default_factory=Pose)
    """The most likely one, m."""
    covariance: Covariance6 = ZEROS_6X6
    """36 numbers, 6x6 row-major over (x, y, z, rotation about x, y, z); m², m·rad, rad²."""

    def __post_init__(self) -> None:
        check_length("PoseWithCovariance", "covariance", self.covariance, 36)


@message("geometry/Twist")
class Twist(Message):
    """A velocity."""

    linear: Vector3 = field(default_factory=Vector3)
    """m/s."""
    angular: Vector3 = field(default_factory=Vector3)
    """rad/s."""


@message("geometry/TwistStamped")
class TwistStamped(Message):
    """A velocity in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the velocity."""
    twist: Twist = field(default_factory=Twist)
    """m/s and rad/s."""


@message("geometry/TwistWithCovariance")
class TwistWithCovariance(Message):
    """A velocity and how sure it is."""

    twist: Twist = field(default_factory=Twist)
    """The most likely one, m/s and rad/s."""
    covariance: Covariance6 = ZEROS_6X6
    """36 numbers, 6x6 row-major over (x, y, z, rotation about x, y, z); m²/s², m·rad/s², rad²/s²."""

    def __post_init__(self) -> None:
        check_length("TwistWithCovariance", "covariance", self.covariance, 36)


@message("geometry/Transform")
class Transform(Message):
    """From the child frame to the parent frame."""

    translation: Vector3 = field(default_factory=Vector3)
    """m."""
    rotation: Quaternion = field(default_factory=Quaternion)
    """The turn from the parent's axes to the child's."""


@message("geometry/TransformStamped")
class TransformStamped(Message):
    """Where `child_frame_id` stands in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """Its `frame_id` is the parent frame."""
    child_frame_id: str = ""
    """The child frame."""
    transform: Transform = field(default_factory=Transform)
    """m."""
