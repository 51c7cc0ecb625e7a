"""The waypoint follower as a node: where courses come from, what it says, and when it is silent."""

import math
from pathlib import Path

import pytest

from robo import ActionError, GoalState, ParameterError
from robo.testing import Clock, NodeUnderTest, RunNode
from robo.tf import Transform3
from robo_messages import (
    FollowWaypoints,
    Header,
    Odometry,
    Point,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    TFMessage,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from robo_messages import Path as PathMessage
from robo_services.courses import CourseError, load
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.planar import quaternion_from_yaw, yaw_from_quaternion
from robo_services.safety_monitor import SafetyMonitor
from robo_services.velocity_smoother import VelocitySmoother
from robo_services.waypoint_follower import WaypointFollower

CONFIG = Path(__file__).parents[2] / "config"

Follower = NodeUnderTest[WaypointFollower]
Base = NodeUnderTest[DiffDriveSim]


def poses(*points: tuple[float, ...], frame: str = "") -> list[PoseStamped]:
    return [
        PoseStamped(Header(frame_id=frame), Pose(Point(x, y), quaternion_from_yaw(yaw[0] if yaw else 0.0)))
        for x, y, *yaw in points
    ]


def said(follower: Follower) -> str:
    """What its state says of what it does."""
    word: str = follower.published(WaypointFollower.state)[-1].values[0].value
    return word


def reason(follower: Follower) -> str:
    text: str = follower.published(WaypointFollower.state)[-1].message
    return text


def until(clock: Clock, follower: Follower, *words: str, seconds: float = 60.0) -> str:
    """Let time pass until it does one of these."""
    end = clock.monotonic() + seconds
    while said(follower) not in words:
        assert clock.monotonic() < end, f"not within {seconds} s: {words}, but {reason(follower)}"
        clock.advance(0.1)
    return said(follower)


def where(base: Base) -> Pose:
    pose: Pose = base.published("odom")[-1].pose.pose
    return pose


def odometry(x: float = 0.0, frame: str = "odom") -> Odometry:
    return Odometry(Header(frame_id=frame), "base_link", PoseWithCovariance(Pose(Point(x))))


def test_a_course_from_parameters_is_driven_told_and_ends_in_silence(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim, laser=False)
    follower = run_node(WaypointFollower, waypoints=[[1.0, 0.0], [2.0, 1.0, 1.57]])
    clock.advance(1.0)
    assert said(follower) == "driving"
    values = {one.key: one.value for one in follower.published(WaypointFollower.state)[-1].values}
    assert (values["waypoint"], values["waypoints"], values["lap"]) == ("0", "2", "0")
    assert 1.0 < float(values["distance_left"].removesuffix(" m")) < 2.5
    (way,) = follower.published(WaypointFollower.path)
    assert way.header.frame_id == "odom"
    assert (way.poses[-1].pose.position.x, way.poses[-1].pose.position.y) == pytest.approx((2.0, 1.0))
    until(clock, follower, "finished")
    clock.advance(1.0)
    assert (where(base).position.x, where(base).position.y) == pytest.approx((2.0, 1.0), abs=0.05)
    assert yaw_from_quaternion(where(base).orientation) == pytest.approx(1.57, abs=0.05)
    commands = follower.published(WaypointFollower.command)
    assert commands[-1] == Twist(), "one 0"
    assert commands[-2] != Twist()
    assert follower.published(WaypointFollower.path)[-1].poses == [], "there is no way any more"
    follower.clear()
    clock.advance(5.0)
    assert follower.published(WaypointFollower.command) == [], "and nothing more, so that another one may drive"
    follower.close()
    assert follower.published(WaypointFollower.command) == [], "not even at its end: it does not drive"


@pytest.mark.parametrize(("name", "speed", "seconds"), [("course.yaml", 0.8, 90.0), ("dock.yaml", 0.5, 40.0)])
def test_the_whole_chain_drives_the_courses_and_the_monitor_has_nothing_to_say(
    run_node: RunNode, clock: Clock, name: str, speed: float, seconds: float
) -> None:
    base = run_node(DiffDriveSim, world=str(CONFIG / "hall.yaml"), command_source="safety_monitor")
    monitor = run_node(SafetyMonitor)
    smoother = {"cmd_vel": "cmd_vel_nav", "cmd_vel_smoothed": "cmd_vel_raw"}
    run_node(VelocitySmoother, remap=smoother, parameters={"linear.max_velocity": speed})
    file = str(CONFIG / name)
    follower = run_node(WaypointFollower, remap={"cmd_vel": "cmd_vel_nav"}, file=file, speed=speed)
    clock.advance(1.0)
    monitor.clear()
    until(clock, follower, "finished", seconds=seconds)
    track = [one.pose.pose.position for one in base.published("odom")]
    misses = [min(math.hypot(p.x - w.x, p.y - w.y) for p in track) for w in load(file).waypoints]
    assert max(misses) <= 0.25
    assert misses[-1] <= 0.03, "where it stands"
    assert {state.values[1].value for state in monitor.published("safety_state")} == {"clear"}


def test_it_stops_when_it_does_not_know_where_it_is(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    follower = run_node(WaypointFollower, waypoints=[[5.0, 0.0]], odom_timeout=0.3)
    clock.advance(2.0)
    assert reason(follower) == "no_odometry: no odometry so far on odom"
    assert follower.published(WaypointFollower.command) == []

    def drive(seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            follower.send("odom", odometry())
            clock.advance(0.05)

    drive(1.0)
    assert follower.published(WaypointFollower.command)[-1].linear.x > 0.0
    clock.advance(0.25)
    assert follower.published(WaypointFollower.command)[-1].linear.x > 0.0
    clock.advance(1.0)
    assert said(follower) == "stale_odometry"
    assert [one for one in follower.published(WaypointFollower.command) if one == Twist()] == [Twist()], "one 0"
    assert "the last odometry on odom is too old" in caplog.text
    follower.clear()
    for bad in (odometry(math.nan), Odometry(twist=TwistWithCovariance(Twist(Vector3(math.inf))))):
        follower.send("odom", bad)
        follower.send("odom", odometry(), age=5.0)
        clock.advance(0.2)
    assert follower.published(WaypointFollower.command) == []
    assert "ignored odometry that holds NaN" in caplog.text
    drive(0.2)
    speeds = [one.linear.x for one in follower.published(WaypointFollower.command)]
    assert 0.0 < max(speeds) <= 0.15, "it begins anew"
    follower.close()
    assert follower.published(WaypointFollower.command)[-1] == Twist()


def test_a_path_takes_the_place_of_the_course_and_an_empty_one_ends_it(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim, laser=False)
    follower = run_node(WaypointFollower, waypoints=[[9.0, 0.0]])
    clock.advance(2.0)
    before = follower.published(WaypointFollower.command)[-1].linear.x
    follower.clear()
    follower.send("waypoints", PathMessage(Header(frame_id="odom"), poses((3.0, 0.5), (3.0, 2.0))))
    clock.advance(0.1)
    assert abs(follower.published(WaypointFollower.command)[0].linear.x - before) < 0.03, "it does not stop for it"
    until(clock, follower, "finished")
    assert (where(base).position.x, where(base).position.y) == pytest.approx((3.0, 2.0), abs=0.1)
    follower.send("waypoints", PathMessage(poses=poses((0.0, 0.0))))
    clock.advance(1.0)
    assert said(follower) in ("driving", "turning")
    follower.send("waypoints", PathMessage())
    clock.advance(0.1)
    assert reason(follower) == "idle: told to follow no course any more"
    assert follower.published(WaypointFollower.command)[-1] == Twist()


def test_courses_that_cannot_be_followed_are_refused_and_nothing_changes(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    follower = run_node(WaypointFollower)
    clock.advance(1.0)
    assert reason(follower) == "idle: no course so far"
    follower.send("waypoints", PathMessage(poses=poses((1, 0))))
    assert "no odometry so far on odom" in caplog.messages[-1]
    for wrong, why in (
        (poses((math.nan, 0)), "poses[0]: expected a finite number"),
        (poses((1, 0), frame="map") + poses((1, 0), frame="odom"), "in one frame, and these are in map, odom"),
        (poses((1, 0), frame="map"), "where the robot is in map is not known: "),
    ):
        clock.advance(2.0)
        follower.send("odom", odometry())
        follower.send("waypoints", PathMessage(poses=wrong))
        assert why in caplog.messages[-1]
        with pytest.raises(ActionError, match="refuses the goal"):
            follower.send_goal("follow_waypoints", FollowWaypoints.Goal(poses=wrong))
    with pytest.raises(ActionError, match="a course needs a waypoint"):
        follower.send_goal("follow_waypoints", FollowWaypoints.Goal())
    with pytest.raises(ActionError, match="no waypoint 1: they are numbered from 0 to 0"):
        follower.send_goal("follow_waypoints", FollowWaypoints.Goal(goal_index=1, poses=poses((1, 0))))
    assert said(follower) == "idle"
    assert follower.published(WaypointFollower.command) == []


def test_a_goal_is_followed_and_tells_how_far_it_is(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim, laser=False)
    follower = run_node(WaypointFollower)
    clock.advance(0.1)
    way = poses((1.0, 0.0), (2.0, 0.5), (1.0, 1.0, 3.0))
    goal = follower.send_goal("follow_waypoints", FollowWaypoints.Goal(number_of_loops=1, poses=way))
    until(clock, follower, "finished", seconds=90.0)
    clock.advance(0.2)
    assert [one.current_waypoint for one in goal.feedback] == [0, 1, 2, 0, 1, 2]
    assert goal.result() == FollowWaypoints.Result()
    assert yaw_from_quaternion(where(base).orientation) == pytest.approx(3.0, abs=0.05)


def test_a_goal_that_is_canceled_or_replaced_stops_the_robot(run_node: RunNode, clock: Clock) -> None:
    run_node(DiffDriveSim, laser=False)
    follower = run_node(WaypointFollower)
    clock.advance(0.1)
    far = FollowWaypoints.Goal(poses=poses((9.0, 0.0)))
    first = follower.send_goal("follow_waypoints", far)
    clock.advance(1.0)
    assert first.cancel()
    clock.advance(0.1)
    assert first.status == GoalState.CANCELED
    assert follower.published(WaypointFollower.command)[-1] == Twist()
    assert reason(follower) == "idle: the goal of follow_waypoints was canceled"

    second = follower.send_goal("follow_waypoints", far)
    clock.advance(1.0)
    follower.clear()
    third = follower.send_goal("follow_waypoints", FollowWaypoints.Goal(poses=poses((2.5, 0.0))))
    clock.advance(1.0)
    assert min(one.linear.x for one in follower.published(WaypointFollower.command)) > 0.2, "it does not stop for it"
    assert [second.status, third.status] == [GoalState.ABORTED, GoalState.EXECUTING]
    follower.send("waypoints", PathMessage(poses=poses((1.0, 1.0))))
    clock.advance(0.2)
    assert third.status == GoalState.ABORTED
    assert until(clock, follower, "finished") == "finished", "the path goes on"


@pytest.mark.parametrize("stop", [True, False])
def test_who_is_held_up_says_so_and_gives_up_by_choice(
    run_node: RunNode, clock: Clock, tmp_path: Path, stop: bool
) -> None:
    (tmp_path / "wall.yaml").write_text("walls: [[1.5, -2, 1.5, 2]]")
    base = run_node(DiffDriveSim, world=str(tmp_path / "wall.yaml"), command_source="safety_monitor")
    run_node(SafetyMonitor)
    follower = run_node(
        WaypointFollower, remap={"cmd_vel": "cmd_vel_raw"}, patience=5.0, stop_on_failure=stop, min_lookahead=0.5
    )
    clock.advance(0.2)
    way = poses((0.5, 0.0), (3.0, 0.0), (0.0, 0.5))
    goal = follower.send_goal("follow_waypoints", FollowWaypoints.Goal(poses=way))
    until(clock, follower, "held_up", seconds=30.0)
    assert "has not got on for" in reason(follower)
    assert 0.9 < where(base).position.x < 1.3, "the monitor has stopped it"
    until(clock, follower, "failed", "finished", seconds=60.0)
    clock.advance(0.2)
    if stop:
        assert said(follower) == "failed"
        with pytest.raises(ActionError, match=r"gave up waypoint 1 after 5\.\d s: has not got on"):
            goal.result()
    else:
        result = goal.result()
        assert [(one.waypoint_index, one.waypoint_status) for one in result.missed_waypoints] == [(1, 3)]
        assert where(base).position.x == pytest.approx(0.0, abs=0.1)


def test_a_robot_that_was_held_up_goes_on_by_itself_and_does_not_jump(run_node: RunNode, clock: Clock) -> None:
    follower = run_node(WaypointFollower, waypoints=[[4.0, 0.0]])
    for _ in range(200):
        follower.send("odom", odometry())
        clock.advance(0.05)
    assert said(follower) == "held_up"
    assert follower.published(WaypointFollower.command)[-1].linear.x < 0.3
    base = run_node(DiffDriveSim, laser=False)
    until(clock, follower, "finished")
    assert where(base).position.x == pytest.approx(4.0, abs=0.1)


def test_waypoints_in_another_frame_follow_that_frame(run_node: RunNode, clock: Clock) -> None:
    """The map turns by a right angle, and later on its place is known better."""
    base = run_node(DiffDriveSim, laser=False)
    follower = run_node(WaypointFollower, waypoints=[[2.0, -1.0]], frame="map")
    clock.advance(0.5)
    assert said(follower) == "no_transform"
    assert "map" in reason(follower)

    def locate(y: float) -> None:
        moved = Transform3.planar(0.0, y, -math.pi / 2).to_stamped(Header(follower.node.now(), "map"), "odom")
        follower.send("tf", TFMessage([moved]))

    locate(0.0)
    clock.advance(2.0)
    assert said(follower) in ("driving", "turning")
    assert follower.published(WaypointFollower.path)[-1].header.frame_id == "map"
    locate(0.5)
    until(clock, follower, "finished")
    # x of odom is -y of the map, and y is its x.
    assert (where(base).position.x, where(base).position.y) == pytest.approx((1.5, 2.0), abs=0.1)


def test_mistakes_of_parameters_are_told_with_their_places(run_node: RunNode, tmp_path: Path) -> None:
    for parameters, why in (
        ({"waypoints": [[1.0]]}, r"waypoints\[0\]: expected \[x, y\]"),
        ({"waypoints": [[1.0, 2.0]], "file": "c.yaml"}, "waypoints and a file: use one of them"),
    ):
        with pytest.raises(ParameterError, match=why):
            run_node(WaypointFollower, parameters=parameters)
    (tmp_path / "c.yaml").write_text("waypoints: [[1]]\nfrme: map\n")
    with pytest.raises(CourseError) as error:
        run_node(WaypointFollower, file=str(tmp_path / "c.yaml"))
    assert len(str(error.value).splitlines()) == 2
