"""What sensors say (ROS: sensor_msgs)."""

import math
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from msgspec import Meta, field

from robo_messages._registry import Message, message
from robo_messages._types import (
    ZEROS_3X3,
    Covariance3,
    Float32,
    Int8,
    Int32,
    UInt8,
    UInt16,
    UInt32,
    check_length,
)
from robo_messages.geometry import Quaternion, Vector3
from robo_messages.std import Header

if TYPE_CHECKING:
    from numpy.typing import NDArray


@message("sensor/LaserScan")
class LaserScan(Message):
    """One turn of a planar laser. Rays go counter-clockwise about +z; angle 0 is +x."""

    header: Header = field(default_factory=Header)
    """Its stamp is the time of the first ray."""
    angle_min: Float32 = 0.0
    """Angle of the first ray, rad."""
    angle_max: Float32 = 0.0
    """Angle of the last ray, rad."""
    angle_increment: Float32 = 0.0
    """Between rays, rad."""
    time_increment: Float32 = 0.0
    """Between rays, s."""
    scan_time: Float32 = 0.0
    """Between scans, s."""
    range_min: Float32 = 0.0
    """Smallest valid range, m."""
    range_max: Float32 = 0.0
    """Largest valid range, m."""
    ranges: list[Float32] = []
    """m, one per ray. REP-117: -inf too close, +inf no return, NaN no measurement. A plain array, so
    that any client reads it; `benchmarks/` measures it beside a packed one. `LaserScanArray` has a numpy array."""
    intensities: list[Float32] = []
    """One per ray in the device's own unit, or empty."""


@message("sensor/Imu")
class Imu(Message):
    """Orientation, angular velocity and acceleration. A covariance whose first number is -1 says
    that its quantity is not measured; all zeros, that the covariance is unknown.
    """

    header: Header = field(default_factory=Header)
    """When it was measured, and the sensor's frame."""
    orientation: Quaternion = field(default_factory=Quaternion)
    """The turn from the world's axes to the sensor's."""
    orientation_covariance: Covariance3 = ZEROS_3X3
    """9 numbers, 3x3 row-major about x, y, z; rad²."""
    angular_velocity: Vector3 = field(default_factory=Vector3)
    """rad/s."""
    angular_velocity_covariance: Covariance3 = ZEROS_3X3
    """9 numbers, 3x3 row-major about x, y, z; rad²/s²."""
    linear_acceleration: Vector3 = field(default_factory=Vector3)
    """m/s²."""
    linear_acceleration_covariance: Covariance3 = ZEROS_3X3
    """9 numbers, 3x3 row-major along x, y, z; m²/s⁴."""

    def __post_init__(self) -> None:
        check_length("Imu", "orientation_covariance", self.orientation_covariance, 9)
        check_length("Imu", "angular_velocity_covariance", self.angular_velocity_covariance, 9)
        check_length("Imu", "linear_acceleration_covariance", self.linear_acceleration_covariance, 9)


@message("sensor/JointState")
class JointState(Message):
    """The state of named joints; each array is empty or as long as `name`."""

    header: Header = field(default_factory=Header)
    """When it was measured."""
    name: list[str] = []
    """The joints."""
    position: list[float] = []
    """rad or m."""
    velocity: list[float] = []
    """rad/s or m/s."""
    effort: list[float] = []
    """N·m or N."""


