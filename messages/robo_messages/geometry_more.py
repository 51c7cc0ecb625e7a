"""Points, polygons, forces and poses that fewer nodes need (ROS: geometry_msgs). Units and axes as in `geometry`.

Imported when one of its types is asked for.
"""

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages._types import Float32
from robo_messages.geometry import Point, Pose, PoseWithCovariance, Quaternion, TwistWithCovariance, Vector3
from robo_messages.std import Header


@message("geometry/PointStamped")
class PointStamped(Message):
    """A position in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the position."""
    point: Point = field(default_factory=Point)
    """m."""


@message("geometry/Vector3Stamped")
class Vector3Stamped(Message):
    """A free vector in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the vector."""
    vector: Vector3 = field(default_factory=Vector3)
    """In the unit that the topic says."""


@message("geometry/QuaternionStamped")
class QuaternionStamped(Message):
    """An orientation in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the orientation."""
    quaternion: Quaternion = field(default_factory=Quaternion)
    """The orientation."""


@message("geometry/PoseArray")
class PoseArray(Message):
    """Poses in one frame at one time, for example the particles of a filter."""

    header: Header = field(default_factory=Header)
    """The frame and time of all poses."""
    poses: list[Pose] = []
    """m, in any order."""


@message("geometry/PoseWithCovarianceStamped")
class PoseWithCovarianceStamped(Message):
    """A pose and how sure it is, in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the pose."""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    """m."""


@message("geometry/TwistWithCovarianceStamped")
class TwistWithCovarianceStamped(Message):
    """A velocity and how sure it is, in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the velocity."""
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)
    """m/s and rad/s."""


@message("geometry/Point32")
class Point32(Message):
    """A position with about 7 digits in ROS, m: for lists of many."""

    x: Float32 = 0.0
    """m."""
    y: Float32 = 0.0
    """m."""
    z: Float32 = 0.0
    """m."""


@message("geometry/Polygon")
class Polygon(Message):
    """An area within straight edges; the last point is joined to the first."""

    points: list[Point32] = []
    """The corners in order, m."""


@message("geometry/PolygonStamped")
class PolygonStamped(Message):
    """A polygon in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the polygon."""
    polygon: Polygon = field(default_factory=Polygon)
    """m."""


@message("geometry/Wrench")
class Wrench(Message):
    """A force and a torque."""

    force: Vector3 = field(default_factory=Vector3)
    """N."""
    torque: Vector3 = field(default_factory=Vector3)
    """N·m."""


@message("geometry/WrenchStamped")
class WrenchStamped(Message):
    """A force and a torque in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of both."""
    wrench: Wrench = field(default_factory=Wrench)
    """N and N·m."""


@message("geometry/Accel")
class Accel(Message):
    """An acceleration."""

    linear: Vector3 = field(default_factory=Vector3)
    """m/s²."""
    angular: Vector3 = field(default_factory=Vector3)
    """rad/s²."""


@message("geometry/AccelStamped")
class AccelStamped(Message):
    """An acceleration in the header's frame at the header's time."""

    header: Header = field(default_factory=Header)
    """The frame and time of the acceleration."""
    accel: Accel = field(default_factory=Accel)
    """m/s² and rad/s²."""
