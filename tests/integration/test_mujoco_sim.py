"""The node mujoco_sim: in the place of diff_drive_sim it says the same, and more; it needs MuJoCo."""

import itertools
import math
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from robo import ParameterError
from robo.errors import RunError
from robo.testing import Clock, NodeUnderTest, RunNode
from robo.testing.heard import Heard
from robo.tf import Buffer, Transform3
from robo_messages import Odometry, Trigger, Twist, Vector3
from robo_services import mujoco_physics, mujoco_pictures
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.mjcf import Robot, robot_mjcf
from robo_services.mujoco_physics import Diverged
from robo_services.mujoco_sim import MujocoSim
from tests.support import PATIENCE

needs_mujoco = pytest.mark.skipif(
    not mujoco_physics.is_installed(), reason="MuJoCo is not installed: pip install 'robo-zenoh[mujoco]'"
)
OK, WARN, ERROR = 0, 1, 2


def drive(node: NodeUnderTest[MujocoSim], clock: Clock, linear: float, angular: float, seconds: float) -> None:
    for _ in range(round(seconds / 0.1)):
        node.send("cmd_vel", Twist(Vector3(linear), Vector3(z=angular)))
        clock.advance(0.1)


def last(node: NodeUnderTest[MujocoSim], topic: str = "odom") -> Odometry:
    message = node.published(topic)[-1]
    assert isinstance(message, Odometry)
    return message


def level(node: NodeUnderTest[MujocoSim], check: str) -> tuple[int, str]:
    report = node.published("diagnostics")[-1]
    return next((one.level, one.message) for one in report.status if one.name.endswith(f": {check}"))


@needs_mujoco
def test_it_takes_the_place_of_diff_drive_sim(run_node: RunNode, clock: Clock) -> None:
    plain = run_node(DiffDriveSim, namespace="r1", joint_states=True)
    node = run_node(MujocoSim, namespace="r2", joint_states=True)
    for _ in range(20):
        for one in (plain, node):
            one.send("cmd_vel", Twist(Vector3(0.5), Vector3(z=0.3)))
        clock.advance(0.1)
    for topic in ("odom", "scan", "joint_states", "tf"):
        said, said_there = node.published(topic), plain.published(topic)
        assert len(said) == len(said_there) > 0, topic
        assert type(said[-1]) is type(said_there[-1])
    theirs, ours = plain.published("odom")[-1], last(node)
    assert (ours.header.frame_id, ours.child_frame_id) == ("odom", "base_link")
    assert ours.header.stamp == theirs.header.stamp
    where, there = ours.pose.pose.position, theirs.pose.pose.position
    assert math.hypot(where.x - there.x, where.y - there.y) < 0.03
    assert ours.pose.covariance == pytest.approx(theirs.pose.covariance, rel=0.1, abs=1e-4), "that of wheels"
    assert node.published("scan")[-1].ranges[180] == pytest.approx(plain.published("scan")[-1].ranges[180], abs=0.1)
    turned, turned_there = (one.published("joint_states")[-1] for one in (node, plain))
    assert turned.name == turned_there.name
    assert turned.position == pytest.approx(turned_there.position, rel=0.05)
    clock.advance(1.0)
    assert last(node).twist.twist.linear.x == pytest.approx(0.0, abs=1e-3), "without commands it stands"


@needs_mujoco
def test_its_frames_lead_to_each_sensor(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, laser=True, camera=True, camera_rate=0.1)
    clock.advance(0.3)
    buffer = Buffer()
    for topic, static in (("tf_static", True), ("tf", False)):
        for message in node.published(topic):
            buffer.insert_all(message.transforms, static=static, source="test")
    stamp = node.published("scan")[-1].header.stamp
    laser = buffer.lookup("odom", "base_laser", stamp)
    assert laser == pytest.approx(Transform3(z=0.14), abs=1e-3)
    assert buffer.can_transform("odom", node.published("imu")[-1].header.frame_id, stamp)
    camera = buffer.lookup("base_link", "camera_optical", stamp)
    ahead, below = camera.apply(0.0, 0.0, 1.0), camera.apply(0.0, 1.0, 0.0)
    assert ahead == pytest.approx((camera.x + 1.0, 0.0, camera.z), abs=1e-6), "z is into the picture"
    assert below == pytest.approx((camera.x, 0.0, camera.z - 1.0), abs=1e-6), "y is down"


@needs_mujoco
def test_where_the_laser_stands_may_be_said_by_another_node(run_node: RunNode) -> None:
    node = run_node(MujocoSim, publish_laser_tf=False)
    said = {one.child_frame_id for message in node.published("tf_static") for one in message.transforms}
    assert said == {"imu_link"}


