"""`Transform3`: a rigid transform in space as a plain value, and the motion between two. SI units, REP-103 axes."""

import math
from typing import NamedTuple, TypeAlias

from robo.errors import InvalidTransform
from robo.tf.screw import Seven, between, followed, relative
from robo_messages import Header, Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Vector3

NEARLY_UNIT = 0.01
"""By how much the square of a quaternion's norm may differ from 1 (tf2: QUATERNION_NORMALIZATION_TOLERANCE)."""
AS_UNIT = 1e-15
"""By how much it differs where nothing is left to be normalized: that is rounding."""
_POLE = 1e-12
"""The cosine of a pitch at which roll and yaw turn about one axis."""
_DRIFTED = 1e-14
"""By how much it may differ in a product; beyond, the product is normalized."""

AnyTransform: TypeAlias = Transform | TransformStamped | Pose | PoseStamped
"""Messages that hold a transform."""


class _Parts(NamedTuple):
    x: float
    """m."""
    y: float
    """m."""
    z: float
    """m."""
    qx: float
    """x of the turn's axis times sin(a / 2), where a is its angle."""
    qy: float
    qz: float
    qw: float
    """cos(a / 2)."""


class Transform3(_Parts):
    """Where one frame stands in another: a translation x, y, z in m and a rotation as a unit quaternion qx, qy, qz, qw.

    It takes coordinates in the child frame to coordinates in the parent frame. It never changes, can be compared and
    hashed, and unpacks into its seven floats. Without arguments it is the identity.

    >>> odom_base = Transform3.planar(2.0, 0.0, math.pi / 2)
    >>> base_laser = Transform3(x=0.1)
    >>> (odom_base @ base_laser).apply(1.0, 0.0, 0.0)  # a point 1 m before the laser, in odom
    (2.0, 1.1, 0.0)
    """

    __slots__ = ()

    def __new__(
        cls,
        x: float = 0.0,
        y: float = 0.0,
        z: float = 0.0,
        qx: float = 0.0,
        qy: float = 0.0,
        qz: float = 0.0,
        qw: float = 1.0,
    ) -> "Transform3":
        """Seven numbers as they stand, but for a quaternion that is nearly of norm 1, which is normalized.

        Raises:
            InvalidTransform: one is not finite, or the square of the quaternion's norm is off 1 by more than 0.01.
        """
        return tuple.__new__(cls, unit((x, y, z, qx, qy, qz, qw)))

    @classmethod
    def planar(cls, x: float, y: float, yaw: float) -> "Transform3":
        """A transform in the plane: x and y in m, and a turn about z in rad, counter-clockwise."""
        return cls(x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))

    @classmethod
    def from_rpy(cls, x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> "Transform3":
        """From a translation in m and turns in rad about the parent's x, then y, then z axis (REP-103 fixed axes).

        The product of the three turns' quaternions (q_123 in Diebel 2006, Representing attitude).
        """
        sr, cr = math.sin(roll / 2), math.cos(roll / 2)
        sp, cp = math.sin(pitch / 2), math.cos(pitch / 2)
        sy, cy = math.sin(yaw / 2), math.cos(yaw / 2)
        qx, qy = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
        return cls(x, y, z, qx, qy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy)

    @classmethod
    def from_message(cls, message: AnyTransform) -> "Transform3":
        """From a `Transform`, a `Pose`, or one with a header.

        Raises:
            InvalidTransform: it holds no rigid transform.
        """
        if isinstance(message, TransformStamped):
            message = message.transform
        elif isinstance(message, PoseStamped):
            message = message.pose
        if isinstance(message, Transform):
            p: Vector3 | Point = message.translation
            q = message.rotation
        else:
            p, q = message.position, message.orientation
        return cls(p.x, p.y, p.z, q.x, q.y, q.z, q.w)

    def to_transform(self) -> Transform:
        """As a message `Transform`."""
        x, y, z, qx, qy, qz, qw = self
        return Transform(Vector3(x, y, z), Quaternion(qx, qy, qz, qw))

    def to_stamped(self, header: Header, child: str) -> TransformStamped:
        """As a message `TransformStamped`: the header names the parent frame and the time."""
        return TransformStamped(header, child, self.to_transform())

    def to_pose(self) -> Pose:
        """As a message `Pose`: where the child frame stands in the parent."""
        x, y, z, qx, qy, qz, qw = self
        return Pose(Point(x, y, z), Quaternion(qx, qy, qz, qw))

    def __matmul__(self, other: "Transform3") -> "Transform3":
        """The product: `a_b @ b_c` is `a_c`, which takes coordinates of c into a."""
        if not isinstance(other, Transform3):
            return NotImplemented
        x, y, z = self.apply(other[0], other[1], other[2])
        qx, qy, qz, qw = self[3:]
        ox, oy, oz, ow = other[3:]
        product = (
            x, y, z,
            qw * ox + qx * ow + qy * oz - qz * oy,
            qw * oy - qx * oz + qy * ow + qz * ox,
            qw * oz + qx * oy - qy * ox + qz * ow,
            qw * ow - qx * ox - qy * oy - qz * oz,
        )  # fmt: skip
        return tuple.__new__(Transform3, normalized(product, _DRIFTED))

    def inverse(self) -> "Transform3":
        """The transform the other way: of `a_b` it is `b_a`."""
        return of_values(relative(self, IDENTITY))

    def rotate(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A free vector of the child frame in the parent's axes, in its own unit: it is turned and not moved.

        v + 2 w (u×v) + 2 u×(u×v), where u and w are the quaternion's parts (Euler-Rodrigues).
        """
        qx, qy, qz, qw = self[3:]
        tx, ty, tz = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
        return x + qw * tx + qy * tz - qz * ty, y + qw * ty + qz * tx - qx * tz, z + qw * tz + qx * ty - qy * tx

    def apply(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A point of the child frame in the parent frame, m."""
        x, y, z = self.rotate(x, y, z)
        return x + self[0], y + self[1], z + self[2]

    def apply_point(self, point: Point) -> Point:
        """A point of the child frame in the parent frame, m."""
        return Point(*self.apply(point.x, point.y, point.z))

    def apply_vector(self, vector: Vector3) -> Vector3:
        """A free vector of the child frame in the parent's axes, in its own unit."""
        return Vector3(*self.rotate(vector.x, vector.y, vector.z))

    def apply_pose(self, pose: Pose) -> Pose:
        """A pose in the child frame, in the parent frame.

        Raises:
            InvalidTransform: the pose is not finite, or its orientation is none.
        """
        return (self @ Transform3.from_message(pose)).to_pose()

    def rpy(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw as `from_rpy` takes them, in rad: pitch in [-π/2, π/2], the others in [-π, π].

        Where x points straight up or down, roll and yaw turn about one axis: roll is 0 there. Yaw is what is left once
        roll is taken away, so that the three are the rotation everywhere (Shoemake 1994, Euler angle conversion).
        """
        (_, xy, xz, _), (_, yy, yz, _), (zx, zy, zz, _), _ = self.matrix()
        level = math.hypot(zy, zz)
        roll = math.atan2(zy, zz) if level > _POLE else 0.0
        s, c = math.sin(roll), math.cos(roll)
        return roll, math.atan2(-zx, level), math.atan2(s * xz - c * xy, c * yy - s * yz)

    def matrix(self) -> tuple[tuple[float, float, float, float], ...]:
        """As a matrix 4x4, by rows: rotation and translation (m) above 0, 0, 0, 1 (R_q in Diebel 2006)."""
        px, py, pz, x, y, z, w = self
        return (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y), px),
            (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x), py),
            (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y), pz),
            (0.0, 0.0, 0.0, 1.0),
        )


def of_values(values: Seven) -> Transform3:
    """A transform of seven floats that are known to be finite and of unit norm."""
    return tuple.__new__(Transform3, values)


def interpolate(a: Transform3, b: Transform3, fraction: float) -> Transform3:
    """The transform on the way from `a` (0) to `b` (1), as a body moves with a constant twist: a screw motion.

    It turns the shortest way, by at most π, whatever the signs of the quaternions; `robo.tf.screw` has the formulas.
    A body that drives a circle or a helix, and turns by less than π from `a` to `b`, is found where it was: within
    1e-12 m over 10 m.

    Args:
        a: where it begins.
        b: where it ends.
        fraction: from 0 to 1; below and beyond, the same motion goes on.
    """
    return of_values(normalized(followed((between(0.0, 1.0, (*a, *b)),), fraction), AS_UNIT))


def unit(values: Seven) -> Seven:
    """Seven numbers as those of a transform: floats, the quaternion of norm 1.

    Raises:
        InvalidTransform: one is not finite, or the quaternion is none of a rotation.
    """
    x, y, z, qx, qy, qz, qw = values
    if not all(map(math.isfinite, values)):
        raise InvalidTransform(f"translation ({x}, {y}, {z}) and rotation ({qx}, {qy}, {qz}, {qw}) are not all finite")
    norm = math.hypot(qx, qy, qz, qw)
    if abs(norm * norm - 1.0) > NEARLY_UNIT:
        what = (
            f"({qx}, {qy}, {qz}, {qw}) is no rotation: a unit quaternion x, y, z, w has norm 1, and this one {norm:.3g}"
        )
        raise InvalidTransform(f"{what}; no turn at all is (0, 0, 0, 1)" if norm < 1e-3 else what)
    return normalized((float(x), float(y), float(z), float(qx), float(qy), float(qz), float(qw)), AS_UNIT)


def normalized(values: Seven, tolerance: float) -> Seven:
    """A transform whose quaternion is nearly of norm 1, with one that is so but for rounding."""
    x, y, z, qx, qy, qz, qw = values
    squared = qx * qx + qy * qy + qz * qz + qw * qw
    if -tolerance < squared - 1.0 < tolerance:
        return values
    k = 1.0 / math.sqrt(squared)
    return x, y, z, k * qx, k * qy, k * qz, k * qw


IDENTITY = Transform3()
"""The transform that changes nothing."""
