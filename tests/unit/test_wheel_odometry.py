"""Odometry by wheels: where it leads, what is not believed, and how sure it is."""

import itertools
import math
import random
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import Header
from robo_services.drives import Ackermann, DiffDrive, Drive, SkidSteer, Wheels
from robo_services.kinematics import Pose2, Twist2, advance
from robo_services.uncertainty import NOT_MEASURED, Noise, PoseCovariance
from robo_services.wheel_odometry import Encoders, WheelOdometry

DIFF = DiffDrive(wheel_separation=0.3, wheel_radius=0.05, max_wheel_velocity=30.0)
SKID = SkidSteer(wheel_separation=0.4, wheel_radius=0.1, wheel_separation_multiplier=1.8, max_wheel_velocity=30.0)
CAR = Ackermann(
    wheelbase=0.32, wheel_separation=0.2, wheel_radius=0.05, max_steering_angle=0.6, max_wheel_velocity=30.0
)
DRIVES: dict[str, Drive] = {"diff": DIFF, "skid": SKID, "ackermann": CAR}

STEP = 0.02
"""s."""

Leg = tuple[Twist2, int]
"""A velocity, and for how many steps."""


def legs_of_a_square(side: float, radius: float, speed: float = 0.5, *, left: bool = True) -> list[Leg]:
    """Four sides, m, with corners that are quarters of a circle; of radius 0 turns on the spot."""
    way = round(side / speed / STEP)
    corner = math.pi / 2 * (radius / speed if radius else 0.5)  # s: on the spot it turns by 2 rad/s
    steps = math.ceil(corner / STEP)
    turn = math.pi / 2 / (steps * STEP) * (1 if left else -1)
    return 4 * [(Twist2(speed), way), (Twist2(radius * abs(turn), turn), steps)]


def driven(drive: Drive, legs: list[Leg]) -> Iterator[tuple[float, Wheels]]:
    """When, s, and where the wheels are then, rad."""
    left = right = 0.0
    steering = next((drive.wheels(twist).steering for twist, _ in legs), 0.0)
    step = 0
    yield 0.0, Wheels(0.0, 0.0, steering)
    for twist, steps in legs:
        wheels = drive.wheels(twist)
        if wheels.steering != steering:  # it steers where it stands
            steering = wheels.steering
            step += 1
            yield step * STEP, Wheels(left, right, steering)
        assert drive.twist(wheels) == pytest.approx(twist), "no limit is in the way"
        begin = left, right
        for i in range(1, steps + 1):
            left, right = begin[0] + wheels.left * STEP * i, begin[1] + wheels.right * STEP * i
            step += 1
            yield step * STEP, Wheels(left, right, steering)


def followed(odometry: WheelOdometry, drive: Drive, legs: list[Leg]) -> WheelOdometry:
    for time, wheels in driven(drive, legs):
        assert odometry.take_positions([wheels.left], [wheels.right], time, steering=wheels.steering)
    return odometry


# -- where it leads ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize(
    ("name", "radius"), [("diff", 0.0), ("diff", 0.5), ("skid", 0.0), ("skid", 0.5), ("ackermann", 0.5)]
)
def test_a_square_closes(name: str, radius: float, left: bool) -> None:
    """4 sides of 10 m; a car takes the corners as arcs."""
    odometry = WheelOdometry(DRIVES[name])
    furthest = 0.0
    legs = legs_of_a_square(10.0, radius, left=left)
    for time, wheels in driven(DRIVES[name], legs):
        odometry.take_positions([wheels.left], [wheels.right], time, steering=wheels.steering)
        furthest = max(furthest, math.hypot(*odometry.pose[:2]))
    assert furthest == pytest.approx(math.hypot(10.0 + radius, 10.0 + 2 * radius), rel=0.02)
    assert math.hypot(odometry.pose.x, odometry.pose.y) < 1e-9
    assert abs(odometry.pose.yaw) < 1e-9
    assert odometry.left_out == 0