@needs_mujoco
def test_on_ice_odometry_errs_and_the_truth_is_told(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, friction=0.02, world=str(Path(__file__).parents[2] / "config" / "hall.yaml"))
    drive(node, clock, 1.0, 0.0, 2.0)
    truth = last(node, "ground_truth")
    assert truth.header.frame_id == "world"
    assert last(node).pose.pose.position.x > 2 * truth.pose.pose.position.x > 0.0
    grips = run_node(MujocoSim, namespace="r2")
    drive(grips, clock, 1.0, 0.0, 2.0)
    truth = last(grips, "ground_truth")
    assert last(grips).pose.pose.position.x == pytest.approx(truth.pose.pose.position.x, rel=0.002)
    assert truth.twist.twist.linear.x == pytest.approx(1.0, rel=0.01)


@needs_mujoco
def test_what_it_feels_is_told_with_its_noise(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, gyro_noise=0.1, accelerometer_noise=0.2, seed=3)
    clock.advance(4.0)
    felt = node.published("imu")
    assert len(felt) == 200
    upwards = [one.linear_acceleration.z for one in felt]
    mean = sum(upwards) / len(upwards)
    assert mean == pytest.approx(9.81, abs=0.1)
    spread = math.sqrt(sum((value - mean) ** 2 for value in upwards) / len(upwards))
    assert spread == pytest.approx(0.2, rel=0.3)
    assert (felt[0].linear_acceleration_covariance[0], felt[0].angular_velocity_covariance[8]) == pytest.approx(
        (0.04, 0.01)
    )


@needs_mujoco
def test_the_same_seed_is_the_same_drive_also_after_a_reset(run_node: RunNode, clock: Clock) -> None:
    def told(node: NodeUnderTest[MujocoSim]) -> list[object]:
        drive(node, clock, 0.7, 0.5, 1.0)
        clock.advance(1.0)
        drives = [(one.pose, one.twist) for topic in ("odom", "ground_truth") for one in node.published(topic)]
        felt = [(one.angular_velocity, one.linear_acceleration) for one in node.published("imu")]
        return [*drives, *felt, *(one.ranges for one in node.published("scan"))]

    node = run_node(MujocoSim, seed=5)
    first = told(node)
    assert node.call("reset", Trigger.Request()).success
    node.clear()
    assert told(node) == first == told(run_node(MujocoSim, namespace="r2", seed=5))
    assert told(run_node(MujocoSim, namespace="r3", seed=6)) != first


@needs_mujoco
def test_paused_it_makes_single_steps(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, cmd_vel_timeout=10.0)
    drive(node, clock, 0.5, 0.0, 1.0)
    refused = node.call("step", Trigger.Request())
    assert (refused.success, "paused" in refused.message) == (False, True)
    node.set(paused=True)
    node.clear()
    clock.advance(1.0)
    assert node.published("odom") == node.published("scan") == []
    for _ in range(5):
        assert node.call("step", Trigger.Request()).success
    steps = node.published("odom")
    assert len(steps) == 5
    ways = [b.pose.pose.position.x - a.pose.pose.position.x for a, b in itertools.pairwise(steps)]
    assert ways == pytest.approx([0.5 * 0.02] * 4, rel=0.1)
    node.set(paused=False)
    node.clear()
    clock.advance(0.2)
    assert 9 <= len(node.published("odom")) <= 11, "it goes on from where it is"
    step = node.published("odom")[0].pose.pose.position.x - steps[-1].pose.pose.position.x
    assert step < 0.5 * 0.05, "what passed meanwhile is not made up for"


@needs_mujoco
def test_its_own_time_goes_on_by_single_steps_too(robo_session: zenoh.Session) -> None:
    parameters = {"publish_clock": True, "real_time_factor": 4.0, "laser": False}
    heard = Heard(robo_session, "*")  # before the first step
    with MujocoSim(session=robo_session, parameters=parameters) as node:
        heard.wait_for_count("clock", 50, PATIENCE)
        step = node.create_client(Trigger.Request, Trigger.Response, "step", PATIENCE)
        node.set_parameters({"paused": True})
        assert step(Trigger.Request()).success  # after the tick that had begun
        heard.wait_for_count("clock", node._steps, PATIENCE)
        told = [one.clock.to_nanoseconds() for one in heard.messages("clock")]
        assert {b - a for a, b in itertools.pairwise(told)} == {20_000_000}, "each step is as long as it says"
        for _ in range(3):
            assert step(Trigger.Request()).success
        heard.wait_for_count("clock", len(told) + 3, PATIENCE)
        assert heard.messages("clock")[-1].clock.to_nanoseconds() == told[-1] + 60_000_000
        end = heard.messages("clock")[-1].clock
        heard.wait_for("odom", lambda odometry: odometry.header.stamp == end, PATIENCE)
        heard.close()


