"""Tracks where a robot is and how far it has driven."""

import math
from typing import Annotated

from msgspec import Meta

import robo
from robo import KEEP_ALL, Health, Node, Publisher, Unit, check, service, subscribe, timer
from robo_messages import Odometry, Point, Trigger
from robo_services.odometry_check import BaseLimits, OdometryTrack, fix_of

TOLD_EVERY = 60.0
"""How often the same doubt is told at most, s."""

DOUBTED_FOR = 10.0
"""For how long odometry that was left out is a warning, s."""


class PositionTracker(Node):
    """Track where the robot is and how far it has driven."""

    class Parameters(robo.Parameters):
        """When to speak up, and what to believe."""

        max_distance: Annotated[float, Meta(gt=0, description="warn beyond this distance"), Unit("m")] = 100.0
        # Named as the base names them, so that one value for all nodes means the same for both.
        max_linear_velocity: Annotated[
            float, Meta(gt=0, description="of the base; odometry that jumps further is left out"), Unit("m/s")
        ] = 10.0
        max_angular_velocity: Annotated[
            float, Meta(gt=0, description="of the base; odometry that turns faster is left out"), Unit("rad/s")
        ] = 20.0
        log_rate: Annotated[float, Meta(ge=0.001, le=1000, description="reports per second"), Unit("Hz")] = 1.0

    parameters: Parameters

    position = Publisher(Point, "current_position", depth=KEEP_ALL)  # every step counts, so nothing may be dropped
    """x, y: the position, m; z: the distance driven so far, m."""

    def on_start(self) -> None:
        """Nothing is known yet."""
        self._track = OdometryTrack()
        self._last: Point | None = None
        self._total = 0.0
        self._warned = False
        self._doubt, self._doubted = "", -math.inf
        self._reported = ""

    @subscribe("odom", depth=KEEP_ALL)
    def on_odometry(self, odometry: Odometry) -> None:
        """Add the step from the last position."""
        p = self.parameters
        limits = BaseLimits(p.max_linear_velocity, p.max_angular_velocity)
        judged = self._track.take(fix_of(odometry, self.clock.monotonic()), limits)
        for step in judged.steps:
            self._total += step.driven
            self._last = Point(step.x, step.y, self._total)
            self.position.publish(self._last)
        if judged.doubt:
            self._doubt, self._doubted = judged.doubt, self.clock.monotonic()
            self.logger.warning(
                "left out odometry that cannot be, %d messages so far: %s", self._track.left_out, judged.doubt,
                throttle=TOLD_EVERY,
            )  # fmt: skip
        if judged.jump:
            self.logger.warning(
                "odometry begins anew, %.3f m from the last position; that counts as no distance",
                judged.jump,
                throttle=TOLD_EVERY,
            )
        if self._total > self.parameters.max_distance and not self._warned:
            self._warned = True
            self.logger.warning(
                "driven %.2f m, more than max_distance = %g m", self._total, self.parameters.max_distance
            )

    @check("odometry")
    def odometry_is_believed(self) -> Health:
        """Whether odometry comes that the base can have driven."""
        left_out = self._track.left_out
        if 0.0 <= self.clock.monotonic() - self._doubted <= DOUBTED_FOR:
            return Health.warn(f"left out what cannot be: {self._doubt}", left_out=left_out)
        if self._last is None:
            return Health.warn(f"nothing has come on {self.resolve('odom')}")
        return Health.ok(left_out=left_out)

    @service("reset_distance")
    def reset(self, _request: Trigger.Request) -> Trigger.Response:
        """Count from 0 m again."""
        driven, self._total, self._warned = self._total, 0.0, False
        return Trigger.Response(message=f"{driven:.3f} m until now")

    @timer(rate="log_rate")
    def report(self) -> None:
        """Say where the robot is, unless that was the last thing said."""
        report = self._report()
        if report != self._reported:
            self._reported = report
            self.logger.info("%s", report)

    def on_stop(self) -> None:
        """Say where it ended."""
        if report := self._report():
            self.logger.info("%s", report)

    def _report(self) -> str:
        if self._last is None:
            return ""
        left_out = f", left out {self._track.left_out} of odometry" if self._track.left_out else ""
        return f"position ({self._last.x:.3f}, {self._last.y:.3f}), distance {self._total:.3f} m{left_out}"


if __name__ == "__main__":
    robo.run(PositionTracker)