@pytest.mark.parametrize("name", DRIVES)
def test_by_velocities_it_closes_too(name: str) -> None:
    drive, odometry = DRIVES[name], WheelOdometry(DRIVES[name])
    steps = itertools.count()
    odometry.take_velocities([0.0], [0.0], 0.0)
    next(steps)
    for twist, count in legs_of_a_square(10.0, 0.5):
        wheels = drive.wheels(twist)
        for step in itertools.islice(steps, count):
            assert odometry.take_velocities([wheels.left], [wheels.right], step * STEP, steering=wheels.steering)
            assert odometry.twist == pytest.approx(twist, rel=1e-6)
    assert math.hypot(odometry.pose.x, odometry.pose.y) < 1e-9


@given(st.sampled_from(sorted(DRIVES)), st.integers(0, 2**32), st.integers(1, 5))
def test_it_is_where_its_body_is(name: str, seed: int, wheels_of_a_side: int) -> None:
    """Whatever is driven, from wherever."""
    drive, chance = DRIVES[name], random.Random(seed)
    pose = Pose2(chance.uniform(-9, 9), chance.uniform(-9, 9), chance.uniform(-3, 3))
    odometry = WheelOdometry(drive, pose=pose)
    turned, time, n = [0.0, 0.0], 0.0, wheels_of_a_side
    steering = 0.0
    odometry.take_positions(n * [0.0], n * [0.0], 0.0)
    for _ in range(50):
        wheels = drive.wheels(Twist2(chance.uniform(-1, 1), chance.uniform(-2, 2)), steering)
        if wheels.steering != steering:
            steering = wheels.steering
            odometry.take_positions(n * [turned[0]], n * [turned[1]], time, steering=steering)
        dt = chance.uniform(0.001, 0.1)
        pose = advance(pose, *drive.twist(wheels), dt)
        turned, time = [turned[0] + wheels.left * dt, turned[1] + wheels.right * dt], time + dt
        odometry.take_positions(n * [turned[0]], n * [turned[1]], time, steering=steering)
    assert odometry.pose[:2] == pytest.approx(pose[:2], abs=1e-9)
    assert math.remainder(odometry.pose.yaw - pose.yaw, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_the_wheels_of_a_side_count_with_their_mean() -> None:
    odometry = WheelOdometry(SKID)
    odometry.take_positions([1.0, 5.0], [0.0, 0.0, 0.0], 0.0)
    odometry.take_positions([1.9, 6.1], [1.0, 1.0, 1.0], 0.1)
    assert odometry.pose == pytest.approx((0.1, 0.0, 0.0))


def test_between_two_readings_the_mean_of_the_steering_counts() -> None:
    odometry = WheelOdometry(CAR)
    odometry.take_positions([0.0], [0.0], 0.0, steering=0.1)
    odometry.take_positions([1.0], [1.0], 0.1, steering=0.3)
    assert odometry.twist.angular == pytest.approx(0.5 * math.tan(0.2) / 0.32)


# -- what is not believed ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("wrap", [math.tau, 4.0, 65_536 * 0.001])
def test_positions_that_wrap_around_are_followed(name: str, wrap: float) -> None:
    drive = DRIVES[name]
    odometry = WheelOdometry(drive, wrap=wrap)
    for time, wheels in driven(drive, legs_of_a_square(10.0, 0.5)):
        at = [math.remainder(turned, wrap) for turned in wheels[:2]]
        assert odometry.take_positions([at[0]], [at[1]], time, steering=wheels.steering)
    assert math.hypot(odometry.pose.x, odometry.pose.y) < 1e-9


def test_encoders_that_begin_anew_move_nothing() -> None:
    odometry = WheelOdometry(DIFF)
    for i in range(51):
        odometry.take_positions([i / 5], [i / 5], i * STEP)
    before, sure = odometry.pose, odometry.covariance
    assert not odometry.take_positions([0.0], [0.0], 51 * STEP)
    assert odometry.pose == before
    assert odometry.left_out == 1
    assert odometry.covariance.xx >= sure.xx + 0.1**2, "it may have driven on, and somebody may have moved it"
    assert odometry.take_positions([0.2], [0.2], 52 * STEP)
    assert odometry.pose.x == pytest.approx(before.x + 0.01)


def test_told_that_they_begin_anew_it_takes_the_next_positions_as_the_first() -> None:
    odometry = WheelOdometry(DIFF)
    odometry.take_positions([5.0], [5.0], 0.0)
    odometry.take_positions([6.0], [6.0], 0.1)
    before = odometry.covariance
    odometry.begin_anew()
    assert odometry.take_positions([5.9], [5.9], 0.6)
    assert odometry.pose.x == pytest.approx(0.05)
    assert odometry.covariance.xx == pytest.approx(before.xx + 0.35**2), "0.5 s at 0.5 m/s, and a push, anywhere to"
    assert odometry.take_positions([6.9], [6.9], 0.7)
    assert odometry.pose.x == pytest.approx(0.1)
    assert odometry.left_out == 0


@pytest.mark.parametrize("speed", [0.0, 8.0])
@pytest.mark.parametrize("away", [1.0, 600.0, 1e9])
def test_however_long_nobody_counted_it_is_as_unsure_as_of_one_that_stopped_and_was_pushed(
    speed: float, away: float
) -> None:
    odometry = WheelOdometry(DIFF)
    for i in range(51):
        odometry.take_positions([speed * i * STEP], [speed * i * STEP], i * STEP)
        assert odometry.covariance.xx < 0.01
    odometry.begin_anew()
    odometry.take_positions([0.0], [0.0], away + 1.0)
    (xx, _, _), (_, yy, _), (_, _, tt) = odometry.covariance.matrix()
    for variance in (xx, yy):
        assert math.sqrt(variance) == pytest.approx(speed * 0.05 + 0.1, abs=0.02)
    assert math.sqrt(tt) == pytest.approx(0.1, abs=0.01)


def test_a_gap_hides_no_way_and_a_longer_one_lets_wheels_turn_further() -> None:
    odometry = WheelOdometry(DIFF)
    odometry.take_positions([0.0], [0.0], 0.0)
    assert odometry.take_positions([100.0], [100.0], 10.0)
    assert odometry.pose.x == pytest.approx(5.0)
    assert not odometry.take_positions([200.0], [200.0], 10.2), "100 rad in 0.2 s, at 30 rad/s"
    assert odometry.pose.x == pytest.approx(5.0)


@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf, 1e308, -1e308])
@pytest.mark.parametrize("drive", [DIFF, DiffDrive(wheel_separation=0.3, wheel_radius=0.05)])
def test_what_makes_no_sense_moves_nothing_and_is_counted(odd: float, drive: DiffDrive) -> None:
    odometry = WheelOdometry(drive)
    odometry.take_positions([0.0], [0.0], 0.0)
    odometry.take_positions([1.0], [1.0], 0.1)
    for reading in (([odd], [1.0], 0.2), ([1.0], [odd], 0.2), ([1.0, odd], [1.0], 0.2)):
        odometry.take_positions(*reading)
    assert not odometry.take_positions([], [1.0], 0.2)
    assert not odometry.take_velocities([odd], [1.0], 0.3)
    assert odometry.left_out >= 5
    assert math.hypot(*odometry.pose[:2]) < 1.0
    assert all(map(math.isfinite, (*odometry.pose, *odometry.covariance, *odometry.twist)))
    if not math.isfinite(odd):
        assert not odometry.take_positions([1.0], [1.0], odd)
        assert not odometry.take_positions([1.0], [1.0], 0.3, steering=odd)
        assert odometry.take_positions([2.0], [2.0], 0.4), "what was driven meanwhile is in the next one"
        assert odometry.pose.x == pytest.approx(0.1)


