"""Finds out how large a base's wheels are and how far apart, by driving a line and two squares."""

import math
from functools import partial
from typing import Annotated

from msgspec import Meta

import robo
from robo import (
    READ_ONLY,
    Health,
    MessageInfo,
    Node,
    Publisher,
    QoS,
    Subscribes,
    Unit,
    check,
    service,
    subscribe,
    timer,
)
from robo_messages import Odometry, Point, String, Trigger, Twist, Vector3
from robo_services.arrivals import Arrivals, Newest
from robo_services.calibration import (
    Calibration,
    CalibrationError,
    Corrections,
    Measured,
    Run,
    Track,
    calibrate,
    driven,
    seen_from,
)
from robo_services.calibration_drive import Drive, Speeds, legs_of
from robo_services.kinematics import Pose2, Twist2
from robo_services.odometry_check import fix_of
from robo_services.planar import yaw_from_quaternion
from robo_services.safety import is_finite

RATE = 20.0
"""Commands per second."""
KINDS = ("straight", "left", "right")

Multiplier = Annotated[float, Meta(ge=0.1, le=10), READ_ONLY]


class CalibrateBase(Node):
    """Drive a straight line, a square to the left and one to the right, and say by what the wheels are to be corrected.

    Each run begins when the service `~/go` is called, and ends where odometry says that the way is driven. Where the
    base really is then, from where it began, is measured by hand and said on `~/measured`; or somebody tells the truth
    all the time, as a simulator or cameras do: then all runs follow each other. After the last one it prints what
    belongs into the parameter file, and ends. It drives behind the safety chain: remap its `cmd_vel` to an input of
    the mux. The odometry is that of the wheels alone, not one that is fused.
    """

    class Parameters(robo.Parameters):
        """The ways, and what is known of the base."""

        length: Annotated[float, Meta(ge=0.5, le=100, description="of the straight line"), Unit("m"), READ_ONLY] = 4.0
        side: Annotated[float, Meta(ge=0.3, le=100, description="of the squares"), Unit("m"), READ_ONLY] = 2.0
        repeats: Annotated[int, Meta(ge=1, le=20, description="how often all three are driven"), READ_ONLY] = 1
        wheel_separation: Annotated[
            float, Meta(ge=0.001, le=100, description="as odometry takes it"), Unit("m"), READ_ONLY
        ] = 0.3
        wheel_separation_multiplier: Annotated[Multiplier, Meta(description="as odometry has it so far")] = 1.0
        left_wheel_radius_multiplier: Annotated[Multiplier, Meta(description="likewise")] = 1.0
        right_wheel_radius_multiplier: Annotated[Multiplier, Meta(description="likewise")] = 1.0
        controller: Annotated[
            str, Meta(min_length=1, description="whose parameters they are, in what it prints"), READ_ONLY
        ] = "diff_drive_controller"
        ground_truth: Annotated[
            str,
            Meta(description="who says where the base really is, as odometry; empty: measured by hand"),
            Subscribes(Odometry),
            READ_ONLY,
        ] = ""
        speed: Annotated[float, Meta(ge=0.05, le=2, description="how fast it drives"), Unit("m/s")] = 0.2
        turning_speed: Annotated[float, Meta(ge=0.1, le=3, description="how fast it turns"), Unit("rad/s")] = 0.5
        acceleration: Annotated[
            float, Meta(ge=0.05, le=5, description="how it gains and loses speed"), Unit("m/s²")
        ] = 0.2
        turning_acceleration: Annotated[
            float, Meta(ge=0.1, le=10, description="how its turning changes"), Unit("rad/s²")
        ] = 0.5
        odom_timeout: Annotated[
            float, Meta(ge=0.05, le=10, description="without odometry for so long it stops and ends"), Unit("s")
        ] = 0.5

    parameters: Parameters

    command = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND)
    """How it drives, m/s and rad/s; remap it to an input of the mux."""
    calibration = Publisher(String, "~/calibration", latched=True)
    """What was found, as YAML for a parameter file."""

    def on_start(self) -> None:
        """Nothing was driven yet."""
        p = self.parameters
        self._wall = self.clock.wall
        self._arrivals = Arrivals(unstamped=True)
        self._odometry: Newest[Odometry] = Newest()
        self._truth: Newest[Odometry] = Newest()
        self._hindrance = ""
        self._left = [kind for _ in range(p.repeats) for kind in KINDS]
        self._runs: list[Run] = []
        self._drive: Drive | None = None
        self._driven: Track | None = None
        """Of a run that is over and waits to be measured."""
        self._begun: Odometry | None = None
        """Where it really was then, if somebody says so."""
        if p.ground_truth:
            self.create_subscription(Odometry, p.ground_truth, partial(self._remember, self._truth))
        else:
            self.logger.info("%s: robo service call %s begins it", self._left[0], self.resolve("~/go"))

    @subscribe("odom")
    def on_odometry(self, odometry: Odometry, info: MessageInfo) -> None:
        """Follow the wheels; what is not finite counts as silence."""
        self._remember(self._odometry, odometry, info)
        if self._drive is not None and self._odometry.message is odometry:
            self._track.add(_pose_of(odometry))

    def _remember(self, newest: Newest[Odometry], odometry: Odometry, info: MessageInfo) -> None:
        if fix_of(odometry, 0.0) is not None and is_finite(odometry.twist.twist):
            now = self.clock.monotonic()
            newest.take(odometry, self._arrivals.sent(info, now, self._wall.monotonic()), now)

    def _is_silent(self) -> str:
        """Who is silent of those that have to be heard; empty for nobody."""
        p, now = self.parameters, self.clock.monotonic()
        if self._odometry.age(now) > p.odom_timeout:
            return f"nothing new on {self.resolve('odom')}"
        if p.ground_truth and self._truth.age(now) > p.odom_timeout:
            return f"nothing new on {self.resolve(p.ground_truth)}"
        return ""

    @service("~/go")
    def go(self, _request: Trigger.Request) -> Trigger.Response:
        """Begin the next run: the base moves."""
        if hindrance := self._begin():
            return Trigger.Response(success=False, message=hindrance)
        return Trigger.Response(message=f"drives: {self._left[0]}")

    def _begin(self) -> str:
        """Begin the next run; says why not."""
        if self._drive is not None:
            return f"it drives already: {self._left[0]}"
        if self._driven is not None:
            return f"say first where it is, on {self.resolve('~/measured')}"
        if not self._left:
            return "all is driven"
        if silent := self._is_silent():
            return silent
        p = self.parameters
        speeds = Speeds(
            linear=p.speed,
            angular=p.turning_speed,
            linear_acceleration=p.acceleration,
            angular_acceleration=p.turning_acceleration,
        )
        self._track, self._begun = Track(), self._truth.message
        self._drive = Drive(legs_of(self._left[0], p.length, p.side), speeds)
        self.logger.info("%s: it drives", self._left[0])
        return ""

    @timer(rate=RATE)
    def drive(self) -> None:
        """Drive on, or wait."""
        if not self.parameters.use_sim_time:
            self._arrivals.tick(self._wall.monotonic(), 1.0 / RATE)
        drive, odometry = self._drive, self._odometry.message
        if drive is None:
            if self.parameters.ground_truth and self._left:
                self._hindrance = self._begin()
            return
        silent = self._is_silent()
        if silent or odometry is None:
            self._give_up(silent)
            return
        twist = odometry.twist.twist
        wanted = drive.command(self._track, Twist2(twist.linear.x, twist.angular.z), 1.0 / RATE)
        if drive.is_stuck():
            where = self.resolve("cmd_vel")
            self._give_up(f"it comes no further: does the base follow {where}, and is nothing in its way?")
            return
        self.command.publish(Twist(Vector3(wanted.linear), Vector3(z=wanted.angular)))
        if drive.is_over():
            self._drive, self._driven = None, self._track
            self._ask()

    def _ask(self) -> None:
        """Have it measured where the base is."""
        assert self._driven is not None
        x, y, _ = driven(self._driven.steps, 1.0)
        self.logger.info("%s: by its wheels it is at x = %.3f m, y = %.3f m", self._left[0], x, y)
        if self._begun is not None and self._truth.message is not None:
            self._take(seen_from(_pose_of(self._begun), _pose_of(self._truth.message)))
            return
        text = "measure where it is from where it began, x ahead and y to its left, and say it: robo topic pub %s %s %s"
        self.logger.info(text, self.resolve("~/measured"), "geometry/Point", f"'{{x: {x:.3f}, y: {y:.3f}}}' --once")

    @subscribe("~/measured")
    def on_measured(self, point: Point) -> None:
        """Take where the base is, from where the run began, m."""
        if self._driven is None:
            self.logger.warning("nothing was driven that could be measured", throttle=1.0)
            return
        x, y, _ = driven(self._driven.steps, 1.0)
        if not math.hypot(point.x - x, point.y - y) <= 0.5 * max(self.parameters.length, self.parameters.side):
            text = "left out: x = %g m, y = %g m is too far from x = %.3f m, y = %.3f m; say it again"
            self.logger.warning(text, point.x, point.y, x, y)
            return
        self._take(Measured(point.x, point.y))

    def _take(self, measured: Measured) -> None:
        assert self._driven is not None
        kind = self._left.pop(0)
        self._runs.append(Run(self._driven.steps, measured))
        self._driven = None
        self.logger.info("%s: it really is at x = %.3f m, y = %.3f m", kind, measured.x, measured.y)
        if self._left:
            if not self.parameters.ground_truth:
                self.logger.info("%s: robo service call %s begins it", self._left[0], self.resolve("~/go"))
            return
        self._find()

    def _find(self) -> None:
        p = self.parameters
        try:
            found = calibrate(self._runs, p.wheel_separation * p.wheel_separation_multiplier)
        except CalibrationError as error:
            self._give_up(str(error))
            return
        text = _as_yaml(p, found)
        self.calibration.publish(String(text))
        self.logger.info(
            "the runs ended %.3f m from where wheels said; so corrected %.3f m", found.before, found.left_over
        )
        print(text, end="", flush=True)
        self.flush()
        self.shutdown()

    def _give_up(self, why: str) -> None:
        self._drive = None
        self.command.publish(Twist())
        self.logger.error("%s", why)
        self.shutdown(1)

    @check("run")
    def run(self) -> Health:
        """What it does, or waits for."""
        if self._drive is not None:
            return Health.ok(f"drives: {self._left[0]}")
        if self._hindrance:
            return Health.warn(self._hindrance)
        return Health.ok("waits to be told where the base is" if self._driven is not None else "waits to begin")

    def on_stop(self) -> None:
        """Leave the base standing."""
        if self._drive is not None:
            self.command.publish(Twist())


def _pose_of(odometry: Odometry) -> Pose2:
    pose = odometry.pose.pose
    return Pose2(pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation))


def _as_yaml(p: CalibrateBase.Parameters, found: Calibration) -> str:
    """For a parameter file."""
    left, right, separation = found.corrections
    now = Corrections(
        left * p.left_wheel_radius_multiplier,
        right * p.right_wheel_radius_multiplier,
        separation * p.wheel_separation_multiplier,
    )
    lines = (
        f"{p.controller}:",
        f"  left_wheel_radius_multiplier: {now.left:.5f}",
        f"  right_wheel_radius_multiplier: {now.right:.5f}",
        f"  wheel_separation_multiplier: {now.separation:.5f}",
    )
    return "".join(f"{line}\n" for line in lines)


if __name__ == "__main__":
    robo.run(CalibrateBase)
