"""What a simulated base knows of its motion: wheels that are not as they are said to be, and an IMU. Pure.

The same for the same seed.
"""

import math
import random
from typing import Annotated

import msgspec
from msgspec import Meta

from robo import READ_ONLY, Unit
from robo_messages import Header, Imu, Odometry, Vector3
from robo_services.drives import Ackermann, DiffDrive, Wheels
from robo_services.kinematics import Pose2, Twist2
from robo_services.uncertainty import NOISE
from robo_services.wheel_odometry import WheelOdometry

GRAVITY = 9.80665
"""m/s²."""

_Share = Annotated[float, Meta(ge=-0.5, le=1), READ_ONLY]


class WheelErrors(msgspec.Struct, frozen=True):
    """How the wheels differ from what odometry takes them for; of a differential drive or a skid steer."""

    left_wheel_radius: Annotated[
        _Share, Meta(description="by this share the wheel is larger than it is said to be")
    ] = 0.0
    right_wheel_radius: Annotated[_Share, Meta(description="likewise")] = 0.0
    wheel_separation: Annotated[_Share, Meta(description="by this share the wheels are further apart")] = 0.0
    slip: Annotated[
        float, Meta(ge=0, le=1, description="standard deviation of a wheel's way after 1 m"), Unit("m"), READ_ONLY
    ] = 0.0

    def __bool__(self) -> bool:
        return any((self.left_wheel_radius, self.right_wheel_radius, self.wheel_separation, self.slip))

    def real(self, drive: DiffDrive) -> DiffDrive:
        """The drive as it is, by what it is said to be."""
        return msgspec.structs.replace(
            drive,
            left_wheel_radius_multiplier=drive.left_wheel_radius_multiplier * (1 + self.left_wheel_radius),
            right_wheel_radius_multiplier=drive.right_wheel_radius_multiplier * (1 + self.right_wheel_radius),
            wheel_separation=drive.wheel_separation * (1 + self.wheel_separation),
        )


class ErringWheels:
    """Odometry of a base whose wheels err."""

    def __init__(self, drive: DiffDrive | Ackermann, errors: WheelErrors, pose: Pose2, seed: int) -> None:
        """
        Args:
            drive: as it is said to be.
            errors: how it differs from that.
            pose: where it begins.
            seed: of what slips.

        Raises:
            ValueError: of a car's errors nothing is simulated.
        """
        if isinstance(drive, Ackermann):
            raise ValueError("errors are simulated of the drives diff and skid, not of ackermann")
        self.wheels = Wheels(0.0, 0.0)
        """How far they have turned, rad."""
        self._odometry = WheelOdometry(drive, NOISE, pose=pose)
        self._real = errors.real(drive)
        self._slip = errors.slip
        self._random = random.Random(f"wheels {seed}")

    def step(self, way: float, turn: float, dt: float) -> None:
        """The base really moves by `way` m and turns by `turn` rad, in `dt` s."""
        rolled = self._real.wheels(Twist2(way, turn))
        left, right = self._slipped(rolled.left), self._slipped(rolled.right)
        self.wheels = Wheels(self.wheels.left + left, self.wheels.right + right)
        self._odometry.roll(Wheels(left, right), dt)

    def message(self, header: Header, base_frame: str) -> Odometry:
        """What the wheels say, in the frame of the header."""
        return self._odometry.message(header, base_frame)

    def _slipped(self, turned: float) -> float:
        radius = self._real.wheel_radius
        if not self._slip or not turned:
            return turned
        return turned + self._random.gauss(0.0, self._slip * math.sqrt(abs(turned) * radius)) / radius


class ImuNoise(msgspec.Struct, frozen=True):
    """How a simulated IMU errs, by the standard deviation of each reading."""

    gyro: Annotated[float, Meta(ge=0, le=10, description="of the turning"), Unit("rad/s"), READ_ONLY] = 0.005
    gyro_bias: Annotated[
        float, Meta(ge=-1, le=1, description="how much too fast it says that the base turns"), Unit("rad/s"), READ_ONLY
    ] = 0.0
    acceleration: Annotated[float, Meta(ge=0, le=100, description="of accelerations"), Unit("m/s²"), READ_ONLY] = 0.1


class SimulatedImu:
    """An IMU in the middle of the base; how it stands in the world it does not say."""

    def __init__(self, noise: ImuNoise, seed: int) -> None:
        self._noise = noise
        self._random = random.Random(f"imu {seed}")
        self._linear = 0.0

    def message(self, header: Header, linear: float, turn: float, dt: float) -> Imu:
        """What it measures.

        Args:
            header: when, and in which frame.
            linear: how fast the base is now, m/s.
            turn: by how much it has turned since the last reading, rad.
            dt: how long ago that was, s.
        """
        gained, self._linear = (linear - self._linear) / dt, linear
        rate = turn / dt
        return imu_reading(header, (0.0, 0.0, rate), (gained, linear * rate, GRAVITY), self._noise, self._random)


def imu_reading(
    header: Header,
    turning: tuple[float, float, float],
    pulling: tuple[float, float, float],
    noise: ImuNoise,
    rng: random.Random,
) -> Imu:
    """What an IMU says that does not say how it stands.

    Args:
        header: when, and in which frame.
        turning: how it truly turns, rad/s.
        pulling: what truly speeds it up, and holds it against gravity, m/s².
        noise: how it errs.
        rng: makes the noise.
    """
    x, y, z = (rng.gauss(one, noise.gyro) for one in turning)
    return Imu(
        header,
        orientation_covariance=(-1.0, *(0.0,) * 8),  # REP-145: it is not measured
        angular_velocity=Vector3(x, y, z + noise.gyro_bias),
        angular_velocity_covariance=alike(noise.gyro**2),
        linear_acceleration=Vector3(*(rng.gauss(one, noise.acceleration) for one in pulling)),
        linear_acceleration_covariance=alike(noise.acceleration**2),
    )


def alike(variance: float) -> tuple[float, ...]:
    """A covariance of three numbers; never of zeros, which would say that it is not known."""
    variance = max(variance, 1e-12)
    return tuple(variance if i % 4 == 0 else 0.0 for i in range(9))