def test_time_that_stands_or_steps_back_loses_no_way_and_makes_no_velocity() -> None:
    odometry = WheelOdometry(DIFF)
    odometry.take_positions([0.0], [0.0], 5.0)
    odometry.take_positions([1.0], [1.0], 5.1)
    odometry.take_positions([1.5], [1.5], 5.1)
    odometry.take_positions([2.0], [2.0], 3.0)
    assert odometry.pose.x == pytest.approx(0.1)
    assert odometry.twist.linear == pytest.approx(0.5)
    odometry.take_velocities([1.0], [1.0], 2.0)
    assert odometry.pose.x == pytest.approx(0.1)


def test_of_a_long_silence_velocities_say_nothing() -> None:
    odometry = WheelOdometry(DIFF)
    odometry.take_velocities([10.0], [10.0], 0.0)
    odometry.take_velocities([10.0], [10.0], 0.1)
    before = odometry.covariance
    assert not odometry.take_velocities([10.0], [10.0], 3.1)
    assert odometry.pose.x == pytest.approx(0.05)
    assert odometry.covariance.xx == pytest.approx(before.xx + 0.6**2), "1 s at 0.5 m/s, and a push, anywhere to"
    assert not odometry.take_velocities([99.0], [10.0], 3.2), "no wheel is so fast"


