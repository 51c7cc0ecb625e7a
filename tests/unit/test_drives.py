"""Drives: wheels for a velocity, the velocity for wheels, and limits that keep the curve."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_services.drives import STANDING, Ackermann, DiffDrive, Drive, SkidSteer, Wheels
from robo_services.kinematics import Pose2, Twist2, advance, chord

DIFF = DiffDrive(wheel_separation=0.3, wheel_radius=0.05)
SKID = SkidSteer(wheel_separation=0.4, wheel_radius=0.1, wheel_separation_multiplier=1.8)
CAR = Ackermann(wheelbase=0.32, wheel_separation=0.2, wheel_radius=0.05, max_steering_angle=0.6)
DRIVES: dict[str, Drive] = {"diff": DIFF, "skid": SKID, "ackermann": CAR}

lengths = st.floats(0.02, 2.0)
multipliers = st.floats(0.8, 1.25)
velocities = st.floats(-5.0, 5.0)
unlimited = st.just(math.inf)
anything = st.floats(allow_nan=True, allow_infinity=True)


@st.composite
def diff_drives(draw: st.DrawFn, fastest: st.SearchStrategy[float] = unlimited) -> DiffDrive:
    return DiffDrive(
        wheel_separation=draw(lengths),
        wheel_radius=draw(lengths),
        wheel_separation_multiplier=draw(multipliers),
        left_wheel_radius_multiplier=draw(multipliers),
        right_wheel_radius_multiplier=draw(multipliers),
        max_wheel_velocity=draw(fastest),
    )


@st.composite
def skid_steers(draw: st.DrawFn, fastest: st.SearchStrategy[float] = unlimited) -> SkidSteer:
    return SkidSteer(
        wheel_separation=draw(lengths),
        wheel_radius=draw(lengths),
        wheel_separation_multiplier=draw(st.floats(1.0, 3.0)),
        max_wheel_velocity=draw(fastest),
    )


@st.composite
def cars(draw: st.DrawFn, fastest: st.SearchStrategy[float] = unlimited) -> Ackermann:
    return Ackermann(
        wheelbase=draw(lengths),
        wheel_separation=draw(lengths),
        wheel_radius=draw(lengths),
        max_steering_angle=draw(st.floats(0.1, 1.4)),
        left_wheel_radius_multiplier=draw(multipliers),
        max_wheel_velocity=draw(fastest),
    )


limited_drives = diff_drives(st.floats(0.5, 50.0)) | skid_steers(st.floats(0.5, 50.0)) | cars(st.floats(0.5, 50.0))


@given(diff_drives() | skid_steers(), velocities, velocities)
def test_wheels_give_back_the_velocity_that_they_are_for(drive: Drive, linear: float, angular: float) -> None:
    assert drive.twist(drive.wheels(Twist2(linear, angular))) == pytest.approx((linear, angular), abs=1e-12)


@given(diff_drives() | skid_steers(), velocities, velocities)
def test_a_velocity_gives_back_the_wheels_that_make_it(drive: Drive, left: float, right: float) -> None:
    assert drive.wheels(drive.twist(Wheels(left, right))) == pytest.approx((left, right, 0.0), abs=1e-10)


@given(cars(), velocities, st.floats(-1.0, 1.0))
def test_a_car_drives_the_curves_that_it_can_steer(car: Ackermann, linear: float, share: float) -> None:
    twist = Twist2(linear, linear * share * car.max_curvature)
    wheels = car.wheels(twist)
    assert abs(wheels.steering) <= car.max_steering_angle
    assert car.twist(wheels) == pytest.approx(twist, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("drive", "twist", "wheels"),
    [
        (DIFF, Twist2(0.5, 0.0), (10.0, 10.0, 0.0)),
        (DIFF, Twist2(0.0, 1.0), (-3.0, 3.0, 0.0)),
        (DIFF, Twist2(0.15, 1.0), (0.0, 6.0, 0.0)),
        (SKID, Twist2(0.0, 1.0), (-3.6, 3.6, 0.0)),
        (CAR, Twist2(0.5, 0.5), (9.0, 11.0, math.atan(0.32))),
        (CAR, Twist2(-0.5, 0.5), (-11.0, -9.0, -math.atan(0.32))),
    ],
)
def test_as_one_works_it_out_by_hand(drive: Drive, twist: Twist2, wheels: tuple[float, ...]) -> None:
    assert drive.wheels(twist) == pytest.approx(wheels)
    assert drive.twist(drive.wheels(twist)) == pytest.approx(twist)


@given(limited_drives, velocities, velocities)
def test_limits_keep_the_curve(drive: Drive, linear: float, angular: float) -> None:
    """Also of a car, where it can steer it; no wheel is too fast, and one of them is as fast as it can or as wanted."""
    wanted = Twist2(linear, angular)
    if isinstance(drive, Ackermann):
        wanted = Twist2(linear, max(-1.0, min(1.0, angular)) * abs(linear) * drive.max_curvature)
    done = drive.limited(wanted)
    wheels = drive.wheels(wanted)
    assert drive.twist(wheels) == pytest.approx(done, rel=1e-9, abs=1e-12)
    assert done.linear * wanted.angular == pytest.approx(done.angular * wanted.linear, rel=1e-9, abs=1e-12)
    assert math.copysign(1.0, done.linear) == math.copysign(1.0, wanted.linear)
    fastest = max(abs(wheels.left), abs(wheels.right))
    assert fastest <= drive.max_wheel_velocity * (1 + 1e-12)
    assert done == pytest.approx(wanted) or fastest == pytest.approx(drive.max_wheel_velocity)


@given(limited_drives, anything, anything, anything)
def test_whatever_is_wanted_what_comes_out_is_finite_and_within_limits(
    drive: Drive, linear: float, angular: float, steering: float
) -> None:
    wheels = drive.wheels(Twist2(linear, angular), steering)
    assert all(map(math.isfinite, wheels))
    assert max(abs(wheels.left), abs(wheels.right)) <= drive.max_wheel_velocity * (1 + 1e-12)
    if not math.isfinite(linear) or not math.isfinite(angular):
        assert (wheels.left, wheels.right) == (0.0, 0.0), "what is no number moves nothing"


@given(diff_drives() | skid_steers() | cars(), anything, anything)
def test_without_limits_too(drive: Drive, linear: float, angular: float) -> None:
    assert all(map(math.isfinite, drive.wheels(Twist2(linear, angular))))


def test_a_car_turns_no_tighter_than_it_can_and_never_on_the_spot() -> None:
    assert pytest.approx(0.32 / math.tan(0.6)) == CAR.min_turning_radius
    assert CAR.limited(Twist2(0.5, 9.0)) == pytest.approx((0.5, 0.5 / CAR.min_turning_radius))
    assert CAR.limited(Twist2(-0.5, 9.0)) == pytest.approx((-0.5, 0.5 / CAR.min_turning_radius))
    assert CAR.limited(Twist2(5e-324, 9.0)).linear == 5e-324
    assert CAR.limited(Twist2(0.0, 1.0)) == STANDING
    assert CAR.wheels(Twist2(0.0, 1.0), 0.3) == (0.0, 0.0, 0.3), "it steers nowhere else"
    assert CAR.wheels(Twist2(0.0, 1.0), math.nan) == (0.0, 0.0, 0.0)
    assert CAR.wheels(Twist2(0.0, 1.0), 3.0) == (0.0, 0.0, 0.6)


def test_steering_takes_its_time() -> None:
    car = Ackermann(
        wheelbase=0.32, wheel_separation=0.2, wheel_radius=0.05, max_steering_angle=0.6, max_steering_velocity=2.0
    )
    assert car.steered(0.0, 0.5, 0.1) == pytest.approx(0.2)
    assert car.steered(0.4, 0.5, 0.1) == 0.5
    assert car.steered(0.0, -9.0, 0.1) == pytest.approx(-0.2)
    assert car.steered(-0.5, -9.0, 0.1) == -0.6
    assert CAR.steered(0.0, 0.5, 0.001) == 0.5, "unless nothing is said"


@given(cars(), st.floats(-1.0, 1.0))
def test_all_wheels_of_a_car_turn_around_one_point(car: Ackermann, share: float) -> None:
    steering = share * car.max_steering_angle
    left, right = car.front_wheels(steering)
    if abs(steering) < 1e-3:
        assert (left, right) == pytest.approx((steering, steering), abs=1e-3)
        return
    radius = car.wheelbase / math.tan(steering)
    for angle, aside in ((left, car.wheel_separation / 2), (right, -car.wheel_separation / 2)):
        # The wheel stands at (wheelbase, aside), the point at (0, radius): its direction is at right angles to that.
        across = math.cos(angle) * -car.wheelbase + math.sin(angle) * (radius - aside)
        assert across == pytest.approx(0.0, abs=1e-9 * (1 + abs(radius)))
    if radius > car.wheel_separation / 2:
        assert left > right, "the inner one steers more"


@pytest.mark.parametrize("name", ["wheel_separation", "wheel_radius", "left_wheel_radius_multiplier"])
@pytest.mark.parametrize("value", [0.0, -1.0, 1e-300, 1e300, math.nan, math.inf])
def test_what_is_no_base_is_refused(name: str, value: float) -> None:
    given: dict[str, float] = {"wheel_separation": 0.3, "wheel_radius": 0.05, name: value}
    with pytest.raises(ValueError, match=f"{name} = "):
        DiffDrive(**given)
    with pytest.raises(ValueError, match=f"{name} = "):
        Ackermann(wheelbase=0.3, max_steering_angle=0.5, **given)


def test_more_that_is_no_base() -> None:
    with pytest.raises(ValueError, match=r"max_wheel_velocity = 0: more than 0"):
        DiffDrive(wheel_separation=0.3, wheel_radius=0.05, max_wheel_velocity=0.0)
    with pytest.raises(ValueError, match=r"wheel_separation_multiplier = 0\.9: a skid steer has at least 1"):
        SkidSteer(wheel_separation=0.3, wheel_radius=0.05, wheel_separation_multiplier=0.9)
    for angle in (0.0, math.pi / 2, math.nan, -0.5):
        with pytest.raises(ValueError, match="max_steering_angle = "):
            Ackermann(wheelbase=0.3, wheel_separation=0.2, wheel_radius=0.05, max_steering_angle=angle)
    with pytest.raises(ValueError, match="max_steering_velocity = "):
        Ackermann(
            wheelbase=0.3, wheel_separation=0.2, wheel_radius=0.05, max_steering_angle=0.5, max_steering_velocity=0.0
        )


# -- arcs --------------------------------------------------------------------------------------------------------------


@given(st.floats(-2, 2), st.floats(-3, 3), st.floats(-3, 3), st.floats(0.01, 2))
def test_an_arc_is_what_many_small_steps_come_to(yaw: float, linear: float, angular: float, dt: float) -> None:
    """Simpson's rule over the velocity, which knows nothing of arcs."""
    parts = 200
    x = y = 0.0
    for i in range(parts):
        for place, weight in ((0.0, 1.0), (0.5, 4.0), (1.0, 1.0)):
            heading = yaw + angular * dt * (i + place) / parts
            x += linear * math.cos(heading) * dt / parts * weight / 6
            y += linear * math.sin(heading) * dt / parts * weight / 6
    moved = advance(Pose2(0.0, 0.0, yaw), linear, angular, dt)
    assert (moved.x, moved.y) == pytest.approx((x, y), abs=1e-9)  # which is what Simpson is good for
    assert math.remainder(moved.yaw - yaw - angular * dt, math.tau) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(-10, 10), st.floats(-3, 3), st.integers(1, 50))
def test_an_arc_is_the_same_in_parts(distance: float, turn: float, parts: int) -> None:
    once = advance(Pose2(1.0, 2.0, 0.5), distance, turn, 1.0)
    many = Pose2(1.0, 2.0, 0.5)
    for _ in range(parts):
        many = advance(many, distance, turn, 1.0 / parts)
    assert (many.x, many.y) == pytest.approx((once.x, once.y), abs=1e-12)
    back = advance(once, -distance, -turn, 1.0)
    assert (back.x, back.y) == pytest.approx((1.0, 2.0), abs=1e-12)


@pytest.mark.parametrize("turn", [0.0, 5e-324, 1e-300, 1e-17, 1e-9, 9.99e-7, 1.01e-6, 1e-5])
def test_the_widest_arc_is_as_exact_as_any(turn: float) -> None:
    x, y = chord(10.0, turn, 0.0)
    assert x == pytest.approx(10.0 - 10.0 * turn * turn / 6, rel=1e-15)
    assert y == pytest.approx(10.0 * turn / 2, rel=1e-9, abs=1e-300)
