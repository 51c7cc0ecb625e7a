"""A base in MuJoCo beside the plain one: how it drives, slips, feels and sees, and that it does so each time."""

import hashlib
import math
import random
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from robo.errors import ParameterError, RunError
from robo.parameters.model import build, describe
from robo_services import mjcf, mujoco_physics, world
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.kinematics import ORIGIN, Pose2
from robo_services.mujoco_laser import MujocoLaser
from robo_services.mujoco_parameters import MujocoParameters
from robo_services.mujoco_physics import MujocoBase
from robo_services.mujoco_sensors import ModelError
from robo_services.simulated_base import DRIVE, BaseLimits, SimulatedBase
from robo_services.simulator import SimulatorParameters
from robo_services.wheel_odometry import WheelOdometry
from robo_services.world import Box, Circle, Laser, World
from tests.extras import needs_mujoco

LIMITS = BaseLimits(
    radius=0.2, max_linear_velocity=1.5, max_angular_velocity=3.0, linear_acceleration=2.0, linear_deceleration=5.0,
    angular_acceleration=6.0,
)  # fmt: skip
ROBOT = mjcf.robot_mjcf(mjcf.Robot(radius=0.2, wheel_radius=0.05, wheel_separation=0.3))
STEP = 0.02
VOID = World()


def base_in(
    around: World = VOID, pose: Pose2 = ORIGIN, *, friction: float = 1.0, robot: str | Path = ROBOT
) -> MujocoBase:
    return MujocoBase(mjcf.world_mjcf(around, friction=friction), robot, LIMITS, DRIVE, pose)


def driven(base: MujocoBase, linear: float, angular: float, seconds: float) -> WheelOdometry:
    """What its wheels say of a drive."""
    odometry = WheelOdometry(DRIVE, pose=base.pose)
    odometry.take_positions(base.wheels[:1], base.wheels[1:2], base.time)
    for _ in range(round(seconds / STEP)):
        base.step(linear, angular, STEP)
        assert odometry.take_positions(base.wheels[:1], base.wheels[1:2], base.time)
    return odometry


# -- as the plain simulator --------------------------------------------------------------------------------------------


@needs_mujoco
@pytest.mark.parametrize("speed", [0.2, 1.0, -0.5])
def test_a_straight_line_is_that_of_the_plain_simulator(speed: float) -> None:
    base, plain = base_in(), SimulatedBase(VOID, LIMITS, Pose2())
    odometry = driven(base, speed, 0.0, 10.0)
    for _ in range(500):
        plain.step(speed, 0.0, STEP)
    way = abs(plain.pose.x)
    assert math.dist(odometry.pose[:2], plain.pose[:2]) < 0.02 * way
    assert math.dist(odometry.pose[:2], base.pose[:2]) < 0.002 * way, "its wheels do not slip"
    assert abs(base.pose.yaw) < 1e-3
    assert not base.touches


@needs_mujoco
@pytest.mark.parametrize(("speed", "turning"), [(0.5, 0.5), (0.4, -0.8), (-0.3, 0.5), (1.0, 1.0)])
def test_a_circle_is_that_of_the_plain_simulator(speed: float, turning: float) -> None:
    base, plain = base_in(), SimulatedBase(VOID, LIMITS, Pose2())
    seconds = math.tau / abs(turning)
    odometry = driven(base, speed, turning, seconds)
    for _ in range(round(seconds / STEP)):
        plain.step(speed, turning, STEP)
    around = math.tau * abs(speed / turning)
    assert math.dist(odometry.pose[:2], plain.pose[:2]) < 0.02 * around
    assert abs(math.remainder(odometry.pose.yaw - plain.pose.yaw, math.tau)) < 0.02 * math.tau
    assert math.dist(odometry.pose[:2], base.pose[:2]) < 0.005 * around, "its wheels do not slip"
    assert abs(math.remainder(odometry.pose.yaw - base.pose.yaw, math.tau)) < 0.005 * math.tau


