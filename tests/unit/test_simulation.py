import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_services import world
from robo_services.diff_drive import BaseLimits, DiffDrive
from robo_services.kinematics import Pose2, advance
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
    assert (once.x, once.y) == pytest.approx((many.x, many.y), abs=1e-5)
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
    base = DiffDrive(World(walls=((1.0, -1.0, 1.0, 1.0),)), LIMITS, Pose2())
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
    base = DiffDrive(World(), LIMITS, Pose2())
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
