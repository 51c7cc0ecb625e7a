"""What is measured in MuJoCo, as messages. Pure, but for the generator of noise that is handed in."""

from random import Random

from robo_messages import Header, JointState, LaserScan, Quaternion, Vector3, sensor
from robo_services import mjcf
from robo_services.mujoco_laser import MujocoLaser
from robo_services.mujoco_physics import MujocoBase
from robo_services.mujoco_sensors import Imu

ORIENTATION_VARIANCE = 1e-6
"""The orientation is true; a variance of 0 would say that nobody knows it, rad²."""


def scan_message(header: Header, laser: MujocoLaser, period: float) -> LaserScan:
    """What the laser sees now; `period` between two scans, s."""
    return LaserScan(
        header=header,
        angle_min=laser.angle_min,
        angle_max=laser.angle_min + (laser.rays - 1) * laser.angle_increment,
        angle_increment=laser.angle_increment,
        scan_time=period,
        range_min=laser.range_min,
        range_max=laser.range_max,
        ranges=laser.scan(),
    )


def imu_message(header: Header, felt: Imu, gyro_noise: float, accelerometer_noise: float, rng: Random) -> sensor.Imu:
    """What is felt, with noise.

    Args:
        header: when, and the sensor's frame.
        felt: truly.
        gyro_noise: standard deviation of an angular velocity, rad/s.
        accelerometer_noise: of an acceleration, m/s².
        rng: makes the noise.
    """
    turning = [value + rng.gauss(0.0, gyro_noise) for value in felt.angular_velocity]
    pulling = [value + rng.gauss(0.0, accelerometer_noise) for value in felt.linear_acceleration]
    return sensor.Imu(
        header=header,
        orientation=Quaternion(*felt.orientation),
        orientation_covariance=_diagonal(ORIENTATION_VARIANCE),
        angular_velocity=Vector3(*turning),
        angular_velocity_covariance=_diagonal(gyro_noise**2),
        linear_acceleration=Vector3(*pulling),
        linear_acceleration_covariance=_diagonal(accelerometer_noise**2),
    )


def joint_state(header: Header, base: MujocoBase) -> JointState:
    """What the wheels do: rad, rad/s, N·m."""
    return JointState(
        header,
        [mjcf.LEFT, mjcf.RIGHT],
        list(base.wheels[:2]),
        list(base.wheel_velocities[:2]),
        list(base.wheel_torques[:2]),
    )


def _diagonal(variance: float) -> tuple[float, ...]:
    return (variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance)