@needs_mujoco
def test_a_laser_may_come_later_where_the_robot_has_a_place_for_it(
    run_node: RunNode, clock: Clock, tmp_path: Path
) -> None:
    node = run_node(MujocoSim, laser=False)
    clock.advance(0.5)
    assert node.published("scan") == []
    node.set(laser=True)
    clock.advance(0.5)
    assert len(node.published("scan")) == 5
    text = robot_mjcf(Robot(radius=0.2, wheel_radius=0.05, wheel_separation=0.3))
    (tmp_path / "blind.xml").write_text(text.replace('"base_laser"', '"lamp"'))
    blind = run_node(MujocoSim, namespace="r2", laser=False, robot=str(tmp_path / "blind.xml"))
    with pytest.raises(ParameterError, match="the robot has no site 'base_laser'"):
        blind.set(laser=True)
    clock.advance(0.5)
    assert len(blind.published("odom")) == 25


@needs_mujoco
def test_it_tells_that_it_pushes(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, x=4.0)
    clock.advance(1.1)
    assert level(node, "contact")[0] == OK
    drive(node, clock, 1.0, 0.0, 3.0)
    assert level(node, "contact")[0] == WARN
    assert last(node, "ground_truth").pose.pose.position.x < 4.81


@needs_mujoco
def test_commands_that_are_not_finite_are_silence(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim)
    drive(node, clock, math.nan, 0.0, 0.5)
    drive(node, clock, math.inf, 1.0, 0.5)
    assert last(node).pose.pose.position.x == pytest.approx(0.0, abs=1e-5)


@needs_mujoco
def test_physics_that_comes_to_nothing_ends_the_node(
    run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fails(*_: object) -> None:
        raise Diverged("the physics has come to nothing")

    node = run_node(MujocoSim)
    monkeypatch.setattr(node.node._base, "step", fails)
    clock.advance(0.1)
    assert node.has_ended()
    assert node.exit_code == 1
    assert "do not go together" in caplog.text


# -- pictures ----------------------------------------------------------------------------------------------------------


@needs_mujoco
def test_a_camera_that_cannot_draw_is_said_and_it_drives_on(
    run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise mujoco_pictures.CannotDraw("egl does not draw: no device")

    monkeypatch.setattr(mujoco_pictures.Camera, "_new_renderer", fails)
    node = run_node(MujocoSim, camera=True)
    drive(node, clock, 0.5, 0.0, 2.0)
    assert level(node, "camera") == (ERROR, "no pictures: egl does not draw: no device")
    assert last(node).pose.pose.position.x > 0.5
    assert not node.published("image")


class PlayedWindow:
    """What mujoco.viewer opens, with its thread."""

    def __init__(self) -> None:
        self.shown, self._closing = 0, threading.Event()
        self.thread = threading.Thread(target=self._closing.wait, daemon=True)

    def launch_passive(self, _model: object, _data: object) -> "PlayedWindow":
        self.thread.start()
        return self

    def is_running(self) -> bool:
        return not self._closing.is_set()

    def sync(self) -> None:
        self.shown += 1

    def close(self) -> None:
        self._closing.set()


@needs_mujoco
def test_a_window_shows_what_moves_and_is_closed(
    run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    played = PlayedWindow()
    monkeypatch.setitem(sys.modules, "mujoco.viewer", played)
    monkeypatch.setattr(mujoco_pictures, "has_screen", lambda: True)
    node = run_node(MujocoSim, window=True)
    clock.advance(1.0)
    assert played.shown == pytest.approx(30, abs=1)
    played.close()
    clock.advance(1.0)
    assert played.shown == pytest.approx(30, abs=1), "who has closed it does not want it"
    assert last(node).header.stamp.to_seconds() > 0, "and it drives on"
    node.close()
    assert not played.thread.is_alive()


def test_what_draws_without_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("ctypes.util.find_library", lambda name: "there" if name == "OSMesa" else None)
    mujoco_pictures.choose_drawing()
    assert os.environ["MUJOCO_GL"] == "osmesa"
    monkeypatch.setenv("MUJOCO_GL", "egl")
    mujoco_pictures.choose_drawing()
    assert os.environ["MUJOCO_GL"] == "egl", "what the user says holds"


# -- what is not there -------------------------------------------------------------------------------------------------


@pytest.fixture
def started(robo_session: zenoh.Session) -> Callable[..., None]:
    def start(**parameters: object) -> None:
        with MujocoSim(session=robo_session, parameters=parameters):
            pass

    return start


def test_a_window_without_a_screen_is_an_error(started: Callable[..., None], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco_pictures, "has_screen", lambda: False)
    with pytest.raises(RunError, match="window: there is no screen here"):
        started(window=True)
    monkeypatch.setattr(MujocoSim, "REQUIRES", {})
    (text,) = MujocoSim.lacking(MujocoSim.Parameters(window=True))
    assert "no screen" in text
    assert not MujocoSim.lacking(MujocoSim.Parameters())


def test_mujoco_that_is_not_installed_is_said_before_the_start_and_at_it(
    started: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RunError, match=r"needs the module mujoco, .* pip install 'robo-zenoh\[mujoco\]'"):
        started()
    (text,) = MujocoSim.lacking(MujocoSim.Parameters())
    assert "robo-zenoh[mujoco]" in text