@given(st.lists(st.tuples(*3 * [st.floats(allow_nan=True, allow_infinity=True)]), max_size=20), st.booleans())
def test_nothing_that_comes_breaks_it(readings: list[tuple[float, float, float]], limited: bool) -> None:
    drive = DIFF if limited else DiffDrive(wheel_separation=0.3, wheel_radius=0.05)
    odometry = WheelOdometry(drive, wrap=math.tau if limited else 0.0)
    for left, right, time in readings:
        odometry.take_positions([left], [right], time)
        odometry.take_velocities([left], [right], time)
    assert all(map(math.isfinite, (*odometry.pose, *odometry.covariance, *odometry.twist)))


def test_encoders_say_what_they_have_left_out() -> None:
    encoders = Encoders(wrap=math.tau, max_velocity=10.0)
    assert encoders.turned([3.0, 0.0], 0.0) is None, "the first reading"
    assert encoders.turned([-3.0, 0.1], 0.1) == pytest.approx([math.tau - 6.0, 0.1])
    assert encoders.turned([math.nan, 0.1], 0.1) is None
    assert encoders.turned([0.0, 0.1], 0.1) is None, "3 rad in 0.1 s"
    assert encoders.turned([0.1, 0.1], 0.1) == pytest.approx([0.1, 0.0])
    assert encoders.turned([0.1], 0.1) is None, "another number of wheels"
    assert (encoders.refused, encoders.resets) == (1, 1)


# -- how sure it is ----------------------------------------------------------------------------------------------------

Matrix3 = tuple[tuple[float, ...], ...]


def determinant(m: Matrix3) -> float:
    return sum(
        m[0][i] * (m[1][(i + 1) % 3] * m[2][(i + 2) % 3] - m[1][(i + 2) % 3] * m[2][(i + 1) % 3]) for i in range(3)
    )


def is_positive(covariance: PoseCovariance) -> bool:
    """Whether no direction has a negative variance, but for the rounding of the last digit."""
    m = covariance.matrix()
    assert all(m[i][j] == m[j][i] for i in range(3) for j in range(3)), "it is symmetric to the last digit"
    scale = [math.sqrt(m[i][i]) or 1.0 for i in range(3)]
    unit = tuple(tuple(m[i][j] / scale[i] / scale[j] for j in range(3)) for i in range(3))  # correlations
    minors = [unit[i][i] * unit[j][j] - unit[i][j] ** 2 for i, j in ((0, 1), (0, 2), (1, 2))]
    return min(unit[i][i] for i in range(3)) >= 0 and min(minors) >= -1e-12 and determinant(unit) >= -1e-12


def volume(covariance: PoseCovariance) -> float:
    """The determinant, without the cancellation."""
    return covariance.heading * (covariance.xx * covariance.yy - covariance.xy**2)


