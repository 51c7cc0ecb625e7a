"""What messages say of how a base moves, as measurements for the filter.

Pure: no network, no clock. Of a covariance of zeros nobody knows what it means; then errors are taken to be about as
large as `DEVIATIONS` says. A quantity whose variance is `NOT_MEASURED` or more is left out, and so is one of an IMU
whose covariance begins with -1 (REP-145).
"""

import math
from collections.abc import Sequence
from operator import mul

from robo_messages import (
    Imu,
    Odometry,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    TwistWithCovariance,
    TwistWithCovarianceStamped,
    Vector3,
)
from robo_services.ekf import AX, AY, QUANTITIES, VX, VY, VYAW, YAW, Measurement, Unusable, X, Y
from robo_services.ekf_parameters import SourceParameters
from robo_services.kinematics import ORIGIN, Pose2
from robo_services.planar import angle_difference, normalize_angle
from robo_services.uncertainty import NOT_MEASURED

DEVIATIONS = (0.1, 0.1, 0.05, 0.05, 0.05, 0.05, 0.5, 0.5)
"""Standard deviations of x, y, yaw, vx, vy, vyaw, ax, ay where a message says none: m, rad, m/s, rad/s, m/s²."""
SIDEWAYS = 0.01
"""How fast a base with wheels slides sideways, m/s."""
GRAVITY = 9.80665
"""m/s²."""

STANDS = 1e-3
"""m/s and rad/s: wheels that are slower stand."""
AT_REST = 0.5
"""A base whose wheels have stood for so long has come to rest, s."""
HEARD = 0.2
"""Wheels that have said nothing for so long may turn, s."""
AVERAGED = 500
"""How many readings a bias is the mean of."""
ONE_AFTER_ANOTHER = 50
"""So many readings at rest that are more than any bias are no noise."""

_PLANE = (0, 1, 5)
"""Where x, y and yaw stand among the six of a covariance."""

Measured = Odometry | Imu | PoseWithCovarianceStamped | TwistWithCovarianceStamped
"""What a source may say."""

Vector = tuple[float, float, float]
Rotation = tuple[Vector, Vector, Vector]
LEVEL: Rotation = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class RestBias:
    """What a gyro says while the wheels stand: that much it says too much while they turn."""

    def __init__(self) -> None:
        self.bias = 0.0
        """rad/s."""
        self.excess = 0.0
        """What it says at rest, rad/s, where that is more than may be its bias; else 0."""
        self._limit = 0.0
        self._count = 0
        self._variance = 0.0
        self._beyond = 0
        self._waiting: list[float] = []
        self._stands_since = math.inf
        self._heard = -math.inf

    def wheels(self, linear: float, angular: float, time: float) -> None:
        """Wheels say how fast the base moves, m/s and rad/s, at a time, s."""
        waiting, self._waiting = self._waiting, []
        if not (abs(linear) < STANDS and abs(angular) < STANDS):
            self._stands_since = math.inf
        elif time < self._stands_since or time - self._heard > HEARD:
            self._stands_since = time
        else:  # they stood before what the gyro said meanwhile, and they stand now
            for rate in waiting:
                self._learn(rate)
        self._heard = time

    def without(self, rate: float, time: float, limit: float) -> tuple[float, float]:
        """A gyro's rate without its bias, and how sure that bias is.

        Args:
            rate: as said, rad/s.
            time: s.
            limit: no bias is larger, rad/s.

        Returns:
            The rate, and the standard deviation of the error that is left in this reading and all that follow, rad/s:
            before any rest that of a bias anywhere up to the limit; 0 at rest, where it is being found.
        """
        self._limit = limit
        resting = time - self._stands_since >= AT_REST and abs(time - self._heard) <= HEARD
        if resting and limit and len(self._waiting) < AVERAGED:
            self._waiting.append(rate)
        bias = max(-limit, min(limit, self.bias))
        return rate - bias, 0.0 if resting and self._count else self._deviation(limit)

    def _learn(self, rate: float) -> None:
        if abs(rate) > self._limit:
            self._beyond += 1
            if self._beyond >= ONE_AFTER_ANOTHER:
                self.excess = rate
            return
        self._beyond, self.excess = 0, 0.0
        self._count = min(self._count + 1, AVERAGED)
        before = rate - self.bias
        self.bias += before / self._count
        self._variance += (before * (rate - self.bias) - self._variance) / self._count

    def _deviation(self, limit: float) -> float:
        """Of what is left of a bias: evenly spread at first, then that of a mean."""
        if self._count < 2 or not limit:
            return limit / math.sqrt(3.0)
        return math.sqrt(self._variance / (self._count - 1 + 3.0 * self._variance / (limit * limit)))


