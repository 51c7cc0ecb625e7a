import math
import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_services import world
from robo_services.drives import Ackermann, DiffDrive, SkidSteer
from robo_services.kinematics import Pose2, Twist2, advance
from robo_services.simulated_base import DRIVE, BaseLimits, SimulatedBase
from robo_services.wheel_odometry import WheelOdometry
from robo_services.world import Box, Circle, Laser, World, WorldError

CONFIG = Path(__file__).parents[2] / "config"
LIMITS = BaseLimits(
    radius=0.2, max_linear_velocity=1.5, max_angular_velocity=3.0, linear_acceleration=2.0, linear_deceleration=5.0,
    angular_acceleration=6.0,
)  # fmt: skip


def laser(surroundings: World, rays: int = 360, noise: float = 0.0, seed: int = 0) -> Laser:
    return Laser(surroundings, rays=rays, range_min=0.05, range_max=12.0, noise=noise, seed=seed)


def test_a_full_circle_comes_back() -> None:
    pose = Pose2()
    for _ in range(1000):
        pose = advance(pose, 0.5, 0.2, math.tau / 0.2 / 1000)
    assert (pose.x, pose.y) == pytest.approx((0, 0), abs=1e-9)


@given(st.floats(-2, 2), st.floats(-3, 3), st.floats(0.001, 2), st.integers(1, 20))
def test_an_arc_is_exact_whatever_the_step(linear: float, angular: float, dt: float, parts: int) -> None:
    once = advance(Pose2(1.0, 2.0, 0.5), linear, angular, dt)
    many = Pose2(1.0, 2.0, 0.5)
    for _ in range(parts):
        many = advance(many, linear, angular, dt / parts)
    assert (once.x, once.y) == pytest.approx((many.x, many.y), abs=1e-12)
    assert math.remainder(once.yaw - many.yaw, math.tau) == pytest.approx(0, abs=1e-9)


def test_the_laser_sees_the_walls_of_a_room() -> None:
    ranges = laser(world.ROOM).scan(Pose2(1.0, 0.0, 0.0))
    ahead, left, behind = ranges[180], ranges[270], ranges[0]
    assert (ahead, left, behind) == pytest.approx((4.0, 5.0, 6.0))
    assert ranges[225] == pytest.approx(4.0 / math.cos(math.pi / 4))


@given(st.floats(-4, 4), st.floats(-4, 4), st.floats(-3.1, 3.1))
def test_the_fast_cast_equals_a_plain_one(x: float, y: float, yaw: float) -> None:
    surroundings = World(
        walls=world.ROOM.walls, boxes=(Box((2.0, 2.0), (1.0, 0.5), 0.3),), circles=(Circle((-2.0, -1.0), 0.5),)
    )
    if math.hypot(x + 2, y + 1) <= 0.55:
        return
    ranges = laser(surroundings, rays=72).scan(Pose2(x, y, yaw))
    for i, found in enumerate(ranges):
        angle = yaw - math.pi + i * math.tau / 72
        expected = min(_hit_segment(x, y, angle, s) for s in surroundings.segments())
        expected = min(expected, _hit_circle(x, y, angle, surroundings.circles[0]))
        # Where a ray grazes a corner or an edge, both answers are right.
        near = [_plain(surroundings, x, y, angle + d) for d in (-1e-6, 1e-6)]
        if expected > 0.06 and max(near) - min(near) < 1e-3 and expected < 12:
            assert found == pytest.approx(expected, abs=1e-3)


def _plain(surroundings: World, x: float, y: float, angle: float) -> float:
    walls = min(_hit_segment(x, y, angle, s) for s in surroundings.segments())
    return min(walls, _hit_circle(x, y, angle, surroundings.circles[0]))


def _hit_segment(x: float, y: float, angle: float, segment: world.Segment) -> float:
    c, s = math.cos(angle), math.sin(angle)
    ax, ay, bx, by = segment[0] - x, segment[1] - y, segment[2] - x, segment[3] - y
    ex, ey = bx - ax, by - ay
    det = c * ey - s * ex
    if abs(det) < 1e-12:
        return math.inf
    t, u = (ax * ey - ay * ex) / det, (ax * s - ay * c) / det
    return t if t >= 0 and -1e-12 <= u <= 1 + 1e-12 else math.inf


def _hit_circle(x: float, y: float, angle: float, circle: Circle) -> float:
    dx, dy = circle.center[0] - x, circle.center[1] - y
    along = dx * math.cos(angle) + dy * math.sin(angle)
    inside = circle.radius**2 - (dx * dx + dy * dy - along * along)
    return along - math.sqrt(inside) if inside >= 0 and along > 0 else math.inf


def test_ranges_follow_rep_117() -> None:
    void = laser(World()).scan(Pose2())
    assert set(void) == {math.inf}
    inside = laser(World(circles=(Circle((0.0, 0.0), 1.0),))).scan(Pose2())
    assert set(inside) == {-math.inf}
    touching = laser(World(walls=((0.01, -1, 0.01, 1),))).scan(Pose2())
    assert touching[180] == -math.inf


def test_the_same_seed_gives_the_same_noise() -> None:
    def scans(seed: int) -> list[list[float]]:
        device = laser(world.ROOM, noise=0.01, seed=seed)
        return [device.scan(Pose2(0.1 * i, 0, 0)) for i in range(3)]

    assert scans(1) == scans(1) != scans(2)


def test_nothing_is_driven_through() -> None:
    base = SimulatedBase(World(walls=((1.0, -1.0, 1.0, 1.0),)), LIMITS, Pose2())
    for _ in range(500):
        base.step(1.0, 0.0, 0.02)
    assert base.bumped
    assert base.linear == 0.0
    assert 0.7 < base.pose.x <= 0.8
    for _ in range(100):
        base.step(-1.0, 0.0, 0.02)
    assert base.pose.x < 0.0
    assert not base.bumped


