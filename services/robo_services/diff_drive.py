"""A simulated differential-drive base: pure, stepped from outside, the same for the same seed."""

import msgspec

from robo_services.kinematics import Pose2, advance
from robo_services.limits import clamp, ramp
from robo_services.world import World, clearance


class BaseLimits(msgspec.Struct, frozen=True, kw_only=True):
    """What the base can do."""

    radius: float
    """m."""
    max_linear_velocity: float
    """m/s."""
    max_angular_velocity: float
    """rad/s."""
    linear_acceleration: float
    """m/s²."""
    linear_deceleration: float
    """m/s²."""
    angular_acceleration: float
    """rad/s², speeding up and slowing down."""


class DiffDrive:
    """Where the base is and how fast it moves."""

    def __init__(self, world: World, limits: BaseLimits, pose: Pose2) -> None:
        self.pose = pose
        self.linear = 0.0
        """m/s."""
        self.angular = 0.0
        """rad/s."""
        self.bumped = False
        """Whether it pushed against something in the last step."""
        self._limits = limits
        self._segments = world.segments()
        self._circles = world.circles

    def step(self, linear: float, angular: float, dt: float) -> None:
        """Drive for `dt` s towards the wanted velocities (m/s, rad/s); nothing is driven through."""
        limits = self._limits
        wanted = clamp(linear, limits.max_linear_velocity)
        self.linear = ramp(self.linear, wanted, dt, limits.linear_acceleration, limits.linear_deceleration)
        turning = clamp(angular, limits.max_angular_velocity)
        self.angular = ramp(self.angular, turning, dt, limits.angular_acceleration, limits.angular_acceleration)
        target = advance(self.pose, self.linear, self.angular, dt)
        self.bumped = self.linear != 0.0 and self._blocked(target)
        if self.bumped:
            self.linear = 0.0
            target = Pose2(self.pose.x, self.pose.y, target.yaw)
        self.pose = target

    def _blocked(self, target: Pose2) -> bool:
        """Whether the base would touch something there and be nearer to it than now."""
        room = clearance(self._segments, self._circles, target.x, target.y)
        return room < self._limits.radius and room < clearance(self._segments, self._circles, self.pose.x, self.pose.y)