@needs_mujoco
def test_it_turns_on_the_spot_and_brakes_as_it_is_told() -> None:
    base = base_in()
    driven(base, 0.0, 1.5, 10.0)
    assert math.dist(base.pose[:2], (0, 0)) < 0.01
    assert base.angular == pytest.approx(1.5, rel=0.01)
    base = base_in()
    driven(base, 1.0, 0.0, 3.0)
    begin = base.pose.x
    driven(base, 0.0, 0.0, 1.0)
    # v²/2a of the controller, one step and the motor's time
    assert base.pose.x - begin < 1.0**2 / 2 / 5.0 + 1.0 * (STEP + 2 * mjcf.MOTOR_TIME)
    assert abs(base.linear) < 1e-3


@needs_mujoco
@pytest.mark.parametrize("name", ["room.yaml", "hall.yaml"])
def test_the_laser_sees_what_the_plain_one_sees(name: str) -> None:
    around = world.load(str(Path(__file__).parents[2] / "config" / name))
    chance = random.Random(1)
    plain = Laser(around, rays=360, range_min=0.05, range_max=12.0, noise=0.0, seed=0)
    for _ in range(5):
        pose = Pose2(chance.uniform(-1, 1), chance.uniform(-1, 1), chance.uniform(-3, 3))
        laser = MujocoLaser(base_in(around, pose), rays=360, range_min=0.05, range_max=12.0, noise=0.0, seed=0)
        pairs = list(zip(laser.scan(), plain.scan(pose), strict=True))
        off = [abs(ours - theirs) for ours, theirs in pairs if math.isfinite(ours) and math.isfinite(theirs)]
        assert sum(difference > 0.02 for difference in off) <= 6, "but where a ray grazes an edge"
        assert sum(math.isfinite(ours) != math.isfinite(theirs) for ours, theirs in pairs) <= 3
        assert len(off) > 300


@needs_mujoco
def test_ranges_follow_rep_117() -> None:
    def seen(around: World, range_min: float = 0.05, noise: float = 0.0) -> list[float]:
        return MujocoLaser(base_in(around), rays=8, range_min=range_min, range_max=12.0, noise=noise, seed=0).scan()

    assert set(seen(VOID)) == {math.inf}
    near = World(walls=((1.0, -9.0, 1.0, 9.0),))
    assert seen(near)[4] == pytest.approx(1.0, abs=0.002)
    assert seen(near, range_min=1.2)[4] == -math.inf
    assert set(seen(VOID, noise=0.1)) == {math.inf}


# -- what the plain one does not have ----------------------------------------------------------------------------------


@needs_mujoco
def test_wheels_slip_on_ice_and_odometry_errs() -> None:
    base = base_in(friction=0.05)
    odometry = driven(base, 1.0, 0.0, 2.0)
    assert 0.4 < base.linear / (0.05 * 9.81 * 2.0) < 1.0, (
        "no more than the friction gives; some weight is on the caster"
    )
    assert odometry.pose.x > 1.5 * base.pose.x > 0.0


@needs_mujoco
def test_it_pushes_against_a_wall_and_comes_free_again() -> None:
    base = base_in(World(walls=((1.0, -1.0, 1.0, 1.0),)))
    driven(base, 1.0, 0.0, 3.0)
    assert (base.bumped, base.touches > 0) == (True, True)
    assert 0.79 < base.pose.x < 0.805
    driven(base, -0.5, 0.0, 2.0)
    assert (base.bumped, base.pose.x < 0.3) == (False, True)


