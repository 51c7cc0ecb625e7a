"""The robot state publisher as a node: the frames that it says, and what it says of those that are not there."""

import itertools
import math
from pathlib import Path

import pytest
import zenoh

from robo import Node, ParameterError
from robo.errors import UnknownFrame
from robo.testing import Clock, NodeUnderTest, RunNode
from robo.tf import Transform3, TransformListener
from robo_messages import Header, JointState, String, Time
from robo_services.robot_state_publisher import RobotStatePublisher
from robo_services.urdf_model import UrdfError
from tests.support import PATIENCE, eventually

ROBOT = """<robot name="cart">
  <link name="base_link"/><link name="left_wheel"/><link name="right_wheel"/><link name="base_laser"/>
  <joint name="left" type="continuous">
    <parent link="base_link"/><child link="left_wheel"/><origin xyz="0 0.2 0.1"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="right" type="continuous">
    <parent link="base_link"/><child link="right_wheel"/><origin xyz="0 -0.2 0.1"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="base_link"/><child link="base_laser"/><origin xyz="0.3 0 0.2" rpy="0 0 3.14159265358979"/>
  </joint>
</robot>
"""

Publisher = NodeUnderTest[RobotStatePublisher]


def states(seconds: float, **positions: float) -> JointState:
    header = Header(Time.from_seconds(seconds))
    return JointState(header, name=list(positions), position=list(positions.values()))


def said(publisher: Publisher) -> list[tuple[float, str, str]]:
    """What has been said on tf since it was last asked: stamp, parent, child."""
    messages = publisher.published("tf")
    publisher.clear()
    return [
        (one.header.stamp.to_seconds(), one.header.frame_id, one.child_frame_id)
        for message in messages
        for one in message.transforms
    ]


def test_it_says_what_never_changes_once_and_the_rest_when_joints_are_heard_of(run_node: RunNode) -> None:
    publisher = run_node(RobotStatePublisher, robot_description=ROBOT)
    assert [message.data for message in publisher.published(RobotStatePublisher.description)] == [ROBOT]
    (fixed,) = publisher.published("tf_static")
    (mount,) = fixed.transforms
    assert (mount.header.frame_id, mount.child_frame_id) == ("base_link", "base_laser")
    assert Transform3.from_message(mount) == pytest.approx(Transform3(0.3, 0.0, 0.2, 0.0, 0.0, 1.0, 0.0), abs=1e-12)
    assert said(publisher) == []

    publisher.send("joint_states", states(1.0, left=math.pi))
    (message,) = publisher.published("tf")
    (wheel,) = message.transforms
    assert Transform3.from_message(wheel) == pytest.approx(Transform3(0.0, 0.2, 0.1, 0.0, 1.0, 0.0, 0.0), abs=1e-12)
    assert said(publisher) == [(1.0, "base_link", "left_wheel")]
    publisher.send("joint_states", states(1.01, left=0.1, right=0.2, mast=1.0))
    assert said(publisher) == [(1.01, "base_link", "left_wheel"), (1.01, "base_link", "right_wheel")]


def test_it_says_a_joint_so_often_and_all_where_asked_to(run_node: RunNode) -> None:
    publisher = run_node(RobotStatePublisher, robot_description=ROBOT, publish_frequency=10.0)

    times = itertools.count(100)

    def heard() -> int:
        for i in itertools.islice(times, 100):
            publisher.send("joint_states", states(i * 0.01, left=0.1))
        return len(said(publisher))

    assert heard() == 10
    publisher.node.set_parameters({"publish_frequency": 50.0})
    assert heard() == pytest.approx(50, abs=1)
    publisher.node.set_parameters({"ignore_timestamp": True})
    assert heard() == 100


def test_a_frame_prefix_stands_before_all_names(run_node: RunNode) -> None:
    publisher = run_node(RobotStatePublisher, robot_description=ROBOT, frame_prefix="r1/")
    (fixed,) = publisher.published("tf_static")
    assert (fixed.transforms[0].header.frame_id, fixed.transforms[0].child_frame_id) == (
        "r1/base_link",
        "r1/base_laser",
    )
    publisher.send("joint_states", states(1.0, right=0.1))
    assert said(publisher) == [(1.0, "r1/base_link", "r1/right_wheel")]


