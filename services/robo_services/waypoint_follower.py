"""Drives through waypoints: from a parameter, a file, a topic or the action `follow_waypoints`."""

from collections.abc import Generator
from typing import Annotated

from msgspec import Meta, field

import robo
from robo import (
    READ_ONLY,
    GoalCanceled,
    Health,
    MessageInfo,
    Node,
    Publisher,
    QoS,
    Unit,
    action,
    check,
    subscribe,
    timer,
)
from robo.tf import TransformListener
from robo_messages import (
    DiagnosticStatus,
    FollowWaypoints,
    Header,
    KeyValue,
    Odometry,
    Path,
    Point,
    Pose,
    PoseStamped,
    Twist,
    Vector3,
    WaypointStatus,
)
from robo_services import courses
from robo_services.arrivals import Arrivals, Unstamped
from robo_services.courses import Course, CourseError, Orientations
from robo_services.planar import quaternion_from_yaw
from robo_services.pursuit import EXACT_YAW, STAND, Follower, Limits
from robo_services.routes import Route
from robo_services.whereabouts import Lost, Whereabouts

HELD_UP = 2.0
"""Who has not got on for so long says so, s."""
WHO_KNOWS = "mux_state and safety_state say who holds it up"
MOST_SHOWN = 20
"""Of the waypoints that were given up the last so many are told."""

Tolerance = Annotated[float, Meta(ge=courses.LEAST_TOLERANCE, le=100), Unit("m")]
Acceleration = Annotated[float, Meta(ge=0.01, le=100), Unit("m/s²")]


