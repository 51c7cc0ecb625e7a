"""Finds a base's true wheels and their separation by drives whose ends somebody measures."""

from typing import Annotated

from msgspec import Meta

import robo
from robo import READ_ONLY, Node, Publisher, QoS, Unit, service, subscribe
from robo_messages import Odometry, Point, String, Trigger
from robo_services.calibration import Drive, Found, Step, calibrate, step_between
from robo_services.kinematics import Pose2
from robo_services.planar import yaw_from_quaternion

MOST_STEPS = 200_000
"""Of a drive: an hour of odometry; whoever forgets it does not fill the memory."""

Multiplier = Annotated[float, Meta(ge=0.1, le=10), READ_ONLY]


class CalibrateBase(Node):
    """Record drives by `odom`, and compute from where they truly ended what the base's parameters should be.

    A drive begins at a mark on the floor, by the service `calibration/begin`; you drive. It ends when somebody
    publishes where the base stands, ahead and to the left of the mark, m, on `calibration/measured`.
    """

    class Parameters(robo.Parameters):
        """What the base takes its wheels for, at present."""

        wheel_separation: Annotated[
            float, Meta(ge=0.001, le=100, description="between the wheels, as the base has it"), Unit("m"), READ_ONLY
        ] = 0.3
        wheel_separation_multiplier: Annotated[Multiplier, Meta(description="as the base has it")] = 1.0
        left_wheel_radius_multiplier: Annotated[Multiplier, Meta(description="as the base has it")] = 1.0
        right_wheel_radius_multiplier: Annotated[Multiplier, Meta(description="as the base has it")] = 1.0

    parameters: Parameters

    result = Publisher(String, "calibration/result", qos=QoS.LATCHED)
    """The parameters, as a parameter file has them, after each drive."""

    def on_start(self) -> None:
        """No drive was recorded yet."""
        self._drives: list[Drive] = []
        self._steps: list[Step] | None = None
        """Of the drive that is under way."""
        self._pose: Pose2 | None = None

    @subscribe("odom", depth=100)
    def on_odometry(self, odometry: Odometry) -> None:
        """Go on with the drive."""
        place = odometry.pose.pose
        pose = Pose2(place.position.x, place.position.y, yaw_from_quaternion(place.orientation))
        before, self._pose = self._pose, pose
        if self._steps is None or before is None:
            return
        step = step_between(before, pose)
        if step != Step(0.0, 0.0):
            self._steps.append(step)
        if len(self._steps) > MOST_STEPS:
            self._steps = None
            self.logger.warning("the drive is too long: it is left out")

    @service("calibration/begin")
    def begin(self, _request: Trigger.Request) -> Trigger.Response:
        """Begin a drive; one that has no end yet is forgotten."""
        if self._pose is None:
            return Trigger.Response(success=False, message=f"nothing has come on {self.resolve('odom')}")
        self._steps = []
        measured = self.resolve("calibration/measured")
        return Trigger.Response(message=f"drive; then measure, and publish x and y on {measured}")

    @service("calibration/forget")
    def forget(self, _request: Trigger.Request) -> Trigger.Response:
        """Forget the last drive, whose end was measured wrong."""
        self._steps = None
        if self._drives:
            self._drives.pop()
        return Trigger.Response(message=f"{len(self._drives)} drives are left")

    @subscribe("calibration/measured")
    def on_measured(self, end: Point) -> None:
        """End the drive, and tell what came of all so far."""
        steps, self._steps = self._steps, None
        if not steps:
            self.logger.warning("no drive is under way: call %s first, and drive", self.resolve("calibration/begin"))
            return
        if not (abs(end.x) < 1e3 and abs(end.y) < 1e3):  # NaN too
            self.logger.warning("a base is at no place such as %g, %g: the drive is left out", end.x, end.y)
            return
        self._drives.append(Drive(steps, end.x, end.y))
        p = self.parameters
        found = calibrate(self._drives, p.wheel_separation * p.wheel_separation_multiplier)
        text = self._told(found)
        self.result.publish(String(text))
        count, before, after = len(self._drives), found.before * 100, found.after * 100
        self.logger.info("of %d drives: ends are off by %.1f cm, and by %.1f cm with\n%s", count, before, after, text)

    def _told(self, found: Found) -> str:
        p, by = self.parameters, found.correction
        values = {
            "left_wheel_radius_multiplier": p.left_wheel_radius_multiplier * by.left_radius,
            "right_wheel_radius_multiplier": p.right_wheel_radius_multiplier * by.right_radius,
            "wheel_separation_multiplier": p.wheel_separation_multiplier * by.separation,
        }
        return "\n".join(f"{name}: {value:.4f}" for name, value in values.items())


if __name__ == "__main__":
    robo.run(CalibrateBase)
