"""What cameras and receivers of satellites say of themselves (ROS: sensor_msgs).

Imported when one of its types is asked for.
"""

from typing import Annotated

from msgspec import Meta, field

from robo_messages._registry import Message, message
from robo_messages._types import UInt32, check_length
from robo_messages.std import Header, Time

Matrix3 = Annotated[tuple[float, ...], Meta(min_length=9, max_length=9)]
Matrix3x4 = Annotated[tuple[float, ...], Meta(min_length=12, max_length=12)]


@message("sensor/RegionOfInterest")
class RegionOfInterest(Message):
    """A part of a picture; all zeros is the whole of it."""

    x_offset: UInt32 = 0
    """Its leftmost pixel."""
    y_offset: UInt32 = 0
    """Its topmost pixel."""
    height: UInt32 = 0
    """Rows."""
    width: UInt32 = 0
    """Pixels in a row."""
    do_rectify: bool = False
    """Whether a rectified part is to be made of the raw one."""


@message("sensor/CameraInfo")
class CameraInfo(Message):
    """How a camera sees: its calibration. Where `k` begins with 0 it is not calibrated."""

    header: Header = field(default_factory=Header)
    """When its pictures were taken, and the camera's frame: z into the picture, x right, y down."""
    height: UInt32 = 0
    """Rows of a picture as it was calibrated."""
    width: UInt32 = 0
    """Pixels in a row."""
    distortion_model: str = ""
    """For example `plumb_bob`, `rational_polynomial`, `equidistant`."""
    d: list[float] = []
    """The parameters of the distortion, without unit; of `plumb_bob` k1, k2, t1, t2, k3."""
    k: Matrix3 = (0.0,) * 9
    """9 numbers, 3x3 row-major: from a ray in the camera's frame to the raw picture, pixels."""
    r: Matrix3 = (0.0,) * 9
    """9 numbers, 3x3 row-major, without unit: the turn that rectifies; of a single camera the identity."""
    p: Matrix3x4 = (0.0,) * 12
    """12 numbers, 3x4 row-major: from a point in the camera's frame to the rectified picture, pixels."""
    binning_x: UInt32 = 0
    """How many pixels along a row are one; 0 is 1."""
    binning_y: UInt32 = 0
    """How many rows are one; 0 is 1."""
    roi: RegionOfInterest = field(default_factory=RegionOfInterest)
    """Which part of the full picture is sent."""

    def __post_init__(self) -> None:
        check_length("CameraInfo", "k", self.k, 9)
        check_length("CameraInfo", "r", self.r, 9)
        check_length("CameraInfo", "p", self.p, 12)


@message("sensor/TimeReference")
class TimeReference(Message):
    """What another clock says."""

    header: Header = field(default_factory=Header)
    """When that was, by this robot's clock."""
    time_ref: Time = field(default_factory=Time)
    """The time by the other clock."""
    source: str = ""
    """Whose clock it is."""