class WaypointFollower(Node):
    """Drive through waypoints, none of which is cut off; say how far it is and what holds it up.

    It commands while it follows a course, sends one 0 at its end or when it does not know where it is, and then is
    silent, so that another one may drive. A new course takes the place of the one before.
    """

    class Parameters(robo.Parameters):
        """Where to, and how."""

        waypoints: Annotated[
            list[list[float]], Meta(description="[x, y] or [x, y, yaw] of each, m and rad; empty: none"), READ_ONLY
        ] = field(default_factory=list)
        file: Annotated[str, Meta(description="YAML file of waypoints, in their place"), READ_ONLY] = ""
        frame: Annotated[
            str, Meta(description="the frame of waypoints that name none; empty: that of odometry"), READ_ONLY
        ] = ""
        laps: Annotated[int, Meta(ge=0, le=1_000_000, description="how often; 0 for ever"), READ_ONLY] = 1
        orientations: Annotated[
            Orientations, Meta(description="which poses of a path or an action say how to stand there")
        ] = "goal"
        tolerance: Annotated[Tolerance, Meta(description="how near a waypoint is passed at least")] = 0.25
        goal_tolerance: Annotated[Tolerance, Meta(description="the same where it stands")] = 0.1
        yaw_tolerance: Annotated[
            float, Meta(ge=EXACT_YAW, le=3, description="of a yaw that is asked for"), Unit("rad")
        ] = 0.05
        speed: Annotated[float, Meta(ge=0.01, le=100, description="it drives no faster"), Unit("m/s")] = 0.5
        min_speed: Annotated[float, Meta(ge=0.001, le=10, description="no approach is slower"), Unit("m/s")] = 0.05
        turn_speed: Annotated[float, Meta(ge=0.01, le=100, description="it turns no faster"), Unit("rad/s")] = 1.0
        max_acceleration: Annotated[Acceleration, Meta(description="how it gains speed")] = 0.5
        max_deceleration: Annotated[Acceleration, Meta(description="how it loses speed")] = 0.5
        max_lateral_acceleration: Annotated[Acceleration, Meta(description="in curves, v² / r")] = 0.5
        max_angular_acceleration: Annotated[
            float, Meta(ge=0.01, le=1000, description="how its turning changes"), Unit("rad/s²")
        ] = 2.0
        reaction_time: Annotated[float, Meta(ge=0, le=5, description="until the base obeys"), Unit("s")] = 0.2
        lookahead_time: Annotated[
            float, Meta(ge=0, le=10, description="it steers for where it would be then"), Unit("s")
        ] = 1.2
        min_lookahead: Annotated[float, Meta(ge=0.05, le=100, description="at least so far ahead"), Unit("m")] = 0.3
        max_lookahead: Annotated[float, Meta(ge=0.05, le=100, description="at most so far ahead"), Unit("m")] = 1.0
        turn_angle: Annotated[
            float, Meta(ge=0.2, le=1.5, description="towards what is further to the side it turns on the spot"),
            Unit("rad"),
        ] = 0.8  # fmt: skip
        patience: Annotated[
            float, Meta(ge=0, le=86_400, description="give up a waypoint after so long without headway; 0: never"),
            Unit("s"),
        ] = 0.0  # fmt: skip
        stop_on_failure: Annotated[bool, Meta(description="whether a waypoint that is given up ends the course")] = True
        odom_timeout: Annotated[
            float, Meta(ge=0.01, le=10, description="with odometry that is older it stands"), Unit("s")
        ] = 0.5
        unstamped: Unstamped = True
        control_frequency: Annotated[float, Meta(ge=1, le=1000, description="commands per second"), Unit("Hz")] = 20.0

        def __post_init__(self) -> None:
            """Refuse waypoints that are none."""
            courses.waypoints_of_rows(self.waypoints)
            if self.waypoints and self.file:
                raise ValueError("waypoints and a file: use one of them")

    parameters: Parameters

    command = Publisher(Twist, "cmd_vel", qos=QoS.COMMAND)
    """How fast to drive, m/s and rad/s; nothing while there is no course."""
    path = Publisher(Path, "path", latched=True)
    """The way that it follows: of each lap, and a little of the next one. Empty when there is none."""
    state = Publisher(DiagnosticStatus, "follower_state", latched=True)
    """What it does and why, which waypoint is next, how far it is: on every change, and once a second."""
    transforms = TransformListener()

    def on_start(self) -> None:
        """Begin the course that parameters name."""
        p = self.parameters
        self._arrivals = Arrivals(unstamped=p.unstamped)
        self._wall = self.clock.wall
        self._robot = Whereabouts(self.resolve("odom"), self.transforms.buffer)
        self._follower: Follower | None = None
        self._doing, self._why = "idle", "no course so far"
        self._told = "", -1
        self._told_at = self._stepped = self.clock.monotonic()
        self._commanding, self._motion = False, STAND
        if p.file:
            self._begin(courses.load(p.file, p.laps))
        elif p.waypoints:
            self._begin(Course(courses.waypoints_of_rows(p.waypoints), p.frame.removeprefix("/"), p.laps))

    @subscribe("odom", depth=1)
    def on_odometry(self, odometry: Odometry, info: MessageInfo) -> None:
        """Remember where the robot is; what is not finite counts as silence."""
        now = self.clock.monotonic()
        if not self._robot.take(odometry, self._arrivals.sent(info, now, self._wall.monotonic()), now):
            self.logger.warning("ignored odometry that holds NaN or an infinity", throttle=5.0)

    @subscribe("waypoints")
    def on_waypoints(self, path: Path) -> None:
        """Follow this course from now on; one without poses ends that before it."""
        if not path.poses:
            self._end("idle", "told to follow no course any more")
            return
        try:
            course = self._course_of(path.poses, path.header.frame_id)
        except CourseError as error:
            self.logger.warning("waypoints are refused, and all stays as it was: %s", error, throttle=1.0)
        else:
            self._begin(course)

    def check_goal(self, goal: FollowWaypoints.Goal) -> None:
        """Refuse what cannot be followed; CourseError is a ValueError."""
        self._course_of(goal.poses, "", goal.number_of_loops + 1, goal.goal_index)

    @action("follow_waypoints", rate="control_frequency", policy="preempt", accept=check_goal)
    def follow_waypoints(
        self, goal: FollowWaypoints.Goal
    ) -> Generator[FollowWaypoints.Feedback | None, None, FollowWaypoints.Result]:
        """Follow the poses of a goal, in the place of any other course."""
        try:
            follower = self._begin(self._course_of(goal.poses, "", goal.number_of_loops + 1, goal.goal_index))
        except CourseError as error:  # it could be followed when it was taken
            raise GoalCanceled(f"{error}") from None
        told = -1
        try:
            while self._follower is follower:
                before, told = told, follower.waypoint
                yield FollowWaypoints.Feedback(told) if told != before else None
        except GoalCanceled as canceled:
            if self._follower is follower:
                self._end("idle", f"{canceled}" or "the goal of follow_waypoints was canceled", stand=not f"{canceled}")
            return _result(goal, follower)
        if not follower.finished:
            raise GoalCanceled(self._why)  # it was given up, or a path has taken its place
        return _result(goal, follower)

    @timer(rate="control_frequency")
    def control(self) -> None:
        """Command the next step of the course."""
        now, p = self.clock.monotonic(), self.parameters
        period = 1.0 / p.control_frequency
        if not p.use_sim_time:
            self._arrivals.tick(self._wall.monotonic(), period)
        elapsed, self._stepped = now - self._stepped, now
        dt = min(elapsed, 2 * period) if elapsed > 0.0 else period  # simulated time may step back
        if self._follower is not None:
            self._follow(self._follower, now, dt)
        else:
            self._stand()  # unless another course has followed the one before at once
        self._tell(now)

    def _follow(self, follower: Follower, now: float, dt: float) -> None:
        p, way = self.parameters, follower.way
        try:
            pose = self._robot.pose(follower.course.frame, now, p.odom_timeout)
        except Lost as why:
            self._doing, self._why = why.reason, f"{why}"
            follower.wait(dt)
            self._stand()
        else:
            motion = follower.step(pose, self._robot.speed, _limits_of(p), dt)
            if follower.way is not way:
                self._show(follower)
            if follower.finished:
                self._finish(follower)
                return
            self.command.publish(Twist(Vector3(x=motion.linear), Vector3(z=motion.angular)))
            self._commanding, self._motion = True, motion
            self._doing, self._why = _doing_of(follower)
        if p.patience and follower.idle > p.patience and follower.way is not None:
            self._give_up(follower)

    def _give_up(self, follower: Follower) -> None:
        """Leave out a waypoint, and by choice all that follow."""
        text = f"gave up waypoint {follower.waypoint} after {follower.idle:.1f} s: {self._why}"
        follower.give_up(self.parameters.tolerance)
        if self.parameters.stop_on_failure:
            self._end("failed", text)
            return
        self.logger.warning("%s", text)
        if follower.finished:
            self._finish(follower)

    def _finish(self, follower: Follower) -> None:
        missed = f"; missed {_missed(follower)}" if follower.missed else ""
        self._end("finished", f"is at the end of its course of {len(follower.course.waypoints)} waypoints{missed}")

    def _course_of(self, poses: list[PoseStamped], frame: str, laps: int = 1, first: int = 0) -> Course:
        """The course of a message, which can be followed now; CourseError says why not."""
        course = courses.course_of_poses(
            poses, frame or self.parameters.frame, self.parameters.orientations, laps, first
        )
        try:
            self._robot.pose(course.frame, self.clock.monotonic(), self.parameters.odom_timeout)
        except Lost as why:
            raise CourseError(f"{why}") from None
        return course

    def _begin(self, course: Course) -> Follower:
        """Follow a course from now on; what the robot does changes gently."""
        follower = self._follower = Follower(course, self._motion)
        self._doing, self._why = "driving", "has just begun"
        self.logger.info("follows a course of %d waypoints", len(course.waypoints))
        return follower

    def _end(self, doing: str, why: str, *, stand: bool = True) -> None:
        """Follow no course any more; the robot stands now, or unless another course begins at once."""
        if self._follower is not None:
            log = self.logger.warning if doing == "failed" else self.logger.info
            log("%s", why)
            self._follower = None
            self.path.publish(Path(Header(self.now())))
        self._doing, self._why = doing, why
        if stand:
            self._stand()

    def _stand(self) -> None:
        """Send one 0, and be silent then."""
        if self._commanding:
            self._commanding, self._motion = False, STAND
            self.command.publish(Twist())

    def _show(self, follower: Follower) -> None:
        if follower.way is not None:
            header = Header(self.now(), follower.course.frame or self._robot.frame)
            self.path.publish(_path_of(follower.way.route, header))

    def _tell(self, now: float) -> None:
        """Publish the state on every change and once a second."""
        follower = self._follower
        told = self._doing, follower.waypoint if follower is not None else -1
        if told[0] != self._told[0] and _level_of(self._doing) == DiagnosticStatus.WARN:
            self.logger.warning("stands: %s", self._why)
        if told != self._told or not 0.0 <= now - self._told_at < 1.0:  # simulated time may step back
            self._told, self._told_at = told, now
            values = [KeyValue("state", self._doing), KeyValue("reason", self._why), *_values_of(follower)]
            text = f"{self._doing}: {self._why}"
            self.state.publish(DiagnosticStatus(_level_of(self._doing), self.full_name, text, values=values))

    @check("course")
    def course_is_followed(self) -> Health:
        """Whether the robot makes its way; that it has no course is no fault."""
        said = {
            DiagnosticStatus.OK: Health.ok,
            DiagnosticStatus.WARN: Health.warn,
            DiagnosticStatus.ERROR: Health.error,
        }
        missed = _missed(self._follower) if self._follower is not None else ""
        return said[_level_of(self._doing)](f"{self._doing}: {self._why}", missed=missed)

    def on_stop(self) -> None:
        """Leave the robot standing, if it is this node that drives it."""
        self._stand()


