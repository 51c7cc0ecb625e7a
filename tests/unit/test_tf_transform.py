"""Rigid transforms as values: their algebra, their messages, and the motion between two of them."""

import copy
import math
import pickle
import re
from collections.abc import Sequence

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from robo.errors import InvalidTransform, TransformError
from robo.tf import IDENTITY, Transform3, interpolate
from robo.tf.screw import between, followed
from robo_messages import (
    Header,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    Time,
    Transform,
    TransformStamped,
    Vector3,
)
from robo_services.planar import yaw_from_quaternion
from tests.transforms import apart

Vec = tuple[float, float, float]

EXACT = 1e-12

metres = st.floats(-10.0, 10.0)
places = st.tuples(metres, metres, metres)
parts = st.floats(-1.0, 1.0)
fractions = st.floats(0.0, 1.0)


@st.composite
def axes(draw: st.DrawFn) -> Vec:
    x, y, z = draw(parts), draw(parts), draw(parts)
    length = math.hypot(x, y, z)
    assume(length > 0.1)
    return x / length, y / length, z / length


@st.composite
def transforms(draw: st.DrawFn) -> Transform3:
    (x, y, z), axis, half = draw(places), draw(axes()), draw(st.floats(-math.pi, math.pi))
    s = math.sin(half)
    return Transform3(x, y, z, s * axis[0], s * axis[1], s * axis[2], math.cos(half))


def turn(axis: Vec, angle: float) -> Transform3:
    s = math.sin(angle / 2)
    return Transform3(0.0, 0.0, 0.0, s * axis[0], s * axis[1], s * axis[2], math.cos(angle / 2))


def screw(axis: Vec, through: Vec, along: float, angle: float) -> Transform3:
    """A turn about an axis through a point, and the way along it."""
    rotation = turn(axis, angle)
    moved = rotation.apply(*through)
    x, y, z = (p - m + along * a for p, m, a in zip(through, moved, axis, strict=True))
    return Transform3(x, y, z, *rotation[3:])


def other_sign(transform: Transform3) -> Transform3:
    x, y, z, qx, qy, qz, qw = transform
    return Transform3(x, y, z, -qx, -qy, -qz, -qw)


def product(a: Sequence[Sequence[float]], b: Sequence[Sequence[float]]) -> list[list[float]]:
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


# Algebra


@given(transforms(), transforms(), transforms())
def test_products_are_a_group(a: Transform3, b: Transform3, c: Transform3) -> None:
    assert apart((a @ b) @ c, a @ (b @ c)) < EXACT
    assert apart(a @ a.inverse(), IDENTITY) < EXACT
    assert apart(a.inverse() @ a, IDENTITY) < EXACT
    assert apart((a @ b).inverse(), b.inverse() @ a.inverse()) < EXACT
    assert apart(a @ IDENTITY, a) == apart(IDENTITY @ a, a) == 0.0
    assert apart(a.inverse().inverse(), a) < EXACT


@given(transforms(), transforms(), places)
def test_a_transform_is_its_matrix(a: Transform3, b: Transform3, point: Vec) -> None:
    for row, expected in zip((a @ b).matrix(), product(a.matrix(), b.matrix()), strict=True):
        assert row == pytest.approx(expected, abs=EXACT)
    column = [[coordinate, 0.0, 0.0, 0.0] for coordinate in (*point, 1.0)]
    assert a.apply(*point) == pytest.approx([row[0] for row in product(a.matrix(), column)[:3]], abs=EXACT)
    assert (a @ b).apply(*point) == pytest.approx(a.apply(*b.apply(*point)), abs=EXACT)
    assert a.inverse().apply(*a.apply(*point)) == pytest.approx(point, abs=EXACT)


@given(transforms(), places, places)
def test_a_vector_is_turned_and_not_moved(a: Transform3, v: Vec, w: Vec) -> None:
    assert math.hypot(*a.rotate(*v)) == pytest.approx(math.hypot(*v), abs=EXACT)
    difference = tuple(p - q for p, q in zip(a.apply(*v), a.apply(*w), strict=True))
    assert a.rotate(*(p - q for p, q in zip(v, w, strict=True))) == pytest.approx(difference, abs=EXACT)


def test_a_quarter_turn_to_the_left() -> None:
    odom_base = Transform3.planar(2.0, 0.0, math.pi / 2)
    assert (odom_base @ Transform3(x=0.1)).apply(1.0, 0.0, 0.0) == pytest.approx((2.0, 1.1, 0.0))
    assert odom_base.rotate(0.0, 1.0, 0.5) == pytest.approx((-1.0, 0.0, 0.5))
    assert odom_base.inverse().apply(2.0, 1.0, 0.0) == pytest.approx((1.0, 0.0, 0.0))


