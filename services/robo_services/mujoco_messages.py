"""What is measured in MuJoCo, as messages. Pure, but for the generator of noise that is handed in."""

from random import Random

from msgspec import structs

from robo_messages import Header, JointState, LaserScan, Odometry, Quaternion, sensor
from robo_services import mjcf
from robo_services.kinematics import Twist2
from robo_services.mujoco_laser import MujocoLaser
from robo_services.mujoco_physics import MujocoBase
from robo_services.mujoco_sensors import Imu
from robo_services.simulated_errors import ImuNoise, alike, imu_reading
from robo_services.uncertainty import PoseCovariance
from robo_services.wheel_odometry import odometry_message

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


def imu_message(header: Header, felt: Imu, noise: ImuNoise, rng: Random) -> sensor.Imu:
    """What is felt, with noise.

    Args:
        header: when, and the sensor's frame.
        felt: truly.
        noise: how it errs.
        rng: makes the noise.
    """
    return structs.replace(
        imu_reading(header, felt.angular_velocity, felt.linear_acceleration, noise, rng),
        orientation=Quaternion(*felt.orientation),
        orientation_covariance=alike(ORIENTATION_VARIANCE),
    )


def truth_message(header: Header, base_frame: str, base: MujocoBase) -> Odometry:
    """Where the base truly is, in the frame of the header, and how it moves."""
    truth = odometry_message(
        header, base_frame, base.pose, Twist2(base.linear, base.angular), PoseCovariance(), (0.0, 0.0)
    )
    truth.twist.twist.linear.y = base.sideways
    return truth


def joint_state(header: Header, base: MujocoBase) -> JointState:
    """What the wheels do: rad, rad/s, N·m."""
    return JointState(
        header,
        [mjcf.LEFT, mjcf.RIGHT],
        list(base.wheels[:2]),
        list(base.wheel_velocities[:2]),
        list(base.wheel_torques[:2]),
    )