class Reader:
    """Reads the messages of one source."""

    def __init__(self, name: str, said: SourceParameters, *, holonomic: bool) -> None:
        """
        Args:
            name: of the source.
            said: what is taken of it, and how.
            holonomic: whether the base can drive sideways.
        """
        self.said = said
        self.bias = RestBias()
        """Of a gyro."""
        self._name = name
        self._used = {QUANTITIES.index(one) for one in said.use}
        self._guided = not holonomic
        turned = said.roll or said.pitch or said.yaw
        self._mounted = _rotation(said.roll, said.pitch, said.yaw) if turned else LEVEL
        self._anchor = ORIGIN
        self._first: Pose2 | None = None
        self._last: tuple[float, Pose2, list[list[float]]] | None = None

    def begin_anew(self, anchor: Pose2 = ORIGIN) -> None:
        """Forget where its poses began; those that are relative count from the next one, which is there."""
        self._anchor, self._first, self._last = anchor, None, None

    def motion(self, message: Measured) -> tuple[float, float] | None:
        """How fast its wheels say that the base moves, m/s and rad/s; None of one that does not know of wheels."""
        if not isinstance(message, (Odometry, TwistWithCovarianceStamped)):
            return None
        said = message.twist
        if self.said.differential or not self._used & {VX, VYAW} or said.covariance[0] >= NOT_MEASURED:
            return None
        if said.covariance[35] >= NOT_MEASURED:
            return None
        return math.hypot(said.twist.linear.x, said.twist.linear.y), said.twist.angular.z

    def odometry(self, message: Odometry, time: float) -> list[Measurement]:
        """Poses and velocities of an odometry.

        Raises:
            Unusable: says why it is none.
        """
        return [*self.pose(message.pose, time), *self.twist(message.twist, time)]

    def pose(self, said: PoseWithCovariance, time: float) -> list[Measurement]:
        """A pose at a time, s; raises Unusable where it is none."""
        if not self._used & {X, Y, YAW}:
            return []
        position = said.pose.position
        pose = Pose2(position.x, position.y, _yaw(_matrix(said.pose.orientation)))
        _refuse_infinite(pose)
        covariance = _block(said.covariance, 6, _PLANE)
        if self.said.differential:
            return self._between(pose, covariance, time)
        if self.said.relative:
            self._first = first = self._first or pose
            turn = _about_z(self._anchor.yaw - first.yaw)
            x, y, _ = _turned(turn, (pose.x - first.x, pose.y - first.y, 0.0))
            yaw = normalize_angle(self._anchor.yaw + pose.yaw - first.yaw)
            pose = Pose2(self._anchor.x + x, self._anchor.y + y, yaw)
            covariance = _seen(turn, covariance)
        return self._parts((X, Y, YAW), pose, covariance, time)

    def twist(self, said: TwistWithCovariance, time: float) -> list[Measurement]:
        """Velocities at a time, s; raises Unusable where they are none."""
        if not self._used & {VX, VY, VYAW}:
            return []
        values = said.twist.linear.x, said.twist.linear.y, said.twist.angular.z
        return self._parts((VX, VY, VYAW), values, _block(said.covariance, 6, _PLANE), time)

    def imu(self, message: Imu, time: float) -> list[Measurement]:
        """What an IMU says at a time, s; raises Unusable where that is nothing."""
        found: list[Measurement] = []
        attitude = self._attitude(message)
        if attitude is not None and YAW in self._used:
            found += self._heading(_yaw(attitude), _block(message.orientation_covariance, 3, range(3)), time)
        if VYAW in self._used and message.angular_velocity_covariance[0] != -1.0:
            covariance = _seen(self._mounted, _block(message.angular_velocity_covariance, 3, range(3)))
            rate = _turned(self._mounted, _vector(message.angular_velocity))[2]
            _refuse_infinite((rate,))
            rate, drift = self.bias.without(rate, time, self.said.rest_bias)
            found += (one._replace(drift=drift) for one in self._parts((VYAW,), (rate,), [[covariance[2][2]]], time))
        if self._used & {AX, AY} and message.linear_acceleration_covariance[0] != -1.0:
            x, y, _ = _turned(self._mounted, _vector(message.linear_acceleration))
            if self.said.remove_gravitational_acceleration:
                # Of a base that stands level, as one in the plane does, gravity is along z alone.
                up = attitude[2] if attitude is not None else (0.0, 0.0, 1.0)
                x, y = x - GRAVITY * up[0], y - GRAVITY * up[1]
            covariance = _seen(self._mounted, _block(message.linear_acceleration_covariance, 3, range(3)))
            found += self._parts((AX, AY), (x, y), [row[:2] for row in covariance[:2]], time)
        return found

    def _attitude(self, message: Imu) -> Rotation | None:
        """How the base stands in the world; None where nobody says, or asks."""
        asked = YAW in self._used or self.said.remove_gravitational_acceleration
        if not asked or message.orientation_covariance[0] == -1.0:
            return None
        return _product(_matrix(message.orientation), _transposed(self._mounted))

    def _heading(self, yaw: float, covariance: list[list[float]], time: float) -> list[Measurement]:
        _refuse_infinite((yaw,))
        if self.said.differential:
            return self._between(Pose2(yaw=yaw), [[0.0] * 3, [0.0] * 3, [0.0, 0.0, covariance[2][2]]], time)
        if self.said.relative:
            self._first = self._first or Pose2(yaw=yaw)
            yaw = normalize_angle(self._anchor.yaw + yaw - self._first.yaw)
        return self._parts((YAW,), (yaw,), [[covariance[2][2]]], time)

    def _between(self, pose: Pose2, covariance: list[list[float]], time: float) -> list[Measurement]:
        """The velocities from the last pose to this one, along the arc between them."""
        before, self._last = self._last, (time, pose, covariance)
        if before is None or not 1e-4 < time - before[0] < 1.0:
            return []
        dt, last = time - before[0], before[1]
        turn = angle_difference(pose.yaw, last.yaw)
        half = turn / 2
        ahead = _about_z(-last.yaw - half)
        stretch = half / math.sin(half) if half else 1.0
        x, y, _ = _turned(ahead, (pose.x - last.x, pose.y - last.y, 0.0))
        values = stretch * x / dt, stretch * y / dt, turn / dt
        measured = [not any(one[k][k] >= NOT_MEASURED for one in (before[2], covariance)) for k in range(3)]
        if not measured[2]:  # where ahead is nobody knows either
            return []
        both = [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(before[2], covariance, strict=True)]
        errors = [[one / (dt * dt) for one in row] for row in _seen(ahead, both)]
        if not (measured[0] and measured[1]):
            return self._parts((VYAW,), values[2:], [errors[2][2:]], time)
        return self._parts((VX, VY, VYAW), values, errors, time)

    def _parts(
        self, indices: Sequence[int], values: Sequence[float], covariance: list[list[float]], time: float
    ) -> list[Measurement]:
        """What is taken of some quantities, with the errors that belong to it."""
        used = self._used | {i + VX for i in self._used if i < VX} if self.said.differential else self._used
        unknown = not any(map(any, covariance))
        kept = [k for k, i in enumerate(indices) if i in used and not covariance[k][k] >= NOT_MEASURED]
        if any(covariance[k][k] < 0.0 for k in kept):
            raise Unusable("a variance is negative")
        chosen = tuple(indices[k] for k in kept)
        errors = [[covariance[a][b] for b in kept] for a in kept]
        for k, i in enumerate(chosen):
            if unknown:
                errors[k][k] = DEVIATIONS[i] ** 2
        said = tuple(values[k] for k in kept)
        found = [Measurement(time, self._name, chosen, said, errors, self.said.threshold)] if chosen else []
        if self._guided and {X, VX} & {*chosen} and VY not in chosen:
            found.append(Measurement(time, self._name, (VY,), (0.0,), ((SIDEWAYS**2,),), assumed=True))
        return found


