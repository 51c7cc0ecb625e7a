"""The node that finds a base's wheels: drives recorded, ends measured, parameters told."""

import math

import pytest

from robo.testing import NodeUnderTest, RunNode
from robo_messages import Header, Odometry, Point, Pose, PoseWithCovariance, Quaternion, Trigger
from robo_services.calibrate_base import CalibrateBase
from robo_services.calibration import Correction, Step, end_of
from robo_services.kinematics import ORIGIN, advance
from tests.unit.test_calibration import DRIVES


def drive(node: NodeUnderTest[CalibrateBase], steps: list[Step]) -> None:
    pose = ORIGIN
    for distance, turn in [Step(0.0, 0.0), *steps]:
        pose = advance(pose, distance, turn, 1.0)
        turned = Quaternion(z=math.sin(pose.yaw / 2), w=math.cos(pose.yaw / 2))
        there = PoseWithCovariance(Pose(Point(pose.x, pose.y), turned))
        node.send("odom", Odometry(Header(), "base_link", there))


def told(node: NodeUnderTest[CalibrateBase]) -> dict[str, float]:
    lines = node.published(CalibrateBase.result)[-1].data.splitlines()
    return {name: float(value) for name, _, value in (line.partition(": ") for line in lines)}


def test_a_line_and_two_squares_tell_the_parameters(run_node: RunNode) -> None:
    truth = Correction(1.01, 0.99, 1.05)
    node = run_node(CalibrateBase, wheel_separation=0.3, left_wheel_radius_multiplier=1.1)
    for steps in DRIVES:
        node.send("odom", Odometry(pose=PoseWithCovariance(Pose(orientation=Quaternion(w=1.0)))))
        assert node.call("calibration/begin", Trigger.Request()).success
        drive(node, steps)
        end = end_of(steps, 0.3, truth)
        node.send("calibration/measured", Point(end.x, end.y))
    found = told(node)
    assert found["left_wheel_radius_multiplier"] == pytest.approx(1.1 * 1.01, abs=3e-3)
    assert found["right_wheel_radius_multiplier"] == pytest.approx(0.99, abs=3e-3)
    assert found["wheel_separation_multiplier"] == pytest.approx(1.05, abs=3e-3)
    assert node.call("calibration/forget", Trigger.Request()).message == "2 drives are left"


def test_what_makes_no_drive_is_said(run_node: RunNode, caplog: pytest.LogCaptureFixture) -> None:
    node = run_node(CalibrateBase)
    answer = node.call("calibration/begin", Trigger.Request())
    assert (answer.success, answer.message) == (False, "nothing has come on odom")
    node.send("calibration/measured", Point(1.0, 0.0))
    assert "no drive is under way: call calibration/begin first, and drive" in caplog.text
    drive(node, DRIVES[0])
    node.call("calibration/begin", Trigger.Request())
    drive(node, DRIVES[0])
    node.send("calibration/measured", Point(math.nan, 0.0))
    assert "at no place such as nan, 0" in caplog.text
    assert node.published(CalibrateBase.result) == []
