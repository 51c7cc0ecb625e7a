"""Tracks where a robot is and how far it has driven."""

import math
from typing import Annotated

from msgspec import Meta

import robo
from robo import KEEP_ALL, Node, Publisher, Unit, service, subscribe, timer
from robo_messages import Odometry, Point, Trigger
from robo_services.utils import distance


class PositionTracker(Node):
    """Track where the robot is and how far it has driven."""

    class Parameters(robo.Parameters):
        """When to speak up."""

        max_distance: Annotated[float, Meta(gt=0, description="warn beyond this distance"), Unit("m")] = 100.0
        log_rate: Annotated[float, Meta(ge=0.001, le=1000, description="reports per second"), Unit("Hz")] = 1.0

    parameters: Parameters

    # x, y: the position; z: the distance driven so far. Every step counts, so nothing may be dropped.
    position = Publisher(Point, "current_position", depth=KEEP_ALL)

    def on_start(self) -> None:
        """Nothing is known yet."""
        self._last: Point | None = None
        self._total = 0.0
        self._warned = False

    @subscribe("odom", depth=KEEP_ALL)
    def on_odometry(self, odometry: Odometry) -> None:
        """Add the step from the last position."""
        here = odometry.pose.pose.position
        if not (math.isfinite(here.x) and math.isfinite(here.y)):
            self.logger.warning("ignored a position that is not finite", throttle=5.0)
            return
        if self._last is not None:
            self._total += distance(self._last, here)
        self._last = here
        self.position.publish(Point(here.x, here.y, self._total))
        if self._total > self.parameters.max_distance and not self._warned:
            self._warned = True
            self.logger.warning(
                "driven %.2f m, more than max_distance = %g m", self._total, self.parameters.max_distance
            )

    @service("reset_distance")
    def reset(self, _request: Trigger.Request) -> Trigger.Response:
        """Count from 0 m again."""
        driven, self._total, self._warned = self._total, 0.0, False
        return Trigger.Response(message=f"{driven:.3f} m until now")

    @timer(rate="log_rate")
    def report(self) -> None:
        """Say where the robot is."""
        if self._last is not None:
            self.logger.info("position (%.3f, %.3f), distance %.3f m", self._last.x, self._last.y, self._total)

    def on_stop(self) -> None:
        """Say where it ended."""
        self.report()


if __name__ == "__main__":
    robo.run(PositionTracker)