def _doing_of(follower: Follower) -> tuple[str, str]:
    """What it does, and why."""
    if follower.idle > HELD_UP:
        return "held_up", f"has not got on for {int(follower.idle)} s, though it commands: {WHO_KNOWS}"
    return "turning" if follower.turning else "driving", "on its way"


def _path_of(route: Route, header: Header) -> Path:
    poses = [Pose(Point(at.x, at.y), quaternion_from_yaw(at.yaw)) for at in route.poses()]
    return Path(header, [PoseStamped(header, pose) for pose in poses])


def _level_of(doing: str) -> int:
    if doing in ("idle", "driving", "turning", "finished"):
        return DiagnosticStatus.OK
    return DiagnosticStatus.ERROR if doing == "failed" else DiagnosticStatus.WARN


def _values_of(follower: Follower | None) -> list[KeyValue]:
    """How far it is."""
    if follower is None:
        return []
    return [
        KeyValue("waypoint", str(follower.waypoint)),
        KeyValue("waypoints", str(len(follower.course.waypoints))),
        KeyValue("lap", str(follower.lap)),
        KeyValue("distance_left", f"{follower.left:.2f} m" if follower.way is not None else ""),
        KeyValue("missed", _missed(follower)),
    ]


def _missed(follower: Follower) -> str:
    """The numbers of the last waypoints that were given up."""
    return ", ".join(map(str, follower.missed[-MOST_SHOWN:]))


def _result(goal: FollowWaypoints.Goal, follower: Follower) -> FollowWaypoints.Result:
    """How a goal ended."""
    missed = [
        WaypointStatus(WaypointStatus.FAILED, index, goal.poses[index], FollowWaypoints.Result.UNKNOWN, "no headway")
        for index in follower.missed
    ]
    return FollowWaypoints.Result(missed)


def _limits_of(p: WaypointFollower.Parameters) -> Limits:
    return Limits(
        max_velocity=p.speed,
        min_velocity=min(p.min_speed, p.speed),
        max_angular_velocity=p.turn_speed,
        max_acceleration=p.max_acceleration,
        max_deceleration=p.max_deceleration,
        max_angular_acceleration=p.max_angular_acceleration,
        max_lateral_acceleration=p.max_lateral_acceleration,
        reaction_time=p.reaction_time,
        lookahead_time=p.lookahead_time,
        min_lookahead=p.min_lookahead,
        max_lookahead=p.max_lookahead,
        tolerance=p.tolerance,
        goal_tolerance=p.goal_tolerance,
        yaw_tolerance=p.yaw_tolerance,
        turn_angle=p.turn_angle,
    )


if __name__ == "__main__":
    robo.run(WaypointFollower)
