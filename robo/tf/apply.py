"""Messages in another frame: points, vectors, poses and laser scans, at the time of their stamps."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from robo.tf.buffer import Buffer
from robo.tf.transform import Transform3
from robo_messages import Header, LaserScan, PointStamped, PoseStamped, Vector3Stamped

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from robo_messages.scans import LaserScanArray


def transform_point(buffer: Buffer, point: PointStamped, target: str) -> PointStamped:
    """A point in another frame, with the same stamp.

    Args:
        buffer: where the transforms are.
        point: its header names its frame and when it was there.
        target: the frame that it is wanted in.

    Raises:
        TransformError: as `Buffer.lookup`.
    """
    return PointStamped(
        Header(point.header.stamp, target), _from(buffer, point.header, target).apply_point(point.point)
    )


def transform_vector(buffer: Buffer, vector: Vector3Stamped, target: str) -> Vector3Stamped:
    """A free vector in the axes of another frame, as `transform_point`: it is turned and not moved."""
    header = Header(vector.header.stamp, target)
    return Vector3Stamped(header, _from(buffer, vector.header, target).apply_vector(vector.vector))


def transform_pose(buffer: Buffer, pose: PoseStamped, target: str) -> PoseStamped:
    """A pose in another frame, as `transform_point`.

    Raises:
        TransformError: as `Buffer.lookup`; InvalidTransform also where the pose is none.
    """
    return PoseStamped(Header(pose.header.stamp, target), _from(buffer, pose.header, target).apply_pose(pose.pose))


def scan_points(buffer: Buffer, scan: LaserScan, target: str) -> list[tuple[float, float, float]]:
    """What a laser has hit, in another frame, as x, y, z in m.

    Rays that hit nothing, or whose range is not valid (REP-117: NaN, infinite, outside of `range_min` and `range_max`),
    are left out. All rays count as of the scan's stamp: the laser is taken to stand still during one turn.

    Args:
        buffer: where the transforms are.
        scan: its header names the laser's frame and the time of the first ray.
        target: the frame that the points are wanted in.

    Raises:
        TransformError: as `Buffer.lookup`.
    """
    (xx, xy, _, px), (yx, yy, _, py), (zx, zy, _, pz), _ = _from(buffer, scan.header, target).matrix()
    found = []
    for index, distance in enumerate(scan.ranges):
        if scan.range_min <= distance <= scan.range_max and distance < math.inf:
            angle = scan.angle_min + index * scan.angle_increment
            x, y = distance * math.cos(angle), distance * math.sin(angle)
            found.append((px + xx * x + xy * y, py + yx * x + yy * y, pz + zx * x + zy * y))
    return found


def scan_array(buffer: Buffer, scan: LaserScan | LaserScanArray, target: str) -> NDArray[np.float64]:
    """The same as an array (points, 3), quicker; needs numpy. It takes a `LaserScanArray` too.

    Raises:
        TransformError: as `Buffer.lookup`.
        ModuleNotFoundError: numpy is not installed.
    """
    try:
        import numpy as np
    except ModuleNotFoundError as error:
        if error.name != "numpy":
            raise
        text = "scan_array needs numpy, which is not installed: pip install 'robo-zenoh[numpy]'; scan_points needs none"
        raise ModuleNotFoundError(text, name="numpy") from None
    rows = np.array(_from(buffer, scan.header, target).matrix())
    ranges = np.asarray(scan.ranges, np.float64)
    valid = np.flatnonzero((ranges >= scan.range_min) & (ranges <= scan.range_max) & np.isfinite(ranges))
    ranges, angles = ranges[valid], scan.angle_min + valid * scan.angle_increment
    flat = np.stack((ranges * np.cos(angles), ranges * np.sin(angles)), axis=1)
    points: NDArray[np.float64] = flat @ rows[:3, :2].T + rows[:3, 3]
    return points


def _from(buffer: Buffer, header: Header, target: str) -> Transform3:
    return buffer.lookup(target, header.frame_id, header.stamp)
