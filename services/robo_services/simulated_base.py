"""A simulated base: pure, stepped from outside, the same for the same seed."""

import msgspec

from robo_services.drives import Ackermann, DiffDrive, Wheels
from robo_services.kinematics import Pose2, Twist2, advance
from robo_services.limits import clamp, ramp
from robo_services.world import World, clearance

DRIVE = DiffDrive(wheel_separation=0.3, wheel_radius=0.05)


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
    """rad/s², speeding up and slowing down; a car's turning follows its speed and its steering instead."""


class SimulatedBase:
    """Where the base is and how fast it moves."""

    def __init__(self, world: World, limits: BaseLimits, pose: Pose2, drive: DiffDrive | Ackermann = DRIVE) -> None:
        self.pose = pose
        self.linear = 0.0
        """m/s."""
        self.angular = 0.0
        """rad/s."""
        self.wheels = Wheels(0.0, 0.0)
        """How far they have turned, rad, and the steering."""
        self.bumped = False
        """Whether it pushed against something in the last step."""
        self._limits = limits
        self._drive = drive
        self._segments = world.segments()
        self._circles = world.circles

    def step(self, linear: float, angular: float, dt: float) -> None:
        """Drive for `dt` s towards the wanted velocities (m/s, rad/s); nothing is driven through."""
        steering = self.wheels.steering
        if isinstance(self._drive, Ackermann):
            steering = self._steer(self._drive, Twist2(linear, angular), dt)
        else:
            self._gain_speed(linear, self._limits.max_linear_velocity, dt)
            turning, change = clamp(angular, self._limits.max_angular_velocity), self._limits.angular_acceleration
            self.angular = ramp(self.angular, turning, dt, change, change)
        target = advance(self.pose, self.linear, self.angular, dt)
        self.bumped = self.linear != 0.0 and self._blocked(target)
        if self.bumped:
            self.linear = 0.0
            if isinstance(self._drive, Ackermann):
                self.angular, target = 0.0, self.pose
            else:
                target = Pose2(self.pose.x, self.pose.y, target.yaw)
        self.pose = target
        rates = self._drive.wheels(Twist2(self.linear, self.angular))
        self.wheels = Wheels(self.wheels.left + rates.left * dt, self.wheels.right + rates.right * dt, steering)

    def _gain_speed(self, linear: float, fastest: float, dt: float) -> None:
        limits = self._limits
        wanted = clamp(linear, fastest)
        self.linear = ramp(self.linear, wanted, dt, limits.linear_acceleration, limits.linear_deceleration)

    def _steer(self, car: Ackermann, wanted: Twist2, dt: float) -> float:
        """Steer, and drive no faster than it may turn, on the curve of now or of then. Returns the steering, rad."""
        wanted, before = car.limited(wanted), self.wheels.steering
        there = car.wheels(wanted, before).steering
        steering = car.steered(before, there, dt)
        sharpest = max(abs(car.curvature(steering)), abs(car.curvature(there)), 1e-9)
        fastest = min(self._limits.max_linear_velocity, self._limits.max_angular_velocity / sharpest)
        self._gain_speed(wanted.linear, fastest, dt)
        self.angular = self.linear * car.curvature((before + steering) / 2)
        return steering

    def _blocked(self, target: Pose2) -> bool:
        """Whether the base would touch something there and be nearer to it than now."""
        room = clearance(self._segments, self._circles, target.x, target.y)
        return room < self._limits.radius and room < clearance(self._segments, self._circles, self.pose.x, self.pose.y)
