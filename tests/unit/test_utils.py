import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import Point, Pose, Quaternion
from robo_services import utils
from robo_services.limits import clamp, ramp

angles = st.floats(-1e9, 1e9)
metres = st.floats(-1e4, 1e4)
yaws = st.floats(-math.pi, math.pi, exclude_min=True)
poses = st.builds(lambda x, y, yaw: Pose(Point(x, y), utils.quaternion_from_yaw(yaw)), metres, metres, yaws)


@given(angles)
def test_a_normalized_angle_is_the_same_direction_in_range(angle: float) -> None:
    wrapped = utils.normalize_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-6)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-6)
    assert utils.normalize_angle(wrapped) == wrapped


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(math.pi, math.pi), (-math.pi, math.pi), (0.0, 0.0), (3 * math.pi, math.pi), (1.5 * math.pi, -0.5 * math.pi)],
)
def test_the_ends_of_the_range(angle: float, expected: float) -> None:
    assert utils.normalize_angle(angle) == pytest.approx(expected)


@pytest.mark.parametrize("angle", [math.nan, math.inf, -math.inf])
def test_no_angle(angle: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        utils.normalize_angle(angle)


@given(angles, angles)
def test_a_difference_leads_from_one_to_the_other(a: float, b: float) -> None:
    turned = utils.normalize_angle(b) + utils.angle_difference(a, b)
    assert math.cos(turned) == pytest.approx(math.cos(utils.normalize_angle(a)), abs=1e-6)
    assert math.sin(turned) == pytest.approx(math.sin(utils.normalize_angle(a)), abs=1e-6)


@given(metres, metres, metres, metres)
def test_distance_and_heading_lead_to_the_other_point(ax: float, ay: float, bx: float, by: float) -> None:
    a, b = Point(ax, ay), Point(bx, by)
    d, h = utils.distance(a, b), utils.heading(a, b)
    assert -math.pi < h <= math.pi
    assert d == utils.distance(b, a) >= 0
    assert (ax + d * math.cos(h), ay + d * math.sin(h)) == pytest.approx((bx, by), abs=1e-6)


@given(yaws)
def test_yaw_to_quaternion_and_back(yaw: float) -> None:
    q = utils.quaternion_from_yaw(yaw)
    assert q.x == q.y == 0.0
    assert math.hypot(q.z, q.w) == pytest.approx(1.0)
    back = utils.yaw_from_quaternion(q)
    assert math.remainder(back - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert -math.pi < back <= math.pi


def test_yaw_ignores_length() -> None:
    assert utils.yaw_from_quaternion(Quaternion(0, 0, 2.0, 2.0)) == pytest.approx(math.pi / 2)


@given(poses, metres, metres)
def test_frames_there_and_back(pose: Pose, x: float, y: float) -> None:
    point = Point(x, y, 1.0)
    back = utils.to_child(pose, utils.to_parent(pose, point))
    assert (back.x, back.y, back.z) == pytest.approx((x, y, 1.0), abs=1e-6)


@given(poses, poses, metres, metres)
def test_composed_poses_transform_like_one_after_the_other(a: Pose, b: Pose, x: float, y: float) -> None:
    once = utils.to_parent(utils.compose(a, b), Point(x, y))
    twice = utils.to_parent(a, utils.to_parent(b, Point(x, y)))
    assert (once.x, once.y) == pytest.approx((twice.x, twice.y), abs=1e-5)


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.001, 1), st.floats(0.1, 5), st.floats(0.1, 5))
def test_a_ramp_never_exceeds_its_limits_and_arrives(
    v: float, target: float, dt: float, up: float, down: float
) -> None:
    nxt = ramp(v, target, dt, up, down)
    assert abs(nxt - v) <= max(up, down) * dt + 1e-9
    assert abs(nxt - target) <= abs(v - target)
    for _ in range(int(12 / (min(up, down) * dt)) + 2):
        v = ramp(v, target, dt, up, down)
    assert v == target


def test_braking_is_not_limited_by_acceleration() -> None:
    assert ramp(1.0, 0.0, 0.1, 0.5, 5.0) == pytest.approx(0.5)
    assert ramp(0.0, 1.0, 0.1, 0.5, 5.0) == pytest.approx(0.05)
    assert ramp(0.1, -1.0, 0.1, 0.5, 5.0) == 0.0
    assert clamp(-3.0, 2.0) == -2.0