def test_what_is_no_position_is_left_out_and_told(run_node: RunNode, caplog: pytest.LogCaptureFixture) -> None:
    publisher = run_node(RobotStatePublisher, robot_description=ROBOT)
    publisher.send("joint_states", states(1.0, left=math.nan, right=0.1))
    assert said(publisher) == [(1.0, "base_link", "right_wheel")]
    assert "left out positions that are NaN, infinite or absurd, of 'left'; 1 messages so far" in caplog.text
    publisher.send("joint_states", JointState(Header(Time(2)), name=["left"], velocity=[1.0]))
    assert said(publisher) == []
    assert "ignored a message on joint_states: 0 positions of 1 joints; 2 so far" in caplog.text


def test_a_message_without_a_stamp_counts_from_its_arrival(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    publisher = run_node(RobotStatePublisher, robot_description=ROBOT)
    clock.advance(3.0)
    publisher.send("joint_states", states(0.0, left=0.1))
    ((stamp, *_),) = said(publisher)
    assert stamp == publisher.node.now().to_seconds()
    assert "messages on joint_states have no time of measurement" in caplog.text


def test_joints_that_were_never_heard_of_are_told(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    publisher = run_node(RobotStatePublisher, robot_description=ROBOT)
    clock.advance(4.0)
    assert caplog.text.count("no position") == 0
    clock.advance(12.0)
    told = "no position has come on joint_states of 'left', 'right': there are no frames 'left_wheel', 'right_wheel'"
    assert caplog.text.count(told) == caplog.text.count("no position") == 1, "once"
    publisher.send("joint_states", states(1.0, left=0.1, rihgt=0.2))
    clock.advance(5.0)
    told = "of 'right': there are no frames 'right_wheel'; it tells of 'rihgt', which the robot does not have"
    assert caplog.text.count(told) == 1
    publisher.send("joint_states", states(2.0, right=0.2))
    clock.advance(15.0)
    assert caplog.text.count("all joints have been heard of") == 1
    assert caplog.text.count("no position") == 2


def test_it_does_not_start_without_a_robot(run_node: RunNode, tmp_path: Path) -> None:
    wrong = ROBOT.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>').replace('"left_wheel"/><o', '"lef_wheel"/><o')
    with pytest.raises(UrdfError) as error:
        run_node(RobotStatePublisher, robot_description=wrong)
    assert [line.partition(" ")[0] for line in str(error.value).split("\n")] == [
        "robot_description:3:3:", "robot_description:4:81:", "robot_description:7:84:",
    ]  # fmt: skip
    with pytest.raises(ParameterError, match="neither urdf nor robot_description describes the robot"):
        run_node(RobotStatePublisher)
    with pytest.raises(ParameterError, match="both urdf and robot_description describe"):
        run_node(RobotStatePublisher, robot_description=ROBOT, urdf="r.urdf")
    with pytest.raises(UrdfError, match=r"URDF \S*nope.urdf cannot be read: No such file"):
        run_node(RobotStatePublisher, urdf=str(tmp_path / "nope.urdf"))


def test_whoever_comes_later_gets_all(session: zenoh.Session, other: zenoh.Session, tmp_path: Path) -> None:
    (tmp_path / "cart.urdf").write_text(ROBOT)

    class Viewer(Node):
        transforms = TransformListener()

    parameters = {"urdf": str(tmp_path / "cart.urdf")}
    with (
        RobotStatePublisher(namespace="r1", session=session, parameters=parameters),
        Viewer(namespace="r1", session=other) as viewer,
    ):
        descriptions: list[str] = []
        viewer.create_subscription(String, "robot_description", lambda one: descriptions.append(one.data), latched=True)
        found = viewer.transforms.lookup("base_link", "base_laser", timeout=PATIENCE)
        assert found.x == pytest.approx(0.3)
        eventually(lambda: descriptions == [ROBOT], "the description has come")
        joints = viewer.create_publisher(JointState, "joint_states")
        eventually(lambda: joints.has_subscribers, "they have met")
        joints.publish(states(1.0, left=0.1))
        eventually(lambda: viewer.transforms.buffer.can_transform("base_laser", "left_wheel"), "the wheel has come")
        with pytest.raises(UnknownFrame, match="there is no frame right_wheel"):
            viewer.transforms.lookup("base_laser", "right_wheel")
        assert {info.source for info in viewer.transforms.buffer.frames()} == {"/r1/robot_state_publisher"}