def test_a_long_product_stays_a_rotation() -> None:
    step, at = Transform3.from_rpy(0.001, 0.0, 0.0, 0.1, 0.2, 0.3), IDENTITY
    for _ in range(20_000):
        at = at @ step
    assert math.hypot(*at[3:]) == pytest.approx(1.0, abs=1e-14)


@given(transforms())
def test_a_product_with_what_is_no_transform_is_refused(a: Transform3) -> None:
    with pytest.raises(TypeError):
        a @ (1.0, 2.0, 3.0)  # type: ignore[operator]


def test_a_transform_is_a_value() -> None:
    a = Transform3(1, 2, 3)
    assert (a.x, a.y, a.z, a.qx, a.qy, a.qz, a.qw) == tuple(a) == (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
    assert all(type(number) is float for number in a)
    assert a == Transform3(1.0, 2.0, 3.0) != IDENTITY
    assert len({a, Transform3(1.0, 2.0, 3.0), IDENTITY}) == 2
    assert repr(a) == "Transform3(x=1.0, y=2.0, z=3.0, qx=0.0, qy=0.0, qz=0.0, qw=1.0)"
    assert pickle.loads(pickle.dumps(a)) == copy.deepcopy(a) == a
    with pytest.raises(AttributeError):
        a.x = 2.0  # type: ignore[misc]
    with pytest.raises(AttributeError):
        a.extra = 2.0  # type: ignore[attr-defined]


# What is a transform


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("index", range(7))
def test_a_number_that_is_not_finite_is_refused(index: int, number: float) -> None:
    numbers = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    numbers[index] = number
    with pytest.raises(InvalidTransform, match="are not all finite"):
        Transform3(*numbers)


@pytest.mark.parametrize(
    ("q", "text"),
    [
        ((0.0, 0.0, 0.0, 0.0), "has norm 1, and this one 0; no turn at all is (0, 0, 0, 1)"),
        ((0.0, 1e-9, 0.0, 0.0), "has norm 1, and this one 1e-09; no turn at all is (0, 0, 0, 1)"),
        ((0.0, 0.0, 1.0, 1.0),
         "(0.0, 0.0, 1.0, 1.0) is no rotation: a unit quaternion x, y, z, w has norm 1, and this one 1.41"),
        ((0.0, 0.0, 0.0, 1.1), "and this one 1.1"),
        ((1e200, 1e200, 0.0, 0.0), "and this one 1.41e+200"),
    ],
)  # fmt: skip
def test_a_quaternion_that_is_no_rotation_is_refused(q: tuple[float, float, float, float], text: str) -> None:
    with pytest.raises(InvalidTransform, match=re.escape(text) + "$"):
        Transform3(0.0, 0.0, 0.0, *q)
    assert issubclass(InvalidTransform, (TransformError, ValueError))


@given(transforms(), st.floats(-0.004, 0.004))
def test_a_quaternion_that_is_nearly_unit_is_normalized(a: Transform3, off: float) -> None:
    b = Transform3(*a[:3], *((1.0 + off) * part for part in a[3:]))
    assert apart(a, b) < EXACT
    assert math.hypot(*b[3:]) == pytest.approx(1.0, abs=1e-15)


# Messages


@given(transforms())
def test_there_and_back_as_messages(a: Transform3) -> None:
    stamped = a.to_stamped(Header(Time(3), "odom"), "base_link")
    assert stamped == TransformStamped(Header(Time(3), "odom"), "base_link", a.to_transform())
    for message in (a.to_transform(), stamped, a.to_pose(), PoseStamped(pose=a.to_pose())):
        assert Transform3.from_message(message) == a


def test_messages_hold_what_they_say() -> None:
    a = Transform3.from_message(Transform(Vector3(1.0, 2.0, 3.0), Quaternion(0.0, 0.0, 1.0, 0.0)))
    assert a == Transform3(1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.0)
    assert a.apply_point(Point(1.0, 0.0, 0.0)) == Point(0.0, 2.0, 3.0)
    assert a.apply_vector(Vector3(1.0, 0.0, 0.5)) == Vector3(-1.0, 0.0, 0.5)
    turned = a.apply_pose(Pose(Point(0.0, 1.0, 0.0), Quaternion(0.0, 0.0, 1.0, 0.0)))
    assert turned == Pose(Point(1.0, 1.0, 3.0), Quaternion(0.0, 0.0, 0.0, -1.0))
    with pytest.raises(InvalidTransform, match="no turn at all"):
        a.apply_pose(Pose(orientation=Quaternion(w=0.0)))


# Angles


@given(transforms())
def test_roll_pitch_and_yaw_there_and_back(a: Transform3) -> None:
    roll, pitch, yaw = a.rpy()
    assert apart(Transform3.from_rpy(*a[:3], roll, pitch, yaw), a) < EXACT
    assert abs(pitch) <= math.pi / 2
    assert max(abs(roll), abs(yaw)) <= math.pi


@pytest.mark.parametrize("up", [-math.pi / 2, math.pi / 2])
@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-9, 1e-6])
@pytest.mark.parametrize(("roll", "yaw"), [(0.0, 0.0), (0.3, -2.0), (-3.0, 1.0)])
def test_where_x_points_up_or_down_the_angles_are_still_the_rotation(
    up: float, off: float, roll: float, yaw: float
) -> None:
    a = Transform3.from_rpy(0.0, 0.0, 0.0, roll, up - math.copysign(off, up), yaw)
    found = a.rpy()
    assert apart(Transform3.from_rpy(0.0, 0.0, 0.0, *found), a) < EXACT
    assert found[1] == pytest.approx(up - math.copysign(off, up), abs=EXACT)
    assert off or found[0] == 0.0


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi))
def test_angles_turn_about_fixed_axes_in_the_order_x_y_z(roll: float, yaw: float) -> None:
    in_turn = turn((0.0, 0.0, 1.0), yaw) @ turn((0.0, 1.0, 0.0), 0.5) @ turn((1.0, 0.0, 0.0), roll)
    assert apart(Transform3.from_rpy(0.0, 0.0, 0.0, roll, 0.5, yaw), in_turn) < EXACT