def trace(covariance: PoseCovariance) -> float:
    m = covariance.matrix()
    return m[0][0] + m[1][1] + m[2][2]


steps = st.lists(st.tuples(st.floats(-2, 2), st.floats(-1.5, 1.5)), min_size=1, max_size=60)
noises = st.builds(Noise, *4 * [st.floats(0, 0.5)])


@given(steps, noises)
def test_it_stays_positive_and_symmetric_and_its_volume_never_shrinks(
    ways: list[tuple[float, float]], noise: Noise
) -> None:
    covariance, pose = PoseCovariance(), Pose2()
    for distance, turn in ways:
        grown = covariance.after(distance, turn, pose.yaw, noise)
        assert is_positive(grown)
        assert grown.heading >= covariance.heading
        assert grown.xx >= covariance.xx
        assert grown.yy >= covariance.yy
        assert volume(grown) >= volume(covariance) * (1 - 1e-9)
        covariance, pose = grown, advance(pose, distance, turn, 1.0)


@given(st.lists(st.floats(0.001, 2.0), min_size=1, max_size=60), st.floats(-3, 3), noises)
def test_its_trace_grows_with_the_distance(ways: list[float], yaw: float, noise: Noise) -> None:
    covariance = PoseCovariance()
    for distance in ways:
        grown = covariance.after(distance, 0.0, yaw, noise)
        assert trace(grown) > trace(covariance)
        covariance = grown


@given(st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=60), noises)
def test_its_trace_grows_with_turns_on_the_spot(turns: list[float], noise: Noise) -> None:
    covariance = PoseCovariance()
    for turn in turns:
        grown = covariance.after(0.0, turn, 0.0, noise)
        assert trace(grown) >= trace(covariance)
        covariance = grown


def test_standing_adds_nothing() -> None:
    covariance = PoseCovariance().after(3.0, 1.0, 0.0, Noise())
    assert covariance.after(0.0, 0.0, 0.3, Noise()) is covariance


def test_a_straight_line_as_one_works_it_out_by_hand() -> None:
    """Of a random walk of the heading, with q rad² for each metre, y has a variance of q d³ / 3."""
    noise = Noise(turn_by_turn=0.0, turn_by_way=0.1, way_by_way=0.2, way_by_turn=0.0)
    for parts in (1, 2, 100):
        covariance = PoseCovariance(0.0, 0.0, 0.0, 0.0)
        for _ in range(parts):
            covariance = covariance.after(9.0 / parts, 0.0, 0.0, noise)
        (xx, xy, xt), (_, yy, yt), (_, _, tt) = covariance.matrix()
        assert (xx, yy, tt) == pytest.approx((0.04 * 9, 0.01 * 9**3 / 3, 0.01 * 9))
        assert (xy, xt, yt) == pytest.approx((0.0, 0.0, 0.01 * 9**2 / 2))


@given(st.floats(-3, 3), st.floats(-1, 1), st.integers(2, 20), noises)
def test_it_does_not_depend_on_how_often_odometry_is_told(
    distance: float, turn: float, parts: int, noise: Noise
) -> None:
    once = PoseCovariance().after(distance, turn, 0.3, noise)
    many, pose = PoseCovariance(), Pose2(yaw=0.3)
    for _ in range(parts):
        many = many.after(distance / parts, turn / parts, pose.yaw, noise)
        pose = advance(pose, distance / parts, turn / parts, 1.0)
    for row, other in zip(once.matrix(), many.matrix(), strict=True):
        assert row == pytest.approx(other, rel=1e-3, abs=1e-4 * trace(once))


