"""When shapes that move on arcs touch points: closed forms beside what small steps find."""

import math

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from robo_services.contact import Shape, Sweep, Velocity, closing_speed, disc, polygon
from robo_services.kinematics import Pose2
from robo_services.obstacles import moved_by

SQUARE = polygon([(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)])
DENTED = polygon([(0.4, 0.3), (0.0, 0.1), (-0.4, 0.3), (-0.4, -0.3), (0.4, -0.3)])
SHAPES = st.sampled_from([disc(0.2), disc(0.15, 0.1, -0.05), SQUARE, DENTED])
COORDINATES = st.floats(-1.2, 1.2)
VELOCITIES = st.builds(
    Velocity, st.floats(-1.5, 1.5), st.sampled_from([0.0, 0.0, 0.4, -1.0]), st.one_of(st.just(0.0), st.floats(-3, 3))
)
STEP = 0.005
HORIZON = 2.5


def distance_after(shape: Shape, velocity: Velocity, x: float, y: float, seconds: float) -> float:
    """How far the point is from the shape once that has moved."""
    at = moved_by(Pose2(), velocity, seconds)
    cos, sin = math.cos(at.yaw), math.sin(at.yaw)
    dx, dy = x - at.x, y - at.y
    return shape.distance(cos * dx + sin * dy, cos * dy - sin * dx)


@settings(max_examples=400)
@example(DENTED, Velocity(0.0, 0.4), 0.0, 1.0, 0.0)  # right at a corner
@given(SHAPES, VELOCITIES, COORDINATES, COORDINATES, st.sampled_from([0.0, 0.05, 0.3]))
def test_a_contact_is_found_when_small_steps_find_it(
    shape: Shape, velocity: Velocity, x: float, y: float, margin: float
) -> None:
    assume(shape.distance(x, y) > margin + 1e-6)
    time = Sweep(shape, velocity, margin).time(x, y)
    fastest = velocity.speed + abs(velocity.turn) * (shape.reach + 3.0)
    blur = fastest * STEP + 1e-3
    if time < math.inf:
        assert distance_after(shape, velocity, x, y, time) == pytest.approx(margin, abs=1e-6 + 1e-3 * time)
    for i in range(round(min(time, HORIZON) / STEP)):
        found = distance_after(shape, velocity, x, y, i * STEP)
        assert found > margin - blur, f"touched after {i * STEP:g} s, and {time} was found"


def test_the_time_to_a_wall_ahead_and_to_one_beside_an_arc() -> None:
    assert Sweep(disc(0.2), Velocity(0.5)).time(1.2, 0.0) == pytest.approx(2.0)
    assert Sweep(disc(0.2), Velocity(0.5)).time(1.2, 0.201) == math.inf
    assert Sweep(disc(0.2), Velocity(-0.5)).time(1.2, 0.0) == math.inf
    # A quarter of a circle with a radius of 1 m ends at (1, 1), where the robot looks to the left.
    quarter = math.pi / 2
    assert Sweep(disc(0.2), Velocity(1.0, 0.0, 1.0)).time(1.0, 1.2) == pytest.approx(quarter, abs=0.02)
    assert Sweep(SQUARE, Velocity(0.5)).time(1.3, 0.1) == pytest.approx(2.0)
    assert Sweep(SQUARE, Velocity(0.5), 0.1).time(1.3, 0.1) == pytest.approx(1.8)


def test_a_turn_on_the_spot_touches_by_corners_alone() -> None:
    turning = Velocity(turn=1.0)
    corner = math.hypot(0.3, 0.2)
    assert Sweep(disc(0.3), turning).time(0.301, 0.0) == math.inf
    assert Sweep(SQUARE, turning).time(corner + 0.001, 0.0) == math.inf
    ahead = Sweep(SQUARE, turning).time(corner - 0.01, 0.0)
    assert 0.0 < ahead < math.atan2(0.2, 0.3)
    assert Sweep(SQUARE, Velocity(turn=-1.0)).time(corner - 0.01, 0.0) == pytest.approx(ahead)
    assert Sweep(SQUARE, Velocity()).time(1.0, 0.0) == math.inf


def test_what_is_nearest() -> None:
    assert disc(0.2).nearest(0.5, 0.0) == pytest.approx((0.3, 1.0, 0.0))
    assert SQUARE.nearest(0.5, 0.0) == pytest.approx((0.2, 1.0, 0.0))
    assert SQUARE.nearest(0.25, 0.0) == pytest.approx((-0.05, 1.0, 0.0))
    assert DENTED.distance(0.0, 0.2) == pytest.approx(0.1 / math.hypot(1, 0.5), abs=0.01)
    assert SQUARE.reach == pytest.approx(math.hypot(0.3, 0.2))
    assert closing_speed(disc(0.2), 0.5, 0.0, Velocity(0.3)) == pytest.approx(0.3)
    assert closing_speed(SQUARE, 0.25, 0.5, Velocity(turn=1.0)) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("corners", "text"),
    [
        ([(0, 0), (1, 0)], "at least three corners"),
        ([(0, 0), (1, 0), (2, 0)], "flat"),
        ([(0, 0), (1, 1), (1, 0), (0, 2)], "cross"),
        ([(0, 0), (2, 0), (2, 1), (1, 1), (1, -1), (0, 1)], "cross"),
        ([(0, 0), (1, 0), (1, 0), (0, 1)], "twice"),
        ([(0, 0), (1, math.nan), (0, 1)], "no number"),
        ([(0, 0), (1e9, 1), (0, 1)], "no number, or further"),
    ],
)
def test_what_is_no_polygon_is_refused(corners: list[tuple[float, float]], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        polygon(corners)


def test_the_order_of_corners_does_not_matter() -> None:
    there, back = (
        [(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)],
        [(0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2), (0.3, 0.2)],
    )
    assert polygon(there).distance(1.0, 0.0) == polygon(back).distance(1.0, 0.0) == pytest.approx(0.7)
    with pytest.raises(ValueError, match="radius"):
        disc(-1.0)


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.7])
def test_two_sides_on_one_line_do_not_cross(turn: float) -> None:
    fork = [(0, 0), (1, 0), (1, 1), (0.7, 1), (0.7, 0.5), (0.3, 0.5), (0.3, 1), (0, 1)]
    cos, sin = math.cos(turn), math.sin(turn)
    assert len(polygon([(cos * x - sin * y, sin * x + cos * y) for x, y in fork]).edges) == 8
