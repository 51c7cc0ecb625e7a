"""Odometry, paths and maps (ROS: nav_msgs)."""

from typing import TYPE_CHECKING, Self

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages._types import Float32, SignedBytes, UInt32
from robo_messages.geometry import Pose, PoseStamped, PoseWithCovariance, TwistWithCovariance
from robo_messages.std import Header, Time

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


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

    @property
    def array(self) -> "NDArray[np.int8]":
        """The cells as a numpy array (height, width): `grid.array[y, x]`.

        It looks into `data`: of a received message it is read-only, and keeps the payload alive. Needs numpy.

        Raises:
            ModuleNotFoundError: numpy is not installed.
            ValueError: `data` is too small for `info`.
        """
        from robo_messages import arrays

        return arrays.grid_array(self.info.height, self.info.width, self.data)

    @classmethod
    def from_array(
        cls, array: "ArrayLike", resolution: float, origin: Pose | None = None, header: Header | None = None
    ) -> Self:
        """A map that looks into an array of int8; another one is copied.

        Args:
            array: the cells, (height, width): 0 free … 100 occupied, -1 unknown.
            resolution: m per cell.
            origin: pose of the lower left corner of cell (0, 0), m.
            header: the map's frame, and since when it is as it says.

        Raises:
            ModuleNotFoundError: numpy is not installed.
            ValueError: it has another shape, or holds what is no signed byte.
        """
        from robo_messages import arrays

        cells = arrays.cells_of(array)
        height, width = cells.shape
        info = MapMetaData(resolution=resolution, width=width, height=height)
        info.origin = origin if origin is not None else info.origin
        grid = cls(info=info, data=arrays.bytes_of(cells))
        grid.header = header if header is not None else grid.header
        return grid