def test_it_is_what_a_thousand_robots_do() -> None:
    """Each with errors of its own, along a square with round corners: their scatter is the covariance."""
    chance, noise = random.Random(1), Noise(0.03, 0.01, 0.02, 0.005)
    legs = [(twist, 10) for twist, _ in legs_of_a_square(5.0, 0.5)]
    ways = [(twist, seconds) for twist, seconds in zip((t for t, _ in legs), 4 * [10.0, math.pi / 2], strict=True)]
    covariance, mean = PoseCovariance(0.0, 0.0, 0.0, 0.0), Pose2()
    robots = 1000 * [Pose2()]
    for twist, seconds in ways[:5]:
        for _ in range(20):
            distance, turn = twist.linear * seconds / 20, twist.angular * seconds / 20
            covariance = covariance.after(distance, turn, mean.yaw, noise)
            mean = advance(mean, distance, turn, 1.0)
            way, heading = (math.sqrt(v) for v in noise.variances(distance, turn))
            robots = [
                advance(pose, distance + chance.gauss(0.0, way), turn + chance.gauss(0.0, heading), 1.0)
                for pose in robots
            ]
    off = [(pose.x - mean.x, pose.y - mean.y, math.remainder(pose.yaw - mean.yaw, math.tau)) for pose in robots]
    m = covariance.matrix()
    for i, j in itertools.product(range(3), repeat=2):
        scatter = sum(one[i] * one[j] for one in off) / len(off)
        assert scatter == pytest.approx(m[i][j], abs=0.1 * math.sqrt(m[i][i] * m[j][j]))


def test_after_many_steps_it_is_as_sound_as_after_one() -> None:
    """Far away, and turned often."""
    covariance, pose = PoseCovariance(), Pose2()
    for step in range(20_000):
        distance, turn = (0.5, 0.0) if step % 1000 < 900 else (-0.1, 0.01)
        covariance = covariance.after(distance, turn, pose.yaw, Noise())
        pose = advance(pose, distance, turn, 1.0)
    assert is_positive(covariance)
    assert covariance.heading == pytest.approx(1e-6 + 18_000 * 0.5 * 0.02**2 + 2_000 * (0.01 * 0.05**2 + 0.1 * 0.02**2))


def test_who_comes_back_the_way_he_came_is_surer_of_where_he_is() -> None:
    """Not of his heading: so the trace of a covariance may shrink, which is right."""
    noise = Noise(turn_by_turn=0.0, turn_by_way=1e-6, way_by_way=1e-6)
    unsure = PoseCovariance(heading=0.01)
    away = unsure.after(10.0, 0.0, 0.0, noise)
    back = away.after(-10.0, 0.0, 0.0, noise)
    assert away.matrix()[1][1] == pytest.approx(1.0, rel=1e-3)
    assert back.matrix()[1][1] == pytest.approx(1e-6, rel=1e-2)


def test_velocities_that_are_added_up_are_as_unsure_as_the_pose() -> None:
    odometry = followed(WheelOdometry(DIFF), DIFF, [(Twist2(0.5), 500)])
    message = odometry.message(Header(), "base_link")
    along, around = message.twist.covariance[0], message.twist.covariance[35]
    assert 500 * along * STEP**2 == pytest.approx(odometry.covariance.xx, rel=0.01)
    assert 500 * around * STEP**2 == pytest.approx(odometry.covariance.heading, rel=0.01)


def test_the_message_is_that_of_a_planar_base() -> None:
    odometry = followed(WheelOdometry(DIFF, pose=Pose2(1.0, 2.0, math.pi / 2)), DIFF, [(Twist2(0.5, 0.2), 50)])
    message = odometry.message(Header(frame_id="odom"), "base_link")
    assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
    assert message.pose.pose.position.y == odometry.pose.y
    assert message.twist.twist.linear.x == pytest.approx(0.5)
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = odometry.covariance.matrix()
    table = [message.pose.covariance[6 * i : 6 * i + 6] for i in range(6)]
    assert [table[i][j] for i in (0, 1, 5) for j in (0, 1, 5)] == [xx, xy, xt, xy, yy, yt, xt, yt, tt]
    assert [table[i][i] for i in (2, 3, 4)] == 3 * [NOT_MEASURED]
    assert all(table[i][j] == table[j][i] for i in range(6) for j in range(6))