@given(metres, metres, st.floats(-3.14, 3.14))
def test_a_transform_in_the_plane(x: float, y: float, yaw: float) -> None:
    a = Transform3.planar(x, y, yaw)
    assert a.rpy() == pytest.approx((0.0, 0.0, yaw), abs=EXACT)
    assert yaw_from_quaternion(a.to_pose().orientation) == pytest.approx(yaw, abs=EXACT)
    assert apart(a, Transform3.from_rpy(x, y, 0.0, 0.0, 0.0, yaw)) < EXACT


# The motion between two


angles = st.floats(0.0, 3.1) | st.sampled_from([1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 1e-18, 1e-80, 1e-160, 3.14159])


@given(transforms(), axes(), places, metres, angles, fractions)
def test_between_two_poses_of_a_constant_twist_is_the_true_pose(
    start: Transform3, axis: Vec, through: Vec, along: float, angle: float, fraction: float
) -> None:
    begin, end = (screw(axis, through, along * f, 0.3 + angle * f) @ start for f in (0.0, 1.0))
    true = screw(axis, through, along * fraction, 0.3 + angle * fraction) @ start
    found = interpolate(begin, end, fraction)
    assert apart(found, true) < EXACT
    assert interpolate(begin, other_sign(end), fraction) == found
    assert apart(interpolate(other_sign(begin), end, fraction), found) < EXACT


@given(st.floats(0.05, 10.0), st.floats(-1.5, 1.5), st.floats(-1.0, 1.0), fractions)
def test_a_body_on_a_circle_or_a_helix(radius: float, angle: float, climb: float, fraction: float) -> None:
    def pose(f: float) -> Transform3:
        x, y = radius * math.sin(angle * f), radius * (1.0 - math.cos(angle * f))
        return Transform3(x, y, climb * f, 0.0, 0.0, math.sin(angle * f / 2), math.cos(angle * f / 2))

    assert apart(interpolate(pose(0.0), pose(1.0), fraction), pose(fraction)) < EXACT


@given(transforms(), transforms(), st.integers(2, 12))
def test_equal_steps_add_up_to_the_whole(a: Transform3, b: Transform3, count: int) -> None:
    step = a.inverse() @ interpolate(a, b, 1.0 / count)
    at = a
    for _ in range(count):
        at = at @ step
    assert apart(at, b) < 1e-11


@given(transforms(), transforms())
def test_the_ends_are_the_two(a: Transform3, b: Transform3) -> None:
    assert apart(interpolate(a, b, 0.0), a) < EXACT
    assert apart(interpolate(a, b, 1.0), b) < EXACT
    assert interpolate(a, a, 0.3) == a


