"""Makes commands gentle: limits on velocity, acceleration and jerk, and a ramp to standstill when they end."""

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

import robo
from robo import Health, MessageInfo, Node, Publisher, QoS, Unit, check, subscribe, timer
from robo_messages import Odometry, Twist
from robo_services.arrivals import Arrivals, Newest, Unstamped
from robo_services.safety import is_finite
from robo_services.smoothing import SHORTEST_STEP, STANDING, AxisLimits, Limits, Motion, begun_at, step, twist_of

REFUSED_FOR = 5.0
"""For how long a command that was refused is a warning, s."""

LEAST_JERK = 0.01
"""The least limit of jerk, m/s³ or rad/s³: with less nothing would ever stop."""


def _refuse_less_jerk(max_jerk: float) -> None:
    if 0.0 < max_jerk < LEAST_JERK:
        raise ValueError(f"max_jerk = {max_jerk:g}: use 0 for no limit, or at least {LEAST_JERK:g}")


class StraightLimits(msgspec.Struct, frozen=True):
    """What the base may do along x or y."""

    max_velocity: Annotated[
        float, Meta(ge=0, le=100, description="it commands no more, forward or to the left"), Unit("m/s")
    ] = 0.5
    min_velocity: Annotated[
        float, Meta(ge=-100, le=0, description="it commands no less, backward or to the right"), Unit("m/s")
    ] = -0.5
    max_acceleration: Annotated[float, Meta(ge=0.01, le=1000, description="how it gains speed"), Unit("m/s²")] = 2.5
    max_deceleration: Annotated[float, Meta(ge=0.01, le=1000, description="how it loses speed"), Unit("m/s²")] = 2.5
    max_jerk: Annotated[
        float, Meta(ge=0, le=100_000, description="how its acceleration changes; 0 for no limit"), Unit("m/s³")
    ] = 0.0
    deadband: Annotated[float, Meta(ge=0, le=10, description="what is slower is commanded as 0"), Unit("m/s")] = 0.0

    def __post_init__(self) -> None:
        """Refuse what would never stop."""
        _refuse_less_jerk(self.max_jerk)


class TurningLimits(msgspec.Struct, frozen=True):
    """What the base may do around z."""

    max_velocity: Annotated[
        float, Meta(ge=0, le=100, description="it commands no more, to the left"), Unit("rad/s")
    ] = 2.5
    min_velocity: Annotated[
        float, Meta(ge=-100, le=0, description="it commands no less, to the right"), Unit("rad/s")
    ] = -2.5
    max_acceleration: Annotated[float, Meta(ge=0.01, le=1000, description="how it gains speed"), Unit("rad/s²")] = 3.2
    max_deceleration: Annotated[float, Meta(ge=0.01, le=1000, description="how it loses speed"), Unit("rad/s²")] = 3.2
    max_jerk: Annotated[
        float, Meta(ge=0, le=100_000, description="how its acceleration changes; 0 for no limit"), Unit("rad/s³")
    ] = 0.0
    deadband: Annotated[float, Meta(ge=0, le=10, description="what is slower is commanded as 0"), Unit("rad/s")] = 0.0

    def __post_init__(self) -> None:
        """Refuse what would never stop."""
        _refuse_less_jerk(self.max_jerk)