@message("sensor/BatteryState")
class BatteryState(Message):
    """The state of a battery. Voltage is always measured; another number that is not is NaN, which is its default."""

    POWER_SUPPLY_STATUS_UNKNOWN: ClassVar[int] = 0
    POWER_SUPPLY_STATUS_CHARGING: ClassVar[int] = 1
    POWER_SUPPLY_STATUS_DISCHARGING: ClassVar[int] = 2
    POWER_SUPPLY_STATUS_NOT_CHARGING: ClassVar[int] = 3
    POWER_SUPPLY_STATUS_FULL: ClassVar[int] = 4
    POWER_SUPPLY_HEALTH_UNKNOWN: ClassVar[int] = 0
    POWER_SUPPLY_HEALTH_GOOD: ClassVar[int] = 1
    POWER_SUPPLY_HEALTH_OVERHEAT: ClassVar[int] = 2
    POWER_SUPPLY_HEALTH_DEAD: ClassVar[int] = 3
    POWER_SUPPLY_HEALTH_OVERVOLTAGE: ClassVar[int] = 4
    POWER_SUPPLY_HEALTH_UNSPEC_FAILURE: ClassVar[int] = 5
    POWER_SUPPLY_HEALTH_COLD: ClassVar[int] = 6
    POWER_SUPPLY_HEALTH_WATCHDOG_TIMER_EXPIRE: ClassVar[int] = 7
    POWER_SUPPLY_HEALTH_SAFETY_TIMER_EXPIRE: ClassVar[int] = 8
    POWER_SUPPLY_TECHNOLOGY_UNKNOWN: ClassVar[int] = 0
    POWER_SUPPLY_TECHNOLOGY_NIMH: ClassVar[int] = 1
    POWER_SUPPLY_TECHNOLOGY_LION: ClassVar[int] = 2
    POWER_SUPPLY_TECHNOLOGY_LIPO: ClassVar[int] = 3
    POWER_SUPPLY_TECHNOLOGY_LIFE: ClassVar[int] = 4
    POWER_SUPPLY_TECHNOLOGY_NICD: ClassVar[int] = 5
    POWER_SUPPLY_TECHNOLOGY_LIMN: ClassVar[int] = 6

    header: Header = field(default_factory=Header)
    """When it was measured."""
    voltage: Float32 = 0.0
    """V."""
    temperature: Float32 = math.nan
    """°C."""
    current: Float32 = math.nan
    """A; negative while discharging."""
    charge: Float32 = math.nan
    """Ah."""
    capacity: Float32 = math.nan
    """Ah, of the last full charge."""
    design_capacity: Float32 = math.nan
    """Ah."""
    percentage: Float32 = math.nan
    """0 to 1."""
    power_supply_status: UInt8 = 0
    """One of POWER_SUPPLY_STATUS_…"""
    power_supply_health: UInt8 = 0
    """One of POWER_SUPPLY_HEALTH_…"""
    power_supply_technology: UInt8 = 0
    """One of POWER_SUPPLY_TECHNOLOGY_…"""
    present: bool = False
    """Whether there is a battery."""
    cell_voltage: list[Float32] = []
    """V, one per cell, or empty; NaN where a cell is not measured."""
    cell_temperature: list[Float32] = []
    """°C, one per cell, or empty; NaN where a cell is not measured."""
    location: str = ""
    """Where it is in the robot."""
    serial_number: str = ""
    """What it says of itself."""


@message("sensor/Range")
class Range(Message):
    """One distance from an ultrasonic or infrared sensor."""

    ULTRASOUND: ClassVar[int] = 0
    INFRARED: ClassVar[int] = 1

    header: Header = field(default_factory=Header)
    """When it was measured, and the frame whose x axis is the cone's."""
    radiation_type: UInt8 = 0
    """ULTRASOUND or INFRARED."""
    field_of_view: Float32 = 0.0
    """The cone's full angle, rad."""
    min_range: Float32 = 0.0
    """m."""
    max_range: Float32 = 0.0
    """m."""
    range: Float32 = 0.0
    """m; REP-117: -inf too close, +inf no return, NaN no measurement."""
    variance: Float32 = 0.0
    """m²; 0 is unknown."""


@message("sensor/Image")
class Image(Message):
    """An uncompressed picture."""

    header: Header = field(default_factory=Header)
    """When it was taken, and the camera's frame: z into the picture, x right, y down."""
    height: UInt32 = 0
    """Rows."""
    width: UInt32 = 0
    """Pixels in a row."""
    encoding: str = ""
    """Channels and their width, for example `rgb8`, `mono8`, `16UC1`."""
    is_bigendian: UInt8 = 0
    """1 where the bytes of a value begin with the highest."""
    step: UInt32 = 0
    """Bytes in a row."""
    data: memoryview = memoryview(b"")
    """height x step bytes, row by row. A decoded one points into the payload: no copy is made."""

    @property
    def array(self) -> "NDArray[Any]":
        """The pixels as a numpy array (height, width), or (height, width, channels) of more than one channel.

        It looks into `data`: of a received message it is read-only, and keeps the payload alive. Needs numpy.

        Raises:
            ModuleNotFoundError: numpy is not installed.
            ValueError: `encoding` is not known, or `data` or `step` is too small.
        """
        from robo_messages import arrays

        return arrays.image_array(self)

    @classmethod
    def from_array(cls, array: "NDArray[Any]", encoding: str, header: Header | None = None) -> Self:
        """A picture that looks into an array; one whose rows do not lie in order is copied.

        Args:
            array: the pixels, of the shape that `array` has.
            encoding: what they are, for example `rgb8`, `mono8`, `16UC1`.
            header: when it was taken, and the camera's frame.

        Raises:
            ModuleNotFoundError: numpy is not installed.
            ValueError: `encoding` is not known, or takes another shape or type.
        """
        from robo_messages import arrays

        return arrays.image_from(cls, array, encoding, header)


@message("sensor/CompressedImage")
class CompressedImage(Message):
    """A compressed picture."""

    header: Header = field(default_factory=Header)
    """As of `Image`."""
    format: str = ""
    """For example `jpeg`, `png`."""
    data: memoryview = memoryview(b"")
    """The file's bytes. A decoded one points into the payload: no copy is made."""


