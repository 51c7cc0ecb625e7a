"""The reference robot in MuJoCo: by one word on the command line it drives there, and reaches its course."""

import math
import sys

import pytest

from robo.launch import missing
from robo.launch.find import find_manifest
from robo.launch.resolve import resolve
from robo.testing import Launch
from robo_services import courses, mujoco_sim, world
from tests.e2e.test_waypoints import CONFIG, FAST, OPTIONS
from tests.extras import HAS_MUJOCO, needs_mujoco
from tests.support import run_robo


@needs_mujoco
@pytest.mark.timeout(150)
def test_the_course_of_twenty_waypoints_is_reached(launch: Launch) -> None:
    robot = launch("robot.yaml", physics="mujoco", use_sim_time=True, real_time_factor=FAST, options=OPTIONS)
    robot.wait_for("follower_state", lambda state: state.values[0].value == "finished", timeout=120.0)
    by_wheels = [one.pose.pose.position for one in robot.messages("odom")]
    track = [one.pose.pose.position for one in robot.messages("ground_truth")]
    course = courses.load(str(CONFIG / "course.yaml"))
    misses = [min(math.hypot(p.x - w.x, p.y - w.y) for p in by_wheels) for w in course.waypoints]
    assert len(misses) == 20
    assert max(misses) <= 0.25, misses
    off = math.hypot(by_wheels[-1].x - track[-1].x, by_wheels[-1].y - track[-1].y)
    assert off < 0.5, "what its wheels have lost on 60 m"
    hall = world.load(str(CONFIG / "hall.yaml"))
    nearest = min(world.clearance(hall.segments(), hall.circles, p.x, p.y) for p in track)
    assert nearest > 0.2 + 0.1, "the base has a radius of 0.2 m"
    print(f"largest miss {max(misses):.3f} m, clearance {nearest:.3f} m, odometry off by {off:.3f} m")
    assert "pushes against" not in robot.output


@needs_mujoco
@pytest.mark.timeout(120)
def test_its_camera_sees_the_hall_or_it_says_why_not(launch: Launch) -> None:
    robot = launch("simulation.yaml", physics="mujoco", demo="none", options=["-p", "diff_drive_sim.camera:=true"])
    robot.wait_for(
        "diagnostics",
        lambda report: any(
            one.name.endswith("diff_drive_sim: camera") and (one.message or robot.messages("image_raw"))
            for one in report.status
        ),
        timeout=60.0,
    )
    if not robot.messages("image_raw"):
        line = robot.wait_for_line("no pictures: ")
        pytest.skip(line.strip())
    image = robot.messages("image_raw")[-1]
    assert (image.width, image.height, image.encoding) == (320, 240, "rgb8")
    info = robot.wait_for("camera_info", lambda _: True)
    assert (info.width, info.height, info.header.frame_id) == (320, 240, image.header.frame_id)
    sky, floor = image.array[:20].mean(axis=(0, 1)), image.array[-20:].mean(axis=(0, 1))
    assert sky[2] > sky[0], "the sky is blue"
    assert max(floor) - min(floor) < 20, "the floor is grey"


@pytest.mark.skipif(HAS_MUJOCO, reason="MuJoCo is installed")
def test_without_the_library_nothing_starts() -> None:
    result = run_robo("up", "simulation.yaml", "physics:=mujoco")
    assert result.returncode == 1
    assert "pip install 'robo-zenoh[mujoco]'" in result.stderr
    assert "nothing is started" in result.stderr


def test_without_the_library_or_a_screen_nothing_would_start(monkeypatch: pytest.MonkeyPatch) -> None:
    file = find_manifest("simulation.yaml")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    (lacking,) = missing.for_nodes(resolve(file, {"physics": "mujoco"}))
    text = "/diff_drive_sim: needs the module mujoco, which is not installed: pip install 'robo-zenoh[mujoco]'"
    assert text in str(lacking)
    assert missing.for_nodes(resolve(file, {})) == []
    monkeypatch.setattr(mujoco_sim.MujocoSim, "REQUIRES", {})
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for arguments in ({"viewer": "mujoco"}, {"physics": "mujoco", "viewer": "mujoco"}):
        (screen,) = missing.for_nodes(resolve(file, arguments))
        assert "window: there is no screen here" in str(screen)


@pytest.mark.parametrize("physics", ["plain", "mujoco"])
def test_its_window_shows_its_physics(physics: str) -> None:
    plan = resolve(find_manifest("simulation.yaml"), {"viewer": "mujoco", "physics": physics}).plan
    (base,) = (process for process in plan.processes if process.name == "diff_drive_sim")
    assert (base.service, base.parameters["window"]) == ("robo_services.mujoco_sim", True)