@needs_mujoco
def test_what_it_feels() -> None:
    base = base_in()
    assert base.imu.linear_acceleration == pytest.approx((0, 0, 9.81), abs=0.05)
    driven(base, 1.0, 0.0, 0.3)
    assert base.imu.linear_acceleration[0] == pytest.approx(2.0, abs=0.3)
    driven(base, 1.0, 1.0, 3.0)
    felt = base.imu
    assert felt.angular_velocity == pytest.approx((0, 0, 1.0), abs=0.05)
    assert felt.linear_acceleration[1] == pytest.approx(1.0, abs=0.1), "v w, towards the middle of the circle"
    driven(base, 0.0, 3.0, 1.0)
    *_, z, w = base.imu.orientation
    assert base.angular == pytest.approx(3.0, rel=0.01)
    assert math.remainder(2 * math.atan2(z, w) - base.pose.yaw, math.tau) == pytest.approx(0, abs=1e-6)
    assert base.imu.linear_acceleration[2] == pytest.approx(9.81, abs=0.01)


@needs_mujoco
def test_sensors_stand_where_they_do_whenever_somebody_asks() -> None:
    base = base_in(world.ROOM)
    places = base.site(mjcf.LASER), base.camera(mjcf.CAMERA)
    driven(base, 1.0, 1.0, 1.0)
    MujocoLaser(base, rays=4, range_min=0.05, range_max=12.0, noise=0.0, seed=0).scan()
    for place, before in zip((base.site(mjcf.LASER), base.camera(mjcf.CAMERA)), places, strict=True):
        assert place == pytest.approx(before, abs=1e-9)


# -- each time the same ------------------------------------------------------------------------------------------------


def fingerprint(seed: int) -> str:
    """Of a drive at random through a room with things in it, with all that is measured there."""
    chance = random.Random(seed)
    around = World(walls=world.ROOM.walls, boxes=(Box((2.0, 2.0), (1.0, 0.5), 0.3),), circles=(Circle((-2, -1), 0.5),))
    base = base_in(around, Pose2(0.1, 0.2, 0.3))
    laser = MujocoLaser(base, rays=90, range_min=0.05, range_max=12.0, noise=0.01, seed=seed)
    found = hashlib.sha256()
    wanted = 0.0, 0.0
    for step in range(400):
        if step % 40 == 0:
            wanted = chance.uniform(-1.5, 1.5), chance.uniform(-3.0, 3.0)
        base.step(*wanted, STEP)
        found.update(base.data.qpos.tobytes() + base.data.qvel.tobytes() + repr(base.imu).encode())
        if step % 5 == 0:
            found.update(repr(laser.scan()).encode())
    return found.hexdigest()


@needs_mujoco
@pytest.mark.timeout(120)
def test_the_same_seed_is_the_same_drive_bit_for_bit() -> None:
    code = "from tests.unit.test_mujoco_physics import fingerprint; print(fingerprint(7))"
    elsewhere = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
    )
    assert fingerprint(7) == fingerprint(7) == elsewhere.stdout.strip()
    assert fingerprint(7) != fingerprint(8)


@needs_mujoco
def test_looking_around_changes_no_drive() -> None:
    blind, looking = base_in(world.ROOM), base_in(world.ROOM)
    laser = MujocoLaser(looking, rays=36, range_min=0.05, range_max=12.0, noise=0.01, seed=0)
    for _ in range(100):
        blind.step(0.7, 0.4, STEP)
        looking.step(0.7, 0.4, STEP)
        laser.scan()
    assert blind.data.qpos.tobytes() == looking.data.qpos.tobytes()


@needs_mujoco
def test_after_a_reset_all_is_as_at_the_start() -> None:
    base = base_in(World(walls=((1.0, -1.0, 1.0, 1.0),)), Pose2(0.0, 0.1, 0.2))
    driven(base, 1.0, 0.3, 2.0)
    first = base.data.qpos.tobytes()
    base.reset()
    assert (base.time, base.touches, base.bumped) == (0.0, 0, False)
    assert (*base.wheels, *base.pose) == pytest.approx((0.0, 0.0, 0.0, 0.0, 0.1, 0.2), abs=1e-6)
    driven(base, 1.0, 0.3, 2.0)
    assert base.data.qpos.tobytes() == first


# -- robots and worlds of a user's own ---------------------------------------------------------------------------------