class VelocitySmoother(Node):
    """Pass commands on so that the base changes its velocity gently; bring it to a stand when they end.

    A timer sends, not the arrival of commands. Ages count from when a command was sent, and what is passed on has the
    age of the command that it comes from. Once the base stands and nobody commands it, nothing is sent.
    """

    class Parameters(robo.Parameters):
        """How gently."""

        smoothing_frequency: Annotated[float, Meta(ge=1, le=1000, description="commands per second"), Unit("Hz")] = 20.0
        scale_velocities: Annotated[
            bool, Meta(description="what one axis cannot do slows the others down as much: the base keeps to its curve")
        ] = False
        feedback: Annotated[
            Literal["open_loop", "closed_loop"],
            Meta(description="whether a step begins at the last command or at the velocity in odometry"),
        ] = "open_loop"
        velocity_timeout: Annotated[
            float, Meta(ge=0.01, le=10, description="an older command is none: it slows down to a stand"), Unit("s")
        ] = 0.3
        odom_timeout: Annotated[
            float, Meta(ge=0.01, le=10, description="older odometry is none: the loop is open"), Unit("s")
        ] = 0.25
        unstamped: Unstamped = True
        linear: StraightLimits = StraightLimits()
        lateral: StraightLimits = StraightLimits(max_velocity=0.0, min_velocity=0.0)
        angular: TurningLimits = TurningLimits()

    parameters: Parameters

    smoothed = Publisher(Twist, "cmd_vel_smoothed", qos=QoS.COMMAND)
    """What the base is to do, m/s and rad/s; one 0 when it stands and commands have ended, then nothing."""

    def on_start(self) -> None:
        """Nothing is commanded yet."""
        self._arrivals = Arrivals(unstamped=self.parameters.unstamped)
        self._wall = self.clock.wall
        self._command: Newest[Twist] = Newest()
        self._odometry: Newest[Odometry] = Newest()
        self._motion = STANDING
        self._silent = True
        self._stepped = self.clock.monotonic()
        self._refused, self._refused_at = 0, -math.inf

    @subscribe("cmd_vel", qos=QoS.COMMAND)
    def on_command(self, twist: Twist, info: MessageInfo) -> None:
        """Remember the newest command and when it was sent; one that is not finite counts as silence."""
        if is_finite(twist):
            now = self.clock.monotonic()
            self._command.take(twist, self._arrivals.sent(info, now, self._wall.monotonic()), now)
        else:
            self._refused += 1
            self._refused_at = self.clock.monotonic()
            text = "ignored a command that holds NaN or an infinity, %d so far"
            self.logger.warning(text, self._refused, throttle=5.0)

    @subscribe("odom", depth=1)
    def on_odometry(self, odometry: Odometry, info: MessageInfo) -> None:
        """Remember how fast the base really is; what is not finite counts as silence."""
        if is_finite(odometry.twist.twist):
            now = self.clock.monotonic()
            self._odometry.take(odometry, self._arrivals.sent(info, now, self._wall.monotonic()), now)

    @timer(rate="smoothing_frequency")
    def smooth(self) -> None:
        """Take one step towards what is commanded, or towards standing still."""
        now, p = self.clock.monotonic(), self.parameters
        period = 1.0 / p.smoothing_frequency
        if not p.use_sim_time:
            self._arrivals.tick(self._wall.monotonic(), period)
        elapsed = now - self._stepped
        if 0.0 <= elapsed < SHORTEST_STEP:
            return  # a tick that came late, and the next one just behind it
        self._stepped = now
        # Time that was missed is not made up for, or the base would be told to jump. Simulated time may step back.
        dt = min(elapsed, period) if elapsed > 0.0 else period

        age = self._command.age(now)
        command = self._command.message if age <= p.velocity_timeout else None
        if command is None and self._silent:
            return
        wanted = Twist() if command is None else command
        limits = _limits_of(p)
        self._motion = step(self._begun(wanted, limits, now), wanted, limits, dt)
        twist = twist_of(self._motion, limits)
        self._silent = command is None and twist == Twist()
        if self._silent:
            self._motion = STANDING
        # A command that is passed on stays as old as it is: timeouts of a chain do not add up. To slow down is its own.
        self.smoothed.publish(twist, 0.0 if command is None else self._command.age(self.clock.monotonic()))

    def _begun(self, wanted: Twist, limits: Limits, now: float) -> Motion:
        """The motion from which the next step begins."""
        p, odometry = self.parameters, self._odometry.message
        if p.feedback == "open_loop":
            return self._motion
        if odometry is None or self._odometry.age(now) > p.odom_timeout:
            text = "no odometry on %s that is newer than %g s: the loop is open"
            self.logger.warning(text, self.resolve("odom"), p.odom_timeout, throttle=5.0)
            return self._motion
        return begun_at(self._motion, odometry.twist.twist, wanted, limits)

    @check("commands")
    def commands_are_finite(self) -> Health:
        """Whether commands were refused."""
        if 0.0 <= self.clock.monotonic() - self._refused_at <= REFUSED_FOR:
            return Health.warn("ignores commands that hold NaN or an infinity", refused=self._refused)
        return Health.ok("nobody commands" if self._silent else "", refused=self._refused)

    @check("feedback")
    def loop_is_closed(self) -> Health:
        """Whether there is the odometry that a closed loop needs."""
        p, age = self.parameters, self._odometry.age(self.clock.monotonic())
        if p.feedback == "closed_loop" and age > p.odom_timeout:
            return Health.warn(f"the loop is open: no odometry on {self.resolve('odom')}", age=f"{age:.3g} s")
        return Health.ok(p.feedback.replace("_", " "))

    def on_stop(self) -> None:
        """Leave the robot standing."""
        self.smoothed.publish(Twist())


def _limits_of(p: VelocitySmoother.Parameters) -> Limits:
    return Limits(
        linear=_axis_limits_of(p.linear),
        lateral=_axis_limits_of(p.lateral),
        angular=_axis_limits_of(p.angular),
        scale_velocities=p.scale_velocities,
    )


def _axis_limits_of(axis: StraightLimits | TurningLimits) -> AxisLimits:
    return AxisLimits(
        max_velocity=axis.max_velocity,
        min_velocity=axis.min_velocity,
        max_acceleration=axis.max_acceleration,
        max_deceleration=axis.max_deceleration,
        max_jerk=axis.max_jerk or math.inf,
        deadband=axis.deadband,
    )


if __name__ == "__main__":
    robo.run(VelocitySmoother)
