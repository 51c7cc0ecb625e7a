"""The node mujoco_sim: in the place of diff_drive_sim it says the same, and more; it needs MuJoCo."""

import ctypes.util
import itertools
import math
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

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
from robo_services.ekf_filter import EkfFilter
from robo_services.mjcf import Robot, robot_mjcf
from robo_services.mujoco_drawing import choose_drawing
from robo_services.mujoco_physics import Diverged
from robo_services.mujoco_sim import MujocoSim
from tests.extras import needs_mujoco
from tests.support import PATIENCE

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
    node = run_node(MujocoSim, imu_noise={"gyro": 0.1, "acceleration": 0.2, "gyro_bias": 0.5}, seed=3)
    clock.advance(4.0)
    felt = node.published("imu")
    assert len(felt) == 200
    upwards = [one.linear_acceleration.z for one in felt]
    mean = sum(upwards) / len(upwards)
    assert mean == pytest.approx(9.81, abs=0.1)
    spread = math.sqrt(sum((value - mean) ** 2 for value in upwards) / len(upwards))
    assert spread == pytest.approx(0.2, rel=0.3)
    assert sum(one.angular_velocity.z for one in felt) / len(felt) == pytest.approx(0.5, abs=0.05)
    assert (felt[0].linear_acceleration_covariance[0], felt[0].angular_velocity_covariance[8]) == pytest.approx(
        (0.04, 0.01)
    )


@needs_mujoco
def test_a_filter_stands_before_it(run_node: RunNode, clock: Clock) -> None:
    """As docs/localization.md has it: on ice that lets the wheels spin, and with a gyro that is biased."""
    noise = {"gyro": 0.01, "gyro_bias": 0.02}
    base = run_node(MujocoSim, enable_odom_tf=False, laser=False, imu_noise=noise, friction=0.01)
    wheels, gyro = {"topic": "odom", "use": ["vx"]}, {"topic": "imu", "type": "imu", "use": ["vyaw"]}
    node = run_node(EkfFilter, sources={"wheels": wheels, "imu": gyro})
    clock.advance(2.0)
    for _ in range(40):
        base.send("cmd_vel", Twist(Vector3(), Vector3(z=2.0)))
        clock.advance(0.1)
    clock.advance(1.0)
    assert {one.child_frame_id for sent in base.published("tf") for one in sent.transforms} == set()
    last_one = node.published(EkfFilter.filtered)[-1]
    truth, by_wheels, fused = (
        Transform3.from_message(one.pose.pose).rpy()[2] for one in (last(base, "ground_truth"), last(base), last_one)
    )
    off = [abs(math.remainder(one - truth, math.tau)) for one in (by_wheels, fused)]
    assert off[1] < 0.05 < 0.2 < off[0], off


@needs_mujoco
def test_what_is_not_wanted_is_not_told(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, imu=False, ground_truth=False, publish_laser_tf=False)
    clock.advance(0.2)
    assert node.published("imu") == node.published("ground_truth") == node.published("tf_static") == []
    assert len(node.published("odom")) == 10


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
    clock.advance(0.1)  # a sensor may have to look yet
    node.clear()
    clock.advance(1.0)
    assert node.published("odom") == node.published("scan") == []
    for _ in range(5):
        assert node.call("step", Trigger.Request()).success
    steps = node.published("odom")
    assert len(steps) == 5
    clock.advance(1.0)
    (scan,) = node.published("scan")
    assert scan.header.stamp == steps[-1].header.stamp, "it is of the state that it shows"
    ways = [b.pose.pose.position.x - a.pose.pose.position.x for a, b in itertools.pairwise(steps)]
    assert ways == pytest.approx([0.5 * 0.02] * 4, rel=0.1)
    node.set(paused=False)
    node.clear()
    clock.advance(0.2)
    assert 9 <= len(node.published("odom")) <= 11, "it goes on from where it is"
    step = node.published("odom")[0].pose.pose.position.x - steps[-1].pose.pose.position.x
    assert step < 0.5 * 0.05, "what passed meanwhile is not made up for"


@needs_mujoco
def test_each_state_is_looked_at_once_and_stamped_as_that_state(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, scan_rate=100.0, odom_rate=20.0)
    clock.advance(1.0)
    scans, states = node.published("scan"), node.published("odom")
    assert 19 <= len(scans) <= 21
    told = [one.header.stamp for one in states]
    assert all(one.header.stamp in told for one in scans[1:])


@needs_mujoco
def test_a_reset_is_told_while_it_is_paused_too(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim)
    drive(node, clock, 1.0, 0.0, 1.0)
    node.set(paused=True)
    node.clear()
    node.call("reset", Trigger.Request())
    clock.advance(0.2)
    assert last(node).pose.pose.position.x == pytest.approx(0.0, abs=1e-3)
    assert len(node.published("scan")) == 1


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
    paused = run_node(MujocoSim, namespace="r2", paused=True)
    monkeypatch.setattr(paused.node._base, "step", fails)
    assert not paused.call("step", Trigger.Request()).success
    assert (paused.has_ended(), paused.exit_code) == (True, 1)