@needs_mujoco
def test_a_robot_and_a_world_from_files(tmp_path: Path) -> None:
    robot, around = tmp_path / "robot.xml", tmp_path / "world.xml"
    robot.write_text(ROBOT.replace('size="0.2 0.04"', 'size="0.1 0.04" group="3"'))
    around.write_text(
        "<mujoco><worldbody><geom type='plane' size='9 9 1'/>"
        "<geom type='box' size='.1 2 1' pos='1.1 0 0' group='2'/></worldbody></mujoco>"
    )
    base = MujocoBase(around, robot, LIMITS, DRIVE, Pose2())
    laser = MujocoLaser(base, rays=4, range_min=0.05, range_max=12.0, noise=0.0, seed=0)
    assert laser.scan() == [math.inf, math.inf, pytest.approx(1.0, abs=1e-3), math.inf]
    driven(base, 1.0, 0.0, 3.0)
    assert 0.82 < base.pose.x < 0.84, "its body is smaller, its skid stands out"
    assert base.bumped


@needs_mujoco
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("base_link", "trunk", "the robot has no body 'base_link'"),
        ('<freejoint name="base_link"/>', "", "the robot's body 'base_link' has no free joint"),
        (mjcf.LEFT, "left", "the robot has no joint 'left_wheel_joint'; it needs"),
        (f'name="{mjcf.LEFT}" joint="{mjcf.LEFT}"', f'name="x" joint="{mjcf.RIGHT}"', "has 0 actuators; it needs one"),
        ("<body", "<bodie", "the robot is no model for MuJoCo: XML parse error"),
        (mjcf.LASER, "lidar", "the robot has no site 'base_laser'"),
        (f'<velocity name="{mjcf.LEFT}"', f'<motor name="{mjcf.LEFT}"', "'left_wheel_joint' takes no velocity: it has"),
        (f'<velocity name="{mjcf.LEFT}"', f'<position name="{mjcf.LEFT}"', "takes no velocity: it has to be <velocity"),
        (f'joint="{mjcf.RIGHT}"', f'joint="{mjcf.RIGHT}" gear="30"', "'right_wheel_joint' has a gear of 30: leave it"),
        (f'joint="{mjcf.RIGHT}"', f'joint="{mjcf.RIGHT}" ctrlrange="-1 1"', "has a ctrlrange: leave it out, for max_"),
        ('axis="0 1 0"', 'axis="0 -1 0"', "'left_wheel_joint' has to be a hinge about y, which turns forward"),
        ('type="hinge"', 'type="slide"', "'left_wheel_joint' has to be a hinge about y"),
    ],
)
def test_a_robot_that_lacks_something_is_refused(old: str, new: str, message: str) -> None:
    robot = ROBOT.replace(old, new)
    if "<motor" in robot or "<position" in robot:
        robot = re.sub("kv=", "gear=" if "<motor" in robot else "kp=", robot, count=1)
    with pytest.raises(ModelError, match=message):
        MujocoLaser(base_in(robot=robot), rays=4, range_min=0.05, range_max=12.0, noise=0.0, seed=0)


@needs_mujoco
def test_wheels_of_a_robot_that_stands_turned_are_those_of_the_robot() -> None:
    base = base_in(pose=Pose2(0.0, 0.0, math.pi))
    driven(base, 1.0, 0.0, 1.0)
    assert base.pose.x < -0.5


@needs_mujoco
def test_meshes_are_looked_for_beside_each_file(tmp_path: Path) -> None:
    shape = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    mesh = '<asset><mesh name="shape" file="shape.obj"/></asset><worldbody>'
    shapes = {"robot": 0.1, "world": 1.0}
    for name, size in shapes.items():
        (tmp_path / name / "parts").mkdir(parents=True)
        (tmp_path / name / "parts" / "shape.obj").write_text(shape.format(size))
    head = '<compiler meshdir="parts"/>' + mesh
    robot, around = tmp_path / "robot" / "robot.xml", tmp_path / "world" / "world.xml"
    text = ROBOT.replace("<worldbody>", head, 1)
    robot.write_text(text.replace("</body>", "</body><geom type='mesh' mesh='shape' mass='0' contype='0'/>", 1))
    around.write_text(
        f"<mujoco>{head}<geom type='plane' size='9 9 1'/><geom type='mesh' mesh='shape' pos='1 0 0'/></worldbody>"
        "</mujoco>"
    )
    base = MujocoBase(around, robot, LIMITS, DRIVE, Pose2())
    reach = base.model.geom_rbound[base.model.geom_type == int(base.mujoco.mjtGeom.mjGEOM_MESH)].tolist()
    assert max(reach) > 5 * min(reach) > 0, "each has its own shape of the same name"


