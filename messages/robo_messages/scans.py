"""`LaserScanArray`: a laser scan whose ranges are a numpy array, for whoever computes with them. Needs numpy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec import Raw, field

from robo_messages._registry import Message, form_of
from robo_messages._types import Float32
from robo_messages.arrays import floats_of, packed_floats, uniform_floats
from robo_messages.sensor import LaserScan
from robo_messages.std import Header

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

_NONE = Raw(b"\x90")


@form_of(LaserScan)
class LaserScanArray(Message):
    """A `LaserScan` as another Python class. On the wire both are one type: one may be sent and the other received.

    A list of 2,000 ranges is 2,000 Python numbers, which are made when the message is read; here none is.
    It travels as MessagePack; `encode_json` is for a `LaserScan`.

    >>> scan = LaserScanArray(angle_min=-1.57, angle_increment=0.01)
    >>> scan.ranges = [1.0, 2.5]
    >>> float(scan.ranges.max())
    2.5
    """

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
    packed_ranges: Raw = field(default=_NONE, name="ranges")
    """`ranges` as they travel; written by them."""
    packed_intensities: Raw = field(default=_NONE, name="intensities")
    """`intensities` as they travel; written by them."""

    def __post_init__(self) -> None:
        # What is no array of numbers is refused where it is read, not where a callback looks at it.
        if self.packed_ranges is not _NONE:
            self.packed_ranges = uniform_floats(self.packed_ranges)
        if self.packed_intensities is not _NONE:
            self.packed_intensities = uniform_floats(self.packed_intensities)

    @property
    def ranges(self) -> NDArray[np.float32] | NDArray[np.float64]:
        """m, one per ray; REP-117: -inf too close, +inf no return, NaN no measurement.

        A new array each time. What is assigned travels, and is read again, as float32 where it is an array of float32,
        else as float64.
        """
        return floats_of(self.packed_ranges)

    @ranges.setter
    def ranges(self, values: ArrayLike) -> None:
        self.packed_ranges = packed_floats(values)

    @property
    def intensities(self) -> NDArray[np.float32] | NDArray[np.float64]:
        """One per ray in the device's own unit, or empty; as `ranges`."""
        return floats_of(self.packed_intensities)

    @intensities.setter
    def intensities(self, values: ArrayLike) -> None:
        self.packed_intensities = packed_floats(values)

    def angles(self) -> NDArray[np.float64]:
        """The angle of each ray, rad."""
        import numpy as np

        count = len(self.ranges)
        return self.angle_min + self.angle_increment * np.arange(count, dtype=np.float64)