def _refuse_infinite(values: Sequence[float]) -> None:
    if not all(map(math.isfinite, values)):
        raise Unusable("it is not finite")


def _block(numbers: Sequence[float], size: int, indices: Sequence[int]) -> list[list[float]]:
    return [[numbers[size * i + j] for j in indices] for i in indices]


def _vector(vector: Vector3) -> Vector:
    return vector.x, vector.y, vector.z


def _rotation(roll: float, pitch: float, yaw: float) -> Rotation:
    """About the fixed axes x, then y, then z (REP-103)."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def _about_z(angle: float) -> Rotation:
    cos, sin = math.cos(angle), math.sin(angle)
    return (cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)


def _matrix(q: Quaternion) -> Rotation:
    """Of a quaternion that need not be normalized; raises Unusable where it is none."""
    norm = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z
    if not 1e-6 < norm < 1e6:
        raise Unusable("its orientation is none")
    s = 2.0 / norm
    return (
        (1.0 - s * (q.y * q.y + q.z * q.z), s * (q.x * q.y - q.z * q.w), s * (q.x * q.z + q.y * q.w)),
        (s * (q.x * q.y + q.z * q.w), 1.0 - s * (q.x * q.x + q.z * q.z), s * (q.y * q.z - q.x * q.w)),
        (s * (q.x * q.z - q.y * q.w), s * (q.y * q.z + q.x * q.w), 1.0 - s * (q.x * q.x + q.y * q.y)),
    )


def _yaw(rotation: Rotation) -> float:
    return normalize_angle(math.atan2(rotation[1][0], rotation[0][0]))


def _turned(rotation: Rotation, vector: Vector) -> Vector:
    x, y, z = (sum(a * b for a, b in zip(row, vector, strict=True)) for row in rotation)
    return x, y, z


def _transposed(rotation: Rotation) -> Rotation:
    (a, b, c), (d, e, f), (g, h, i) = rotation
    return (a, d, g), (b, e, h), (c, f, i)


def _product(first: Rotation, second: Rotation) -> Rotation:
    columns = _transposed(second)
    a, b, c = (_turned(columns, row) for row in first)
    return a, b, c


def _seen(rotation: Rotation, covariance: list[list[float]]) -> list[list[float]]:
    """A covariance along turned axes, R C Rᵀ."""
    if rotation == LEVEL:
        return covariance
    halfway = [[sum(map(mul, row, column)) for column in zip(*covariance, strict=True)] for row in rotation]
    return [[sum(map(mul, row, other)) for other in rotation] for row in halfway]