@given(transforms(), transforms(), fractions)
def test_the_way_back_is_the_same(a: Transform3, b: Transform3, fraction: float) -> None:
    assume(abs(sum(p * q for p, q in zip(a[3:], b[3:], strict=True))) > 1e-9)  # half a turn has two ways
    assert apart(interpolate(a, b, fraction), interpolate(b, a, 1.0 - fraction)) < EXACT


@given(transforms(), transforms(), transforms(), fractions)
def test_the_motion_does_not_depend_on_the_frames_in_which_it_is_seen(
    a: Transform3, b: Transform3, seen: Transform3, fraction: float
) -> None:
    assume(abs(sum(p * q for p, q in zip(a[3:], b[3:], strict=True))) > 1e-9)
    assert apart(interpolate(seen @ a, seen @ b, fraction), seen @ interpolate(a, b, fraction)) < 1e-10
    assert apart(interpolate(a @ seen, b @ seen, fraction), interpolate(a, b, fraction) @ seen) < 1e-10


@given(transforms(), transforms(), fractions)
def test_it_turns_the_shortest_way(a: Transform3, b: Transform3, fraction: float) -> None:
    def angle(one: Transform3, other: Transform3) -> float:
        x, y, z, w = (one.inverse() @ other)[3:]
        return 2.0 * math.atan2(math.hypot(x, y, z), abs(w))

    whole = angle(a, b)
    assert whole <= math.pi
    assert angle(a, interpolate(a, b, fraction)) == pytest.approx(fraction * whole, abs=1e-12)


@given(axes(), st.sampled_from([0.0, 1e-17, -1e-17, 1e-12, -1e-12, 1e-9, -1e-9]), fractions)
def test_near_half_a_turn_it_goes_one_of_the_two_ways(axis: Vec, off: float, fraction: float) -> None:
    end = turn(axis, math.pi + off)
    found = interpolate(IDENTITY, end, fraction)
    ways = [turn(axis, sign * math.pi * fraction) for sign in (1.0, -1.0)]
    assert min(apart(found, way) for way in ways) < 1e-8
    assert interpolate(IDENTITY, other_sign(end), fraction) == found


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)])
def test_of_exactly_half_a_turn_both_signs_mean_the_same_way(axis: Vec) -> None:
    half = Transform3(1.0, 2.0, 3.0, *axis, 0.0)
    assert interpolate(IDENTITY, half, 0.5) == interpolate(IDENTITY, other_sign(half), 0.5)


@given(places, st.floats(1e-320, 1e-3), fractions)
@example((0.0, 10.0, 0.0), 1e-3, 0.5)
def test_the_smallest_turns_are_no_trouble(place: Vec, angle: float, fraction: float) -> None:
    end = Transform3(*place, angle / 2, 0.0, 0.0, math.sqrt(1.0 - angle * angle / 4))
    found = interpolate(IDENTITY, end, fraction)
    assert all(map(math.isfinite, found))
    # The origin is on an arc whose height over the chord is an eighth of its angle times its length, and a little more.
    assert found[:3] == pytest.approx([fraction * one for one in place], abs=EXACT + angle / 7 * math.hypot(*place))
    assert found.qx == pytest.approx(fraction * angle / 2, rel=1e-6, abs=1e-150)


@pytest.mark.parametrize("angle", [1e-140, 1e-155, 4e-162, 1e-162, 1e-170, 5e-324])
def test_the_smallest_turns_are_no_trouble_far_beyond_the_ends_either(angle: float) -> None:
    found = interpolate(IDENTITY, Transform3(1.0, 10.0, -10.0, angle, 0.0, 0.0, 1.0), 1e9)
    assert found[:3] == pytest.approx((1e9, 1e10, -1e10))


def test_beyond_its_ends_the_motion_goes_on() -> None:
    a, b = Transform3.planar(0.0, 0.0, 0.0), Transform3.planar(1.0, 1.0, math.pi / 2)
    assert apart(interpolate(a, b, 2.0), Transform3.planar(0.0, 2.0, math.pi)) < EXACT
    assert apart(interpolate(a, b, -1.0), Transform3.planar(-1.0, 1.0, -math.pi / 2)) < EXACT


@given(st.lists(st.tuples(transforms(), transforms()), min_size=1, max_size=6), fractions)
def test_a_chain_of_motions_is_the_product_of_each(ends: list[tuple[Transform3, Transform3]], fraction: float) -> None:
    expected = IDENTITY
    for a, b in ends:
        expected = interpolate(a, b, fraction) @ expected
    found = Transform3(*followed([between(10.0, 14.0, (*a, *b)) for a, b in ends], 10.0 + 4.0 * fraction))
    assert apart(found, expected) < 1e-11
