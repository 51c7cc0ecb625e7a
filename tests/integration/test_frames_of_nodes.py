"""What nodes that ship stamp is a frame in the tree that they, or their robot's description, publish."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robo import ParameterError
from robo.errors import TransformError
from robo.testing import Clock, NodeUnderTest, RunNode
from robo.tf import Buffer, Transform3
from robo_messages import Header, JointState, LaserScan
from robo_services.carmen_player import CarmenPlayer
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.robot_state_publisher import RobotStatePublisher

URDF = Path(__file__).parents[2] / "config" / "robot.urdf"
OFFSETS = "PARAM robot_frontlaser_offset 0.25 nohost 0\nPARAM robot_frontlaser_angular_offset -0.5 nohost 0\n"
LINES = """ODOM 1 2 0.5 0 0 0 100.0 robot 0.1
FLASER 3 1 2 3 0 0 0 0 0 0 100.1 robot 0.2
ODOM 2 2 0.5 0 0 0 100.2 robot 0.3
"""


def taken(*nodes: NodeUnderTest[Any]) -> Buffer:
    """All that nodes have said of frames."""
    buffer = Buffer()
    for node in nodes:
        for topic, static in (("tf_static", True), ("tf", False)):
            for message in node.published(topic):
                buffer.insert_all(message.transforms, static=static, source=node.node.full_name)
    assert buffer.warnings() == ()
    return buffer


@pytest.fixture
def play(run_node: RunNode, tmp_path: Path) -> Callable[..., NodeUnderTest[CarmenPlayer]]:
    def run(text: str, **parameters: object) -> NodeUnderTest[CarmenPlayer]:
        (tmp_path / "a.log").write_text(text)
        player = run_node(CarmenPlayer, parameters={"log": str(tmp_path / "a.log"), "rate": 0.0, **parameters})
        player.wait_for("odom", lambda odometry: odometry.pose.pose.position.x == 2.0)
        return player

    return run


def test_the_frames_of_the_simulation(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim)
    clock.advance(0.3)
    buffer = taken(base)
    for scan in base.published(DiffDriveSim.scans):
        assert buffer.lookup("odom", scan.header.frame_id, scan.header.stamp) == Transform3()
    odometry = base.published(DiffDriveSim.odometry)[-1]
    assert buffer.can_transform(odometry.header.frame_id, odometry.child_frame_id, odometry.header.stamp)


def test_the_imu_of_the_simulation_has_its_frame_and_the_truth_is_in_no_frame_of_the_robots(
    run_node: RunNode, clock: Clock
) -> None:
    base = run_node(DiffDriveSim, imu=True, ground_truth=True, laser=False)
    clock.advance(0.3)
    buffer = taken(base)
    felt, truth, odometry = (base.published(topic)[-1] for topic in ("imu", "ground_truth", "odom"))
    assert felt.header.frame_id == "imu_link"
    assert buffer.lookup("odom", "imu_link", felt.header.stamp) == Transform3()
    assert truth.header.frame_id == "world", "odom goes astray with the wheels"
    assert (truth.header.stamp, truth.pose) == (odometry.header.stamp, odometry.pose)


def test_a_laser_that_is_there_later_has_its_frame_too(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim, laser=False)
    clock.advance(0.3)
    assert base.published("tf_static") == base.published("scan") == []
    base.node.set_parameters({"laser": True})
    clock.advance(0.3)
    (scan, *_) = base.published("scan")
    assert taken(base).can_transform("odom", scan.header.frame_id, scan.header.stamp)


def test_a_description_says_where_the_laser_is_and_the_simulation_need_not(run_node: RunNode, clock: Clock) -> None:
    base = run_node(DiffDriveSim, publish_laser_tf=False)
    described = run_node(RobotStatePublisher, urdf=str(URDF))
    clock.advance(0.3)
    stamp = base.published("odom")[-1].header.stamp
    wheels = ["left_wheel_joint", "right_wheel_joint"]
    described.send("joint_states", JointState(Header(stamp), wheels, [1.0, -1.0]))
    assert base.published("tf_static") == []
    buffer = taken(base, described)
    assert sorted((info.child, info.parent) for info in buffer.frames()) == [
        ("base_laser", "base_link"),
        ("base_link", "odom"),
        ("caster", "base_link"),
        ("left_wheel", "base_link"),
        ("right_wheel", "base_link"),
    ]
    laser = buffer.lookup("base_link", "base_laser")
    assert laser == Transform3(), "as the simulation has it"
    wheel = buffer.lookup("odom", "left_wheel", stamp)
    assert wheel[:3] == (0.0, 0.15, 0.05)
    assert wheel.rpy() == pytest.approx((0.0, 1.0, 0.0))


def looked_up(player: NodeUnderTest[CarmenPlayer]) -> Transform3:
    """Where the laser was at its scan, in odom."""
    scan: LaserScan
    (scan,) = player.published("scan")
    return taken(player).lookup("odom", scan.header.frame_id, scan.header.stamp)


Play = Callable[..., NodeUnderTest[CarmenPlayer]]


def test_a_log_says_where_the_laser_is(play: Play) -> None:
    player = play(OFFSETS + LINES)
    expected = Transform3.planar(1.5, 2.0, 0.5) @ Transform3.planar(0.25, 0.0, -0.5)
    assert looked_up(player) == pytest.approx(expected, abs=1e-12)


def test_it_may_say_so_later_as_a_robot_that_is_changed(play: Play) -> None:
    player = play(LINES + OFFSETS + LINES.replace("2 2 0.5", "2 2 0"))
    assert [Transform3.from_message(m.transforms[0]).x for m in player.published("tf_static")] == [0.0, 0.25, 0.25]


def test_who_plays_it_may_know_better(play: Play) -> None:
    player = play(OFFSETS + LINES, laser_pose=[0.1, 0.2, 0.3])
    expected = Transform3.planar(1.5, 2.0, 0.5) @ Transform3.planar(0.1, 0.2, 0.3)
    assert looked_up(player) == pytest.approx(expected, abs=1e-12)


def test_a_log_that_does_not_say_has_the_laser_in_the_middle(play: Play) -> None:
    assert looked_up(play(LINES)) == pytest.approx(Transform3.planar(1.5, 2.0, 0.5), abs=1e-12)


def test_the_description_of_its_robot_may_say_it(play: Play) -> None:
    player = play(OFFSETS + LINES, publish_laser_tf=False)
    assert player.published("tf_static") == []
    with pytest.raises(TransformError):
        looked_up(player)


def test_the_transform_comes_before_the_odometry_of_its_time(play: Play) -> None:
    player = play(LINES)
    for odometry, message in zip(player.published("odom"), player.published("tf"), strict=True):
        (moved,) = message.transforms
        assert moved.header == odometry.header
        assert moved.child_frame_id == odometry.child_frame_id
        assert Transform3.from_message(moved) == Transform3.from_message(odometry.pose.pose)


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"laser_frame": "base_link"}, "odom_frame, base_frame and laser_frame have to be three"),
        ({"odom_frame": ""}, "odom_frame = '': expected str of length >= 1"),
        ({"laser_pose": [1.0]}, "laser_pose takes x, y and yaw, not 1 numbers"),
        ({"laser_pose": [1.0, 2.0, math.nan]}, "laser_pose"),
    ],
)
def test_frames_that_make_no_tree_are_refused(run_node: RunNode, parameters: dict[str, object], expected: str) -> None:
    with pytest.raises(ParameterError, match=expected):
        run_node(CarmenPlayer, parameters={"log": "a.log", **parameters})