@message("sensor/NavSatStatus")
class NavSatStatus(Message):
    """Whether a satellite receiver has a fix, and from which systems."""

    STATUS_NO_FIX: ClassVar[int] = -1
    STATUS_FIX: ClassVar[int] = 0
    STATUS_SBAS_FIX: ClassVar[int] = 1
    STATUS_GBAS_FIX: ClassVar[int] = 2

    status: Int8 = 0
    """One of STATUS_…"""
    service: UInt16 = 0
    """Bits: 1 GPS, 2 GLONASS, 4 COMPASS, 8 GALILEO."""


@message("sensor/NavSatFix")
class NavSatFix(Message):
    """A position on Earth (WGS 84)."""

    COVARIANCE_TYPE_UNKNOWN: ClassVar[int] = 0
    COVARIANCE_TYPE_APPROXIMATED: ClassVar[int] = 1
    COVARIANCE_TYPE_DIAGONAL_KNOWN: ClassVar[int] = 2
    COVARIANCE_TYPE_KNOWN: ClassVar[int] = 3

    header: Header = field(default_factory=Header)
    """When it was measured, and the antenna's frame."""
    status: NavSatStatus = field(default_factory=NavSatStatus)
    """Whether there is a fix."""
    latitude: float = 0.0
    """°, north positive."""
    longitude: float = 0.0
    """°, east positive."""
    altitude: float = 0.0
    """m above the ellipsoid."""
    position_covariance: Covariance3 = ZEROS_3X3
    """9 numbers, 3x3 row-major over east, north, up; m²."""
    position_covariance_type: UInt8 = 0
    """One of COVARIANCE_TYPE_…"""

    def __post_init__(self) -> None:
        check_length("NavSatFix", "position_covariance", self.position_covariance, 9)


@message("sensor/PointField")
class PointField(Message):
    """Where one value of a point stands within the point's bytes."""

    INT8: ClassVar[int] = 1
    UINT8: ClassVar[int] = 2
    INT16: ClassVar[int] = 3
    UINT16: ClassVar[int] = 4
    INT32: ClassVar[int] = 5
    UINT32: ClassVar[int] = 6
    FLOAT32: ClassVar[int] = 7
    FLOAT64: ClassVar[int] = 8

    name: str = ""
    """For example `x`, `intensity`."""
    offset: UInt32 = 0
    """Bytes from the start of the point."""
    datatype: Annotated[int, Meta(ge=0, le=8, extra={"ros": "uint8"})] = 0
    """INT8 … FLOAT64; 0 is not set."""
    count: UInt32 = 0
    """Elements of this field."""


@message("sensor/PointCloud2")
class PointCloud2(Message):
    """Points in space, in rows."""

    header: Header = field(default_factory=Header)
    """When it was measured, and the frame of the points."""
    height: UInt32 = 0
    """Rows; 1 for a cloud without order."""
    width: UInt32 = 0
    """Points in a row."""
    fields: list[PointField] = []
    """What each point's bytes hold."""
    is_bigendian: bool = False
    """The bytes of a value begin with the highest."""
    point_step: UInt32 = 0
    """Bytes of a point."""
    row_step: UInt32 = 0
    """Bytes of a row."""
    data: memoryview = memoryview(b"")
    """height x row_step bytes. A decoded one points into the payload: no copy is made."""
    is_dense: bool = False
    """No point is invalid."""

    @property
    def array(self) -> "NDArray[Any]":
        """The points as a structured numpy array (width,), or (height, width) of more than one row: `cloud.array["x"]`.

        It looks into `data`: of a received message it is read-only, and keeps the payload alive. Needs numpy.

        Raises:
            ModuleNotFoundError: numpy is not installed.
            ValueError: `fields`, the steps and `data` do not fit.
        """
        from robo_messages import arrays

        return arrays.cloud_array(self)

    @classmethod
    def from_array(cls, array: "NDArray[Any]", header: Header | None = None, is_dense: bool | None = None) -> Self:
        """A cloud that looks into an array; one that does not lie in order is copied.

        Args:
            array: a structured one, (points,) or (rows, points); or floats as x, y, z with a last axis of 3.
            header: when it was measured, and the frame of the points.
            is_dense: whether all numbers are finite; by default it is looked at.

        Raises:
            ModuleNotFoundError: numpy is not installed.
            ValueError: it has another shape, or a field of a type that a PointField has not.
        """
        from robo_messages import arrays

        return arrays.cloud_from(cls, PointField, array, header, is_dense)


@message("sensor/Joy")
class Joy(Message):
    """A game pad."""

    header: Header = field(default_factory=Header)
    """When a button or an axis moved."""
    axes: list[Float32] = []
    """-1 to 1."""
    buttons: list[Int32] = []
    """1 pressed, 0 not."""