@needs_mujoco
@pytest.mark.parametrize(("pose", "inside"), [((4.95, 0.0), True), ((4.0, 0.0), False), ((2.0, 2.0), True)])
def test_a_start_within_something_is_noticed(pose: tuple[float, float], inside: bool) -> None:
    around = World(walls=world.ROOM.walls, boxes=(Box((2.0, 2.0), (2.0, 2.0)),))
    assert base_in(around, Pose2(*pose)).starts_inside == inside


@needs_mujoco
def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"robot file .*robot.xml is no model"):
        base_in(robot=tmp_path / "robot.xml")


@needs_mujoco
def test_physics_that_comes_to_nothing_is_said() -> None:
    base = base_in()
    base.data.qvel[0] = math.nan
    with pytest.raises(mujoco_physics.Diverged, match="mean nothing"):
        base.step(0.0, 0.0, STEP)


# -- without MuJoCo ----------------------------------------------------------------------------------------------------


def test_a_missing_mujoco_is_an_error_that_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(RunError, match=r"pip install 'robo-zenoh\[mujoco\]'"):
        base_in()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"radius": 0.001}, "radius = 0.001: .*0.01"),
        ({"wheel_radius": 11.0}, "wheel_radius = 11.0: .*10"),
        ({"x": -1e5}, "x = -100000.0: .*10000"),
        ({"range_min": 2.0, "range_max": 2.0}, "range_min = 2 has to be less than range_max = 2"),
    ],
)
@pytest.mark.parametrize("cls", [MujocoParameters, DiffDriveSim.Parameters])
def test_robots_that_numbers_cannot_follow_are_refused(
    cls: type[SimulatorParameters], values: dict[str, Any], message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        build(cls, values, "/sim")


def test_the_parameters_of_both_simulators_differ_by_these_alone() -> None:
    plain, ours = ({info.name for info in describe(cls)} for cls in (DiffDriveSim.Parameters, MujocoParameters))
    assert plain - ours == {
        "drive", "wheelbase", "max_steering_angle", "max_steering_velocity",
        "errors.left_wheel_radius", "errors.right_wheel_radius", "errors.wheel_separation", "errors.slip",
    }  # fmt: skip
    assert ours - plain == {
        "robot", "mass", "friction", "max_wheel_torque", "timestep", "window", "paused",
        "camera", "camera_rate", "camera_width", "camera_height", "camera_frame",
    }  # fmt: skip


def test_models_of_parameters(tmp_path: Path) -> None:
    around, robot = MujocoParameters(wheel_radius=0.4).models()
    assert isinstance(around, str)
    assert isinstance(robot, str)
    assert "0.7" in around, "walls as high as twice the laser"
    parameters = MujocoParameters(world=str(tmp_path / "w.xml"), robot=str(tmp_path / "r.xml"))
    assert parameters.models() == (tmp_path / "w.xml", tmp_path / "r.xml")
    for name in ("W.XML", "w.mjcf"):
        assert MujocoParameters(world=name).models()[0] == Path(name)
    (tmp_path / "w.yaml").write_text("walls: [[0, 0, .inf, 1]]")
    with pytest.raises(world.WorldError, match=r"w.yaml: a number in it is inf"):
        MujocoParameters(world=str(tmp_path / "w.yaml")).models()
    with pytest.raises(world.WorldError, match="cannot be read"):
        MujocoParameters(world="nowhere.yaml").models()
