"""Finds out how large a base's wheels are and how far apart, by driving a line and two squares."""

import math
from functools import partial

import robo
from robo import Health, MessageInfo, Node, Publisher, QoS, check, service, subscribe, timer
from robo_messages import Odometry, Point, String, Trigger, Twist, Vector3
from robo_services.arrivals import Arrivals, Newest
from robo_services.base_wheels import Wheels, as_yaml, ask_wheels
from robo_services.calibrate_parameters import CalibrateBaseParameters
from robo_services.calibration import (
    CalibrationError,
    Measured,
    Run,
    Track,
    calibrate,
    doubt,
    driven,
    seen_from,
)
from robo_services.calibration_drive import Drive, Speeds, legs_of
from robo_services.kinematics import Pose2
from robo_services.odometry_check import fix_of
from robo_services.planar import yaw_from_quaternion
from robo_services.safety import is_finite

RATE = 20.0
"""Commands per second."""
KINDS = ("straight", "left", "right")
TRIES = 3
"""After so many runs in a row that were given up it ends."""


class CalibrateBase(Node):
    """Drive a straight line, a square to the left and one to the right, and say by what the wheels are to be corrected.

    Each run begins when the service `~/go` is called, and ends where odometry says that the way is driven. Where the
    base really is then, from where it began, is measured by hand and said on `~/measured`; or somebody tells the truth
    all the time, as a simulator or cameras do: then all runs follow each other. After the last one it prints what
    belongs into the parameter file, and ends. A run that is given up is begun again by `~/go`. It drives behind the
    safety chain: remap its `cmd_vel` to an input of the mux. The odometry is that of the wheels alone, not one that is
    fused, and which wheels it takes the base to have, its sender is asked.
    """

    Parameters = CalibrateBaseParameters
    parameters: CalibrateBaseParameters

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
        self._given_up = 0
        """How many runs in a row."""
        self._sender = ""
        """Of odometry."""
        self._wheels: Wheels | None = None
        self._drive: Drive | None = None
        self._track: Track | None = None
        """Of the run, until it is measured: whoever moves the base on its wheels meanwhile does no harm."""
        self._begun: Odometry | None = None
        """Where it really was then, if somebody says so."""
        if p.ground_truth:
            self.create_subscription(Odometry, p.ground_truth, partial(self._remember, self._truth))
        else:
            self.logger.info("%s: robo service call %s begins it", self._left[0], self.resolve("~/go"))

    @subscribe("odom", sole_source="controller")
    def on_odometry(self, odometry: Odometry, info: MessageInfo) -> None:
        """Follow the wheels; what is not finite counts as silence."""
        self._remember(self._odometry, odometry, info)
        if self._odometry.message is not odometry:
            return
        self._sender = info.source
        if self._track is None:
            return
        pose = _pose_of(odometry)
        if self._track.is_jump(pose):
            self._give_up(f"{self.resolve('odom')} has jumped: was the base reset?")
        else:
            self._track.add(pose)

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
        if self._track is not None:
            return f"say first where it is, on {self.resolve('~/measured')}"
        if not self._left:
            return "all is driven"
        odometry = self._odometry.message
        if (silent := self._is_silent()) or odometry is None:
            return silent
        if hindrance := self._know_wheels():
            return hindrance
        p = self.parameters
        speeds = Speeds(
            linear=p.speed,
            angular=p.turning_speed,
            linear_acceleration=p.acceleration,
            angular_acceleration=p.turning_acceleration,
        )
        self._track, self._begun = Track(), self._truth.message
        self._track.add(_pose_of(odometry))
        self._drive = Drive(legs_of(self._left[0], p.length, p.side), speeds)
        self.logger.info("%s: it drives", self._left[0])
        return ""

    def _know_wheels(self) -> str:
        """Ask whose odometry it is for its wheels; says what hinders."""
        said = self.parameters.wheel_separation
        wheels = ask_wheels(self.session, self._sender) if self._sender else None
        if wheels is None and said > 0:
            wheels = Wheels(self._sender.rpartition("/")[2], said)
        if wheels is None:
            odom, sender = self.resolve("odom"), self._sender or "a plain Zenoh client"
            return (
                f"{sender}, who sends {odom}, does not tell its parameter wheel_separation: if these are not the "
                "wheels, remap odom to theirs; else say -p wheel_separation:=… as odometry takes it, in m"
            )
        if self._runs and wheels != self._wheels:
            return "the base takes its wheels for others than in the runs before: start this anew"
        if wheels != self._wheels:
            text = "%s takes wheels to be %g m apart; its multipliers are %g (left), %g (right) and %g (separation)"
            self.logger.info(text, wheels.node or "odometry", wheels.separation, *wheels.multipliers)
        self._wheels = wheels
        return ""

    @timer(rate=RATE)
    def drive(self) -> None:
        """Drive on, or wait."""
        if not self.parameters.use_sim_time:
            self._arrivals.tick(self._wall.monotonic(), 1.0 / RATE)
        drive, track = self._drive, self._track
        if drive is None or track is None:
            if self.parameters.ground_truth and self._left:
                self._hindrance = self._begin()
            return
        if silent := self._is_silent():
            self._give_up(silent)
            return
        wanted = drive.command(track, 1.0 / RATE)
        if drive.is_stuck():
            where = self.resolve("cmd_vel")
            further = f"it comes no further: does the base follow {where}, and is nothing in its way?"
            self._give_up("it comes to no rest, by its odometry" if drive.is_settling() else further)
            return
        self.command.publish(Twist(Vector3(wanted.linear), Vector3(z=wanted.angular)))
        if drive.is_over():
            self._drive = None
            self._ask(track)

    def _ask(self, track: Track) -> None:
        """Have it measured where the base is."""
        x, y, _ = driven(track.steps, 1.0)
        self.logger.info("%s: by its wheels it is at x = %.3f m, y = %.3f m", self._left[0], x, y)
        if self._begun is not None and self._truth.message is not None:
            self._take(track, seen_from(_pose_of(self._begun), _pose_of(self._truth.message)))
            return
        text = "measure where it is from where it began, x ahead and y to its left, and say it: robo topic pub %s %s %s"
        self.logger.info(text, self.resolve("~/measured"), "geometry/Point", f"'{{x: {x:.3f}, y: {y:.3f}}}' --once")

    @subscribe("~/measured")
    def on_measured(self, point: Point) -> None:
        """Take where the base is, from where the run began, m."""
        if self._track is None or self._drive is not None:
            self.logger.warning("nothing was driven that could be measured", throttle=1.0)
            return
        x, y, _ = driven(self._track.steps, 1.0)
        if not math.hypot(point.x - x, point.y - y) <= 0.5 * max(self.parameters.length, self.parameters.side):
            text = "left out: x = %g m, y = %g m is too far from x = %.3f m, y = %.3f m; say it again"
            self.logger.warning(text, point.x, point.y, x, y)
            return
        self._take(self._track, Measured(point.x, point.y))

    def _take(self, track: Track, measured: Measured) -> None:
        kind = self._left.pop(0)
        self._runs.append(Run(track.steps, measured))
        self._track, self._given_up = None, 0
        self.logger.info("%s: it really is at x = %.3f m, y = %.3f m", kind, measured.x, measured.y)
        if self._left:
            if not self.parameters.ground_truth:
                self.logger.info("%s: robo service call %s begins it", self._left[0], self.resolve("~/go"))
            return
        self._find()

    def _find(self) -> None:
        assert self._wheels is not None
        exact = self.parameters.measuring_error
        try:
            found = calibrate(self._runs, self._wheels.separation, exact)
        except CalibrationError as error:
            self._end(str(error))
            return
        text = as_yaml(self._wheels, found.corrections, found.errors)
        self.calibration.publish(String(text))
        self.logger.info(
            "the runs ended %.3f m from where wheels said; so corrected %.3f m", found.before, found.left_over
        )
        if why := doubt(found, self._runs, exact):
            self._tell_runs()
            self.logger.warning("do not rely on it: %s", why)
        print(text, end="", flush=True)
        self.flush()
        self.shutdown()

    def _give_up(self, why: str) -> None:
        """Leave this run; all of it where nobody stands by to begin it again, or where that has not helped."""
        if self._drive is not None:
            self.command.publish(Twist())
        self._drive = self._track = None
        self._given_up += 1
        if self.parameters.ground_truth or self._given_up == TRIES:
            self._end(why)
            return
        text = "%s; this run is given up, those that were measured are kept; %s: robo service call %s begins it again"
        self.logger.error(text, why, self._left[0], self.resolve("~/go"))

    def _end(self, why: str) -> None:
        self._left.clear()
        self._tell_runs()
        self.logger.error("%s", why)
        self.shutdown(1)

    def _tell_runs(self) -> None:
        """What has been measured so far."""
        for number, (steps, measured) in enumerate(self._runs):
            x, y, _ = driven(steps, 1.0)
            text = "run %d, %s: x = %.3f m, y = %.3f m by its wheels, x = %.3f m, y = %.3f m as measured"
            self.logger.warning(text, number + 1, KINDS[number % len(KINDS)], x, y, measured.x, measured.y)

    @check("run")
    def run(self) -> Health:
        """What it does, or waits for."""
        if self._drive is not None:
            return Health.ok(f"drives: {self._left[0]}")
        if self._hindrance:
            return Health.warn(self._hindrance)
        return Health.ok("waits to be told where the base is" if self._track is not None else "waits to begin")

    def on_stop(self) -> None:
        """Leave the base standing."""
        if self._drive is not None:
            self.command.publish(Twist())


def _pose_of(odometry: Odometry) -> Pose2:
    pose = odometry.pose.pose
    return Pose2(pose.position.x, pose.position.y, yaw_from_quaternion(pose.orientation))


if __name__ == "__main__":
    robo.run(CalibrateBase)