@needs_mujoco
def test_steps_that_are_made_up_for_are_felt_as_one(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, imu_noise={"gyro": 0.0, "acceleration": 0.0})
    node.send("cmd_vel", Twist(Vector3(0.5)))
    clock.advance(0.02)
    node.clear()
    speeds = [node.node._base.linear]
    node.node._run([node.node.clock.monotonic()] * 10)
    speeds.append(node.node._base.linear)
    (felt,) = node.published("imu")
    assert felt.linear_acceleration.x == pytest.approx((speeds[1] - speeds[0]) / 0.2, rel=0.01)
    assert felt.linear_acceleration_covariance[0] > 0, "zeros would say that nobody knows"


@needs_mujoco
def test_who_tips_over_or_starts_in_a_wall_is_told(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    node = run_node(MujocoSim)
    clock.advance(1.1)
    assert level(node, "upright")[0] == OK
    node.node._base.data.qpos[2:7] = [0.3, 0.0, 1.0, 0.0, 0.0]  # on its back
    clock.advance(1.1)
    assert level(node, "upright") == (ERROR, "the base has tipped over")
    assert "starts in the middle" not in caplog.text
    run_node(MujocoSim, namespace="r2", x=4.95)
    assert "the robot starts in the middle of something: say another x, y or yaw" in caplog.text


# -- pictures ----------------------------------------------------------------------------------------------------------


@needs_mujoco
def test_a_camera_that_cannot_draw_is_said_and_it_drives_on(
    run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Broken:
        attempts = 0

        def __init__(self, *_: object) -> None:
            Broken.attempts += 1
            raise RuntimeError("no  device")

    monkeypatch.setattr(mujoco_pictures.Camera, "_broken", "")  # or it stays so for the whole process
    monkeypatch.setattr(mujoco_physics.import_mujoco(), "Renderer", Broken)
    monkeypatch.setenv("MUJOCO_GL", "egl")
    node = run_node(MujocoSim, camera=True)
    drive(node, clock, 0.5, 0.0, 2.0)
    assert level(node, "camera") == (ERROR, "no pictures: egl does not draw: no device")
    assert last(node).pose.pose.position.x > 0.5
    assert not node.published("image_raw")
    second = run_node(MujocoSim, namespace="r2", camera=True)
    clock.advance(1.1)
    assert level(second, "camera")[0] == ERROR
    assert Broken.attempts == 1, "MuJoCo ends the process at the second one"


WITHOUT_A_SCREEN = """
import time
import zenoh
from robo_services.mujoco_sim import MujocoSim

config = zenoh.Config.from_json5('{mode: "peer", scouting: {multicast: {enabled: false}}, listen: {endpoints: []}}')
with MujocoSim(session=zenoh.open(config), parameters={"camera": True, "camera_rate": 100.0}) as node:
    while node._steps < 50:
        node.sleep(0.02)
    node.take_picture()
    print(node.camera_draws().message)
"""


@needs_mujoco
@pytest.mark.timeout(120)
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere glfw needs no screen")
@pytest.mark.parametrize(
    ("environment", "says"),
    [
        ({"MUJOCO_GL": "glfw"}, "no pictures: glfw does not draw: "),
        ({"DISPLAY": ":7777", "MUJOCO_GL": "glfw"}, "no pictures: glfw does not draw: "),
        ({"DISPLAY": ":7777", "MUJOCO_GL": ""}, ""),
    ],
)
def test_a_process_outlives_its_camera(environment: dict[str, str], says: str, tmp_path: Path) -> None:
    """MuJoCo's own code would end it with a signal."""
    plain = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_A_SCREEN],
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
        env={**plain, **environment},
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(says or ("\n", "no pictures: ")), "a picture never needs a screen"


@needs_mujoco
def test_it_says_how_its_camera_sees(run_node: RunNode, clock: Clock) -> None:
    node = run_node(MujocoSim, camera=True, camera_width=64, camera_height=48, camera_rate=0.1)
    clock.advance(0.1)
    (info,) = node.published("camera_info")
    assert (info.header.frame_id, info.width, info.height, info.distortion_model) == (
        "camera_optical", 64, 48, "plumb_bob",
    )  # fmt: skip
    focal = 24 / math.tan(math.radians(60) / 2)
    assert info.k == pytest.approx((focal, 0, 32, 0, focal, 24, 0, 0, 1))
    assert info.p == pytest.approx((focal, 0, 32, 0, 0, focal, 24, 0, 0, 0, 1, 0))


class PlayedWindow:
    """What mujoco.viewer opens, with its thread; who is at it may reset the world."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.shown, self.resets, self._closing = 0, 0, threading.Event()
        self.cam, self.lock = SimpleNamespace(), threading.Lock
        self.thread = threading.Thread(target=self._closing.wait, daemon=True, name="Thread-7 (_launch_internal)")
        monkeypatch.setitem(sys.modules, "mujoco.viewer", self)
        monkeypatch.setitem(sys.modules, "glfw", self)
        monkeypatch.setattr(mujoco_pictures, "has_screen", lambda: True)

    def init(self) -> bool:
        return True

    def launch_passive(self, model: object, data: object, **_panels: bool) -> "PlayedWindow":
        self._world = model, data
        self.thread.start()
        return self

    def is_running(self) -> bool:
        return not self._closing.is_set()

    def sync(self) -> None:
        self.shown += 1
        if self.resets:
            self.resets -= 1
            mujoco_physics.import_mujoco().mj_resetData(*self._world)

    def close(self) -> None:
        self._closing.set()


@needs_mujoco
def test_a_window_shows_what_moves_and_is_closed(
    run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    played = PlayedWindow(monkeypatch)
    node = run_node(MujocoSim, window=True)
    clock.advance(1.0)
    assert played.shown == pytest.approx(30, abs=1)
    assert node.node._base.model.body(played.cam.trackbodyid).name.endswith("base_link"), "it looks at the robot"
    played.close()
    clock.advance(1.0)
    assert played.shown == pytest.approx(30, abs=1), "who has closed it does not want it"
    assert last(node).header.stamp.to_seconds() > 0, "and it drives on"
    node.close()
    assert not played.thread.is_alive()


@needs_mujoco
def test_who_resets_in_the_window_resets_odometry_too(
    run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    played = PlayedWindow(monkeypatch)
    node = run_node(MujocoSim, window=True, x=0.5)
    drive(node, clock, 1.0, 0.0, 1.0)
    assert last(node).pose.pose.position.x > 1.0
    played.resets = 1
    clock.advance(0.1)
    for topic in ("odom", "ground_truth"):
        assert last(node, topic).pose.pose.position.x == pytest.approx(0.5, abs=1e-3), topic
    node.clear()
    clock.advance(1.0)
    felt = [one.linear_acceleration.x for one in node.published("imu")]
    assert max(map(abs, felt)) < 1.0, "it was put there, and not thrown"


@needs_mujoco
def test_a_window_that_closes_waits_for_its_own_threads_alone(
    run_node: RunNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    played, other = PlayedWindow(monkeypatch), threading.Event()
    launch = played.launch_passive

    def among_others(model: object, data: object, **panels: bool) -> PlayedWindow:
        threading.Thread(target=other.wait, daemon=True).start()
        return launch(model, data, **panels)

    monkeypatch.setattr(played, "launch_passive", among_others)
    monkeypatch.setattr(mujoco_pictures, "CLOSING", 3600.0)
    node = run_node(MujocoSim, window=True)
    node.close()
    assert not played.thread.is_alive()
    other.set()


def test_what_draws_whether_or_not_there_is_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("ctypes.util.find_library", lambda name: "there" if name == "OSMesa" else None)
    for screen in ("", ":0"):
        monkeypatch.setenv("DISPLAY", screen)
        monkeypatch.setenv("MUJOCO_GL", "")
        choose_drawing()
        assert os.environ["MUJOCO_GL"] == "osmesa"
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    choose_drawing()
    assert os.environ["MUJOCO_GL"] == "glfw", "what the user says holds"


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


@needs_mujoco
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no variable says where the screen is")
def test_a_window_on_a_screen_that_is_not_there_is_an_error(
    started: Callable[..., None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":7777")
    with pytest.raises(RunError, match="window: the screen DISPLAY=:7777 cannot be reached: X11"):
        started(window=True)
    assert not list(tmp_path.iterdir()), "MuJoCo writes no log of its own"


@needs_mujoco
@pytest.mark.timeout(60)
@pytest.mark.parametrize("way", ["nonsense", "osmesa"])
def test_a_way_to_draw_that_mujoco_cannot_take_is_one_clear_error(way: str) -> None:
    if way == "osmesa" and ctypes.util.find_library("OSMesa"):
        pytest.skip("OSMesa is there")
    code = "from robo_services.mujoco_physics import import_mujoco, RunError\n"
    code += "try: import_mujoco()\nexcept RunError as error: print(error)"
    environment = {**os.environ, "MUJOCO_GL": way}
    environment.pop("PYOPENGL_PLATFORM", None)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert "cannot be imported: " in done.stdout
    assert f"MUJOCO_GL is '{way}': it may be egl, osmesa or glfw, or not be said" in done.stdout


def test_mujoco_that_is_not_installed_is_said_before_the_start_and_at_it(
    started: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RunError, match=r"needs the module mujoco, .* pip install 'robo-zenoh\[mujoco\]'"):
        started()
    (text,) = MujocoSim.lacking(MujocoSim.Parameters())
    assert "robo-zenoh[mujoco]" in text
