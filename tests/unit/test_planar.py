import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import Quaternion
from robo_services import planar
from robo_services.limits import clamp, ramp

angles = st.floats(-1e9, 1e9)
yaws = st.floats(-math.pi, math.pi, exclude_min=True)


@given(angles)
def test_a_normalized_angle_is_the_same_direction_in_range(angle: float) -> None:
    wrapped = planar.normalize_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-6)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-6)
    assert planar.normalize_angle(wrapped) == wrapped


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(math.pi, math.pi), (-math.pi, math.pi), (0.0, 0.0), (3 * math.pi, math.pi), (1.5 * math.pi, -0.5 * math.pi)],
)
def test_the_ends_of_the_range(angle: float, expected: float) -> None:
    assert planar.normalize_angle(angle) == pytest.approx(expected)


@pytest.mark.parametrize("angle", [math.nan, math.inf, -math.inf])
def test_no_angle(angle: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        planar.normalize_angle(angle)


@given(angles, angles)
def test_a_difference_leads_from_one_to_the_other(a: float, b: float) -> None:
    turned = planar.normalize_angle(b) + planar.angle_difference(a, b)
    assert math.cos(turned) == pytest.approx(math.cos(planar.normalize_angle(a)), abs=1e-6)
    assert math.sin(turned) == pytest.approx(math.sin(planar.normalize_angle(a)), abs=1e-6)


@given(yaws)
def test_yaw_to_quaternion_and_back(yaw: float) -> None:
    q = planar.quaternion_from_yaw(yaw)
    assert q.x == q.y == 0.0
    assert math.hypot(q.z, q.w) == pytest.approx(1.0)
    back = planar.yaw_from_quaternion(q)
    assert math.remainder(back - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert -math.pi < back <= math.pi


def test_yaw_ignores_length() -> None:
    assert planar.yaw_from_quaternion(Quaternion(0, 0, 2.0, 2.0)) == pytest.approx(math.pi / 2)


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
