"""Odometry, paths and maps (ROS: nav_msgs)."""

from __future__ import annotations

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages._types import Float32, SignedBytes, UInt32
from robo_messages.geometry import Pose, PoseStamped, PoseWithCovariance, TwistWithCovariance
from robo_messages.std import Header, Time


@message("nav/Odometry")
class Odometry(Message):
    """An estimate of pose and velocity."""

    header: Header = field(default_factory=Header)
    """Its `frame_id` is the frame of the pose, usually `odom`."""
    child_frame_id: str = ""
    """The frame of the twist, usually `base_link`."""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    """m, in the header's frame."""
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)
    """m/s and rad/s, in the child frame."""


@message("nav/Path")
class Path(Message):
    """Poses to follow, in order."""

    header: Header = field(default_factory=Header)
    """The frame of all poses, and when the path was made."""
    poses: list[PoseStamped] = []
    """In the order in which they are to be reached, m."""


@message("nav/MapMetaData")
class MapMetaData(Message):
    """The size and place of a grid map."""

    map_load_time: Time = field(default_factory=Time)
    """When the map was loaded."""
    resolution: Float32 = 0.0
    """m per cell."""
    width: UInt32 = 0
    """Cells along x."""
    height: UInt32 = 0
    """Cells along y."""
    origin: Pose = field(default_factory=Pose)
    """Pose of the lower left corner of cell (0, 0), m."""


@message("nav/OccupancyGrid")
class OccupancyGrid(Message):
    """A grid map of free and occupied space."""

    header: Header = field(default_factory=Header)
    """The map's frame, and since when it is as it says."""
    info: MapMetaData = field(default_factory=MapMetaData)
    """Its size and place."""
    data: SignedBytes = memoryview(b"")
    """height x width cells, one signed byte each (`data.cast("b")`), row-major from (0, 0):
    0 free … 100 occupied, -1 unknown. A binary field: a map has a million cells."""