def test_acceleration_is_limited() -> None:
    base = SimulatedBase(World(), LIMITS, Pose2())
    base.step(10.0, 10.0, 0.1)
    assert (base.linear, base.angular) == pytest.approx((0.2, 0.6))


@pytest.mark.parametrize("name", ["room.yaml", "hall.yaml"])
def test_the_shipped_worlds_have_room_at_the_start(name: str) -> None:
    surroundings = world.load(str(CONFIG / name))
    assert world.clearance(surroundings.segments(), surroundings.circles, 0.0, 0.0) > 1.0


@pytest.mark.parametrize(
    ("text", "messages"),
    [
        ("walls: [[0, 0, 1]]", ["w.yaml:1:9: walls[0]: expected array of length 4"]),
        ("boxes:\n  - {center: [1, 2], size: [1, -2]}", ["w.yaml:2:32: boxes[0].size[1]: expected float > 0.0"]),
        ("wall: []\ncircle: []", ["w.yaml:1:1: unknown key 'wall'", "w.yaml:2:1: unknown key 'circle'"]),
        ("- 1", ["w.yaml:1:1: expected a map"]),
        ("a: [", ["w.yaml:"]),
    ],
)
def test_mistakes_in_a_world_have_a_place(tmp_path: Path, text: str, messages: list[str]) -> None:
    path = tmp_path / "w.yaml"
    path.write_text(text)
    with pytest.raises(WorldError) as error:
        world.load(str(path))
    for message in messages:
        assert message in str(error.value)


def test_a_missing_world() -> None:
    with pytest.raises(WorldError, match="cannot be read"):
        world.load("nowhere.yaml")


# -- drives ------------------------------------------------------------------------------------------------------------

SKID = SkidSteer(wheel_separation=0.3, wheel_radius=0.05)
CAR = Ackermann(
    wheelbase=0.3, wheel_separation=0.2, wheel_radius=0.05, max_steering_angle=0.5, max_steering_velocity=2.0
)


@pytest.mark.parametrize("drive", [DRIVE, SKID, CAR])
@pytest.mark.parametrize("seed", range(3))
def test_odometry_by_its_wheels_knows_where_it_is(drive: DiffDrive | Ackermann, seed: int) -> None:
    chance = random.Random(seed)
    base = SimulatedBase(World(), LIMITS, Pose2(1.0, 2.0, 0.5), drive)
    odometry = WheelOdometry(drive, pose=base.pose)
    wanted = 0.0, 0.0
    for step in range(1000):
        if step % 50 == 0:
            wanted = chance.uniform(-1.5, 1.5), chance.uniform(-3.0, 3.0)
        left, right, steering = base.wheels
        assert odometry.take_positions([left], [right], step * 0.02, steering=steering)
        assert odometry.pose == pytest.approx(base.pose, abs=1e-9)
        base.step(*wanted, 0.02)


def test_a_skid_steer_drives_as_two_wheels_do_with_wheels_that_turn_more() -> None:
    two, rows = SimulatedBase(World(), LIMITS, Pose2()), SimulatedBase(World(), LIMITS, Pose2(), SKID)
    for base in (two, rows):
        for _ in range(100):
            base.step(0.0, 1.0, 0.02)
    assert two.pose == rows.pose
    assert rows.wheels.right == pytest.approx(1.5 * two.wheels.right)


@given(st.floats(-2, 2), st.floats(-4, 4), st.floats(-2, 2), st.floats(-4, 4))
def test_a_car_steers_no_further_and_no_quicker_than_it_can(v1: float, w1: float, v2: float, w2: float) -> None:
    base = SimulatedBase(World(), LIMITS, Pose2(), CAR)
    for wanted in ((v1, w1), (v2, w2)):
        for _ in range(100):
            before = base.wheels.steering, base.linear
            base.step(*wanted, 0.02)
            assert abs(base.wheels.steering) <= 0.5
            assert abs(base.wheels.steering - before[0]) <= 2.0 * 0.02 + 1e-12
            assert abs(base.angular) <= abs(base.linear) * CAR.max_curvature * (1 + 1e-9)
            assert abs(base.linear - before[1]) <= 5.0 * 0.02 + 1e-12
    if abs(v2) > 0.1:
        wanted_twist = CAR.limited(Twist2(v2, w2))
        limit = min(1.0, 1.5 / abs(wanted_twist.linear), 3.0 / max(abs(wanted_twist.angular), 1e-9))
        assert base.linear == pytest.approx(wanted_twist.linear * limit)
        assert base.angular == pytest.approx(wanted_twist.angular * limit, abs=1e-9), "on the curve that was wanted"


def test_a_car_stands_where_it_is_told_to_turn_on_the_spot_and_where_something_is_in_its_way() -> None:
    base = SimulatedBase(World(walls=((1.0, -5.0, 1.0, 5.0),)), LIMITS, Pose2(), CAR)
    for _ in range(100):
        base.step(0.0, 2.0, 0.02)
    assert (base.pose, base.wheels) == (Pose2(), (0.0, 0.0, 0.0))
    for _ in range(300):
        base.step(1.0, 0.3, 0.02)
    assert base.bumped
    assert (base.linear, base.angular) == (0.0, 0.0)
    pose, steering = base.pose, base.wheels.steering
    base.step(1.0, 0.3, 0.02)
    assert (base.pose, base.wheels.steering) == (pose, steering), "it does not turn at the wall"
