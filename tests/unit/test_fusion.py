"""Wheels that err, a gyro that is noisy and biased, and the filter: fused, the base is nearer to the truth."""

import math
import random
import statistics
from typing import NamedTuple

import pytest

from robo_messages import (
    Header,
    Imu,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    Twist,
    TwistWithCovariance,
    TwistWithCovarianceStamped,
    Vector3,
)
from robo_services.drives import Ackermann, DiffDrive
from robo_services.ekf import AX, VX, YAW, Unusable, begin
from robo_services.ekf_history import Ekf
from robo_services.ekf_messages import odometry_of, placed
from robo_services.ekf_parameters import INITIAL, PROCESS_NOISE, SourceParameters, diagonal
from robo_services.ekf_sources import DEVIATIONS, GRAVITY, Reader, RestBias
from robo_services.factors import Factors
from robo_services.kinematics import ORIGIN, Pose2, advance
from robo_services.limits import ramp
from robo_services.planar import angle_difference, quaternion_from_yaw, yaw_from_quaternion
from robo_services.simulated_errors import ErringWheels, ImuNoise, SimulatedImu, WheelErrors
from robo_services.uncertainty import NOT_MEASURED
from tests.unit.test_factors import is_covariance

DRIVE = DiffDrive(wheel_separation=0.3, wheel_radius=0.05)
ERRORS = {
    "slip": WheelErrors(slip=0.03),
    "radius": WheelErrors(left_wheel_radius=0.01, right_wheel_radius=-0.01),
    "all": WheelErrors(left_wheel_radius=0.005, right_wheel_radius=-0.005, wheel_separation=0.03, slip=0.02),
}


class Ends(NamedTuple):
    """How far away from the truth each ends, m."""

    wheels: float
    fused: float
    heading: float
    """Of the fused one, rad."""
    bias: float
    """As found, rad/s."""
    said: float
    """How far away the filter takes its heading to be, rad: one standard deviation."""
    squared: float
    """How far away from the truth the fused pose is in its own measure, squared."""


def trial(errors: WheelErrors, seed: int, *, noise: ImuNoise, use: str = "vyaw", laps: int = 10) -> Ends:
    """Drive about at random for `laps` × 3 s after 3 s at rest: odometry at 50 Hz, an IMU at 100 Hz."""
    rng = random.Random(seed)
    wheels, imu = ErringWheels(DRIVE, errors, ORIGIN, seed), SimulatedImu(noise, seed)
    by_wheels = Reader("wheels", SourceParameters(topic="odom", use=["vx", "vyaw"]), holonomic=False)
    if use == "all":
        said = SourceParameters(topic="imu", type="imu", use=["vyaw", "ax", "ay"])
    else:
        said = SourceParameters(topic="imu", type="imu", use=["vyaw"])
    by_imu = Reader("imu", said, holonomic=False)
    ekf = Ekf(begin(INITIAL if use == "all" else INITIAL[:AX]), PROCESS_NOISE)
    truth, linear, angular, dt = ORIGIN, 0.0, 0.0, 0.01
    wanted = (0.0, 0.0)
    for step in range(1, 300 * (laps + 1) + 1):
        if step % 300 == 0:
            wanted = rng.uniform(0.0, 1.0), rng.uniform(-1.0, 1.0)
        linear, angular = ramp(linear, wanted[0], dt, 1.0, 1.0), ramp(angular, wanted[1], dt, 3.0, 3.0)
        truth = advance(truth, linear, angular, dt)
        wheels.step(linear * dt, angular * dt, dt)
        header = Header()
        ekf.take(by_imu.imu(imu.message(header, linear, angular * dt, dt), step * dt))
        if step % 2 == 0:
            odometry = wheels.message(header, "base_link")
            by_imu.bias.wheels(odometry.twist.twist.linear.x, odometry.twist.twist.angular.z, step * dt)
            ekf.take(by_wheels.odometry(odometry, step * dt))
    told = wheels.message(Header(), "base_link").pose.pose
    x, y, yaw = ekf.now.mean[:VX]
    errors_of_pose = Factors.of([row[:VX] for row in ekf.now.covariance()[:VX]])
    apart = errors_of_pose.correlate([[truth.x - x], [truth.y - y], [angle_difference(truth.yaw, yaw)]])
    return Ends(
        math.hypot(told.position.x - truth.x, told.position.y - truth.y),
        math.hypot(x - truth.x, y - truth.y),
        abs(angle_difference(yaw, truth.yaw)),
        by_imu.bias.bias,
        math.sqrt(ekf.now.variance(YAW)),
        sum(gap[0] ** 2 / variance for gap, variance in zip(apart, errors_of_pose.d, strict=True)),
    )


@pytest.mark.parametrize("kind", ERRORS)
def test_fused_it_is_nearer_to_the_truth(kind: str) -> None:
    """In most of four runs of half a minute, and by a factor in the mean."""
    noise = ImuNoise(gyro=0.01, gyro_bias=0.02)
    runs = [trial(ERRORS[kind], seed, noise=noise) for seed in range(4)]
    wheels, fused = (statistics.fmean(run[i] for run in runs) for i in (0, 1))
    assert sum(run.fused < run.wheels for run in runs) >= 3, runs
    assert fused < 0.5 * wheels, (wheels, fused)


def test_its_errors_are_as_large_as_it_says() -> None:
    """Wheels that slip and a gyro whose bias is found in 3 s, over 20 runs of a quarter of a minute.

    The mean of χ² with three degrees of freedom is 3, that of 20 runs 3 ± 0.55 (Bar-Shalom et al. 2001, §5.4). What
    remains of the bias is the same all the time: were it taken for noise, the heading would err three times as much as
    is said, and by more the longer it drives.
    """
    noise = ImuNoise(gyro=0.01, gyro_bias=0.02)
    runs = [trial(WheelErrors(slip=0.02), seed, noise=noise, laps=4) for seed in range(20)]
    assert 1.5 < statistics.fmean(run.squared for run in runs) < 4.5
    errors = math.sqrt(statistics.fmean(run.heading**2 for run in runs))
    assert 0.6 < errors / statistics.fmean(run.said for run in runs) < 1.4


def test_a_bias_is_found_at_rest_and_costs_little() -> None:
    run = trial(WheelErrors(), 1, noise=ImuNoise(gyro=0.01, gyro_bias=0.03))
    assert run.bias == pytest.approx(0.03, abs=0.002)
    assert run.heading < 0.05, "without that it were 0.9 rad after half a minute"


def test_without_errors_it_is_as_good_as_the_wheels() -> None:
    run = trial(WheelErrors(), 1, noise=ImuNoise(gyro=0.001), use="all")
    assert run.wheels < 1e-9
    assert run.fused < 0.15
    assert run.heading < 0.01


# -- wheels that err, and an IMU ---------------------------------------------------------------------------------------


def test_wheels_that_are_larger_drive_further_than_they_say() -> None:
    wheels = ErringWheels(DRIVE, WheelErrors(left_wheel_radius=0.25, right_wheel_radius=0.25), ORIGIN, 0)
    for _ in range(100):
        wheels.step(0.05, 0.0, 0.02)
    assert wheels.message(Header(), "b").pose.pose.position.x == pytest.approx(4.0)
    assert wheels.wheels[:2] == pytest.approx((80.0, 80.0))


def test_wheels_that_are_further_apart_turn_less_than_they_say() -> None:
    wheels = ErringWheels(DRIVE, WheelErrors(wheel_separation=0.1), Pose2(1.0, 2.0, 0.5), 0)
    wheels.step(0.0, 1.0, 0.02)
    said = wheels.message(Header(), "b").pose.pose
    assert (said.position.x, said.position.y) == pytest.approx((1.0, 2.0))
    assert yaw_from_quaternion(said.orientation) == pytest.approx(1.6)


def test_slip_is_as_large_after_a_metre_whatever_the_steps() -> None:
    for steps in (5, 100):
        ends = []
        for seed in range(300):
            wheels = ErringWheels(DRIVE, WheelErrors(slip=0.02), ORIGIN, seed)
            for _ in range(steps):
                wheels.step(1.0 / steps, 0.0, 0.02)
            ends.append(wheels.wheels.left * DRIVE.wheel_radius - 1.0)
        assert statistics.pstdev(ends) == pytest.approx(0.02, rel=0.15)
        assert statistics.fmean(ends) == pytest.approx(0.0, abs=0.004)


def test_it_is_the_same_for_the_same_seed_and_no_errors_are_false() -> None:
    ends = []
    for seed in (1, 1, 2):
        wheels = ErringWheels(DRIVE, WheelErrors(slip=0.02), ORIGIN, seed)
        wheels.step(1.0, 0.1, 0.02)
        ends.append(wheels.wheels)
    assert ends[0] == ends[1] != ends[2]
    assert not WheelErrors()
    car = Ackermann(wheelbase=0.3, wheel_separation=0.2, wheel_radius=0.05, max_steering_angle=0.5)
    with pytest.raises(ValueError, match="not of ackermann"):
        ErringWheels(car, WheelErrors(slip=0.1), ORIGIN, 0)


def test_an_imu_feels_acceleration_the_curve_and_gravity() -> None:
    imu = SimulatedImu(ImuNoise(gyro=0.0, acceleration=0.0, gyro_bias=0.01), 0)
    said = imu.message(Header(), 0.5, 0.02, 0.1)
    assert said.angular_velocity.z == pytest.approx(0.21)
    felt = said.linear_acceleration
    assert (felt.x, felt.y, felt.z) == pytest.approx((5.0, 0.1, GRAVITY))
    assert said.orientation_covariance[0] == -1.0
    assert any(said.angular_velocity_covariance), "zeros would say that it is not known"


# -- what messages say -------------------------------------------------------------------------------------------------


def reader(kind: str = "odometry", *use: str, **said: object) -> Reader:
    parameters = {"topic": "t", "type": kind, "use": list(use) or ["vx", "vyaw"], **said}
    return Reader("s", SourceParameters(**parameters), holonomic=False)  # type: ignore[arg-type]


def odometry(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, *, sure: bool = True) -> Odometry:
    diagonal = tuple((0.01 if sure else 0.0) if i % 7 == 0 else 0.0 for i in range(36))
    pose = Pose(Point(x, y), quaternion_from_yaw(yaw))
    twist = Twist(Vector3(0.5, 0.1), Vector3(z=0.2))
    return Odometry(Header(), "base_link", PoseWithCovariance(pose, diagonal), TwistWithCovariance(twist, diagonal))


def imu(rate: float = 0.2, *, orientation: Quaternion | None = None) -> Imu:
    return Imu(
        orientation=orientation or Quaternion(),
        orientation_covariance=(-1.0 if orientation is None else 0.01, *(0.0,) * 3, 0.01, *(0.0,) * 3, 0.01),
        angular_velocity=Vector3(z=rate),
        linear_acceleration=Vector3(1.0, 2.0, GRAVITY),
    )


def test_a_base_that_cannot_drive_sideways_is_said_not_to() -> None:
    forward, sideways = reader().odometry(odometry(), 1.0)
    assert (forward.indices, forward.values) == ((3, 5), (0.5, 0.2))
    assert (sideways.indices, sideways.values) == ((4,), (0.0,))
    (both,) = reader("odometry", "vx", "vy").odometry(odometry(), 1.0)
    assert both.values == (0.5, 0.1)
    (free,) = Reader("s", SourceParameters(topic="t", use=["vx"]), holonomic=True).odometry(odometry(), 1.0)
    assert free.indices == (3,)


def test_of_a_covariance_of_zeros_errors_are_guessed() -> None:
    forward = reader().odometry(odometry(sure=False), 1.0)[0]
    assert [forward.covariance[k][k] for k in (0, 1)] == pytest.approx([DEVIATIONS[3] ** 2, DEVIATIONS[5] ** 2])


def test_what_is_not_measured_is_left_out() -> None:
    said = odometry()
    numbers = list(said.twist.covariance)
    numbers[0] = NOT_MEASURED
    said.twist.covariance = tuple(numbers)
    (turning,) = reader().odometry(said, 1.0)
    assert turning.indices == (5,)
    assert reader("imu", "yaw").imu(imu(), 1.0) == []
    silent = imu()
    silent.angular_velocity_covariance = silent.linear_acceleration_covariance = (-1.0, *(0.0,) * 8)
    assert reader("imu", "vyaw", "ax").imu(silent, 1.0) == []


def test_relative_poses_count_from_the_first() -> None:
    one = reader("odometry", "x", "y", "yaw", relative=True)
    assert one.odometry(odometry(5.0, 5.0, 1.0), 0.0)[0].values == pytest.approx((0.0, 0.0, 0.0))
    ahead = one.odometry(odometry(5.0 + math.cos(1.0), 5.0 + math.sin(1.0), 1.5), 0.1)[0]
    assert ahead.values == pytest.approx((1.0, 0.0, 0.5))
    one.begin_anew()
    assert one.odometry(odometry(5.0, 5.0, 1.0), 0.0)[0].values == pytest.approx((0.0, 0.0, 0.0))
    one.begin_anew(Pose2(2.0, 1.0, math.pi / 2))
    assert one.odometry(odometry(5.0, 5.0, 1.0), 0.0)[0].values == pytest.approx((2.0, 1.0, math.pi / 2))
    ahead = one.odometry(odometry(5.0 + math.cos(1.0), 5.0 + math.sin(1.0), 1.5), 0.1)[0]
    assert ahead.values == pytest.approx((2.0, 2.0, math.pi / 2 + 0.5))
    compass = reader("imu", "yaw", relative=True)
    compass.begin_anew(Pose2(yaw=3.0))
    for yaw, wanted in ((1.0, 3.0), (1.5, 3.5 - math.tau)):
        assert compass.imu(imu(orientation=quaternion_from_yaw(yaw)), 0.0)[0].values == pytest.approx((wanted,))


def test_of_differential_poses_the_velocities_between_them_count() -> None:
    one = reader("pose", "x", "y", "yaw", differential=True)
    assert one.pose(odometry(2.0, 1.0, 0.5).pose, 0.0) == []
    there = advance(Pose2(2.0, 1.0, 0.5), 0.4, 1.2, 0.1)
    (between,) = one.pose(odometry(*there).pose, 0.1)
    assert between.indices == (3, 4, 5)
    assert between.values == pytest.approx((0.4, 0.0, 1.2))
    assert one.pose(odometry(*there).pose, 5.0) == [], "after a gap nobody knows how it went"


def posed(x: float, *variances: float, yaw: float = 0.0) -> PoseWithCovariance:
    """A pose with the variances of x, y and yaw."""
    numbers = [0.0] * 36
    numbers[0], numbers[7], numbers[35] = variances
    return PoseWithCovariance(Pose(Point(x), quaternion_from_yaw(yaw)), tuple(numbers))


def test_differential_velocities_err_as_both_poses_do() -> None:
    one = reader("pose", "x", "y", "yaw", differential=True)
    one.pose(posed(0.0, 0.01, 0.04, 0.09, yaw=math.pi / 2), 0.0)
    (between,) = one.pose(posed(0.0, 0.02, 0.04, 0.01, yaw=math.pi / 2), 0.5)
    found = [between.covariance[k][k] for k in range(3)]
    assert found == pytest.approx([0.08 / 0.25, 0.03 / 0.25, 0.1 / 0.25]), "ahead is along y"
    one.pose(posed(0.0, 0.0, 0.0, 0.0), 1.0)
    (between,) = one.pose(posed(0.0, 0.0, 0.0, 0.0), 1.5)
    assert [between.covariance[k][k] for k in range(3)] == pytest.approx([one**2 for one in DEVIATIONS[3:6]])


def test_of_differential_poses_that_are_not_measured_there_are_no_velocities() -> None:
    one = reader("pose", "x", "y", "yaw", differential=True)
    one.pose(posed(0.0, 0.01, 0.01, 0.01), 0.0)
    assert one.pose(posed(0.5, 1e9, 1e9, 1e9), 0.1) == []
    assert one.pose(posed(0.5, 0.01, 0.01, 0.01), 0.2) == [], "the one before was not"
    (turning,) = one.pose(posed(0.5, 1e9, 0.01, 0.01, yaw=0.1), 0.3)
    assert turning.indices == (5,)
    assert turning.values == pytest.approx((1.0,))
    headless = reader("pose", "x", "y", differential=True)
    headless.pose(posed(0.0, 0.01, 0.01, 1e9), 0.0)
    assert headless.pose(posed(0.5, 0.01, 0.01, 1e9), 0.1) == [], "nobody knows where ahead is"


def test_an_imu_may_be_mounted_upside_down_and_turned() -> None:
    (turning,) = reader("imu", "vyaw", roll=math.pi, rest_bias=0.0).imu(imu(0.2), 1.0)
    assert turning.values == pytest.approx((-0.2,))
    (felt,) = reader("imu", "ax", "ay", yaw=math.pi / 2).imu(imu(), 1.0)
    assert felt.values == pytest.approx((-2.0, 1.0))
    stands = quaternion_from_yaw(1.0 + math.pi / 2)
    (heading,) = reader("imu", "yaw", yaw=math.pi / 2).imu(imu(orientation=stands), 1.0)
    assert heading.values == pytest.approx((1.0,))


def test_gravity_is_told_apart_by_the_orientation() -> None:
    """An IMU that stands at 0.1 rad, nose down, and does not move, feels a part of gravity ahead."""
    stands = Quaternion(y=math.sin(0.05), w=math.cos(0.05))
    said = imu(orientation=stands)
    said.linear_acceleration = Vector3(-GRAVITY * math.sin(0.1), 0.0, GRAVITY * math.cos(0.1))
    (felt,) = reader("imu", "ax", "ay", remove_gravitational_acceleration=True).imu(said, 1.0)
    assert felt.values == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e300])
def test_what_is_not_finite_is_refused(bad: float) -> None:
    for one, message in (
        (reader("imu", "vyaw", "ax"), imu(bad)),
        (reader("imu", "yaw"), imu(orientation=Quaternion(bad, bad, bad, bad))),
        (reader("imu", "yaw"), imu(orientation=Quaternion(0.0, 0.0, 0.0, 0.0))),
    ):
        ekf = Ekf(begin(INITIAL), PROCESS_NOISE)
        try:
            ekf.take(one.imu(message, 1.0))
        except Unusable:
            continue
        assert ekf.refused["s"] == 1
    ekf = Ekf(begin(INITIAL), PROCESS_NOISE)
    try:
        ekf.take(reader("odometry", "x", "y").odometry(odometry(bad), 1.0))
    except Unusable:
        return
    assert ekf.refused["s"] == 1


def test_a_gyro_that_turns_while_the_wheels_stand_is_not_believed_to_be_biased() -> None:
    bias = RestBias()
    for step in range(100):
        bias.wheels(0.0, 0.0, step * 0.02)
        bias.without(0.5, step * 0.02, 0.05)
    assert (bias.bias, bias.excess) == (0.0, 0.5)
    for step in range(100, 200):
        bias.wheels(0.0, 0.0, step * 0.02)
        bias.without(0.03, step * 0.02, 0.05)
    assert (bias.bias, bias.excess) == pytest.approx((0.03, 0.0))
    assert bias.without(0.03, 10.0, 0.05)[0] == pytest.approx(0.0)
    assert bias.without(0.03, 10.0, 0.0) == (0.03, 0.0), "it is not asked for"
    assert bias.without(0.03, 10.0, 0.01)[0] == pytest.approx(0.02), "no bias is larger, though one was found"
    bias.wheels(0.5, 0.0, 10.02)
    for step in range(100):
        bias.without(0.05, 10.04 + step * 0.02, 0.05)
    assert bias.bias == pytest.approx(0.03), "the wheels turn"


def test_a_bias_is_as_sure_as_a_mean_of_so_many_readings() -> None:
    rng, bias = random.Random(1), RestBias()
    assert bias.without(0.0, 0.0, 0.06)[1] == pytest.approx(0.06 / math.sqrt(3)), "anywhere between"
    for step in range(150):
        bias.wheels(0.0, 0.0, step * 0.02)
        sure = bias.without(rng.gauss(0.02, 0.01), step * 0.02, 0.06)[1]
    assert sure == 0.0, "while it stands it goes on finding it"
    bias.wheels(0.5, 0.0, 3.0)
    assert bias.without(0.0, 3.01, 0.06)[1] == pytest.approx(0.01 / math.sqrt(124), rel=0.2)


def wheels(vx: float, vy: float, vyaw: float, **covariance: float) -> Odometry:
    numbers = [0.0] * 36
    for name, value in covariance.items():
        numbers[{"x": 0, "y": 7, "yaw": 35}[name]] = value
    twist = TwistWithCovariance(Twist(Vector3(vx, vy), Vector3(z=vyaw)), tuple(numbers))
    return Odometry(Header(), "base_link", twist=twist)


def test_only_who_knows_of_wheels_says_whether_they_stand() -> None:
    assert reader("odometry", "vx").motion(wheels(0.3, 0.4, 0.1)) == pytest.approx((0.5, 0.1))
    said = TwistWithCovarianceStamped(Header(), wheels(0.0, 0.0, 0.0).twist)
    assert reader("twist", "vx").motion(said) == (0.0, 0.0)
    assert reader("odometry", "x", "y").motion(wheels(0.0, 0.0, 0.0)) is None, "a camera's zeros are no wheels"
    assert reader("odometry", "x", "vx", differential=True).motion(wheels(0.0, 0.0, 0.0)) is None
    assert reader("odometry", "vx").motion(wheels(0.0, 0.0, 0.0, x=0.01, yaw=NOT_MEASURED)) is None
    assert reader("imu", "vyaw").motion(imu()) is None


READERS = [
    reader("odometry", "x", "y", "yaw", "vx", "vyaw"),
    reader("odometry", "x", "y", "yaw", "vx", relative=True),
    reader("odometry", "x", "yaw", differential=True),
    reader("imu", "yaw", "vyaw", "ax", "ay", roll=0.3, remove_gravitational_acceleration=True),
    reader("imu", "yaw", "ax", differential=True),
]
ODD = (0.0, -1.0, 1e-300, 1e6, 1e7, 1e308, math.nan, math.inf, -math.inf)


class Nonsense:
    """Messages of numbers, of which one in so many is odd."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._odd = self._random.choice([0.0, 0.01, 0.1, 0.5])

    def number(self) -> float:
        return self._random.choice(ODD) if self._random.random() < self._odd else self._random.uniform(-2, 2)

    def vector(self) -> Vector3:
        return Vector3(self.number(), self.number(), self.number())

    def turn(self) -> Quaternion:
        return Quaternion(self.number(), self.number(), self.number(), self.number())

    def numbers(self, size: int) -> tuple[float, ...]:
        """A covariance, mostly of errors that are independent."""
        diagonal = [abs(self.number()) if i % (size + 1) == 0 else 0.0 for i in range(size * size)]
        return tuple(diagonal if self._random.random() < 0.7 else (self.number() for _ in diagonal))

    def odometry(self) -> Odometry:
        pose = Pose(Point(self.number(), self.number()), self.turn())
        twist = Twist(self.vector(), self.vector())
        return Odometry(
            Header(), "", PoseWithCovariance(pose, self.numbers(6)), TwistWithCovariance(twist, self.numbers(6))
        )

    def imu(self) -> Imu:
        return Imu(
            Header(), self.turn(), self.numbers(3), self.vector(), self.numbers(3), self.vector(), self.numbers(3)
        )

    def run(self) -> int:
        """Feed a filter with it; how much was taken."""
        ekf, time, taken = Ekf(begin(INITIAL), PROCESS_NOISE), 0.0, 0
        for one in READERS:
            one.begin_anew()
        for _ in range(12):
            time += self._random.uniform(-0.1, 0.5)
            one, said = self._random.choice(READERS), self.odometry()
            try:
                found = one.imu(self.imu(), time) if one.said.type == "imu" else one.odometry(said, time)
            except Unusable:
                continue
            one.bias.wheels(said.twist.twist.linear.x, said.twist.twist.angular.z, time)
            ekf.take(found)
            taken += len(found)
            assert all(map(math.isfinite, ekf.now.mean))
            assert is_covariance(ekf.now.factors.matrix())
            assert math.isfinite(one.bias.bias)
        return taken


def test_whatever_messages_hold_the_filter_stays_one() -> None:
    assert sum(Nonsense(seed).run() for seed in range(300)) > 1000


# -- what is known as a message, and parameters ------------------------------------------------------------------------


def test_what_is_known_is_told_with_how_sure_it_is() -> None:
    known = begin(INITIAL)._replace(mean=(1.0, 2.0, 0.5, 0.3, 0.0, 0.1, 0.0, 0.0))
    said = odometry_of(known, Header(frame_id="odom"), "base_link")
    assert (said.pose.pose.position.x, said.twist.twist.angular.z) == (1.0, 0.1)
    assert yaw_from_quaternion(said.pose.pose.orientation) == pytest.approx(0.5)
    assert [said.pose.covariance[7 * i] for i in range(6)] == [1e-6, 1e-6, *3 * [NOT_MEASURED], 1e-6]
    assert placed(known, said.pose, INITIAL[VX:]).mean == pytest.approx((1.0, 2.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("numbers", [(math.nan,) * 36, (-1.0,) * 36])
def test_a_pose_whose_covariance_is_none_is_refused(numbers: tuple[float, ...]) -> None:
    with pytest.raises(Unusable):
        placed(begin(INITIAL), PoseWithCovariance(Pose(), numbers), INITIAL[VX:])
    with pytest.raises(Unusable, match="x = nan"):
        placed(begin(INITIAL), PoseWithCovariance(Pose(Point(math.nan))), INITIAL[VX:])


def test_where_it_is_put_a_variance_of_zero_is_sure() -> None:
    known = placed(begin(INITIAL), posed(1.0, 0.25, 0.25, 0.0), (4.0, 0.01, 9.0, 1.0, 1.0))
    assert [known.variance(i) for i in range(6)] == pytest.approx([0.25, 0.25, 1e-9, 4.0, 0.01, 9.0])
    with pytest.raises(Unusable, match="the variance of yaw is -1"):
        placed(begin(INITIAL), posed(1.0, 0.25, 0.25, -1.0), INITIAL[VX:])


def test_noise_is_said_as_eight_numbers_or_as_robot_localization_has_it() -> None:
    fifteen = [float(i) for i in range(15)]
    full = [fifteen[i] if i == j else 0.0 for i in range(15) for j in range(15)]
    wanted = (0.0, 1.0, 5.0, 6.0, 7.0, 11.0, 12.0, 13.0)
    assert diagonal(fifteen, INITIAL) == diagonal(full, INITIAL) == wanted
    assert diagonal([], INITIAL) == INITIAL
    assert diagonal([1.0] * 8, INITIAL) == (1.0,) * 8
    with pytest.raises(ValueError, match="3 numbers: 8 variances"):
        diagonal([1.0] * 3, INITIAL)


def test_a_source_is_asked_for_what_it_has() -> None:
    with pytest.raises(ValueError, match="imu says no vx; it says yaw, vyaw, ax, ay"):
        SourceParameters(topic="imu", type="imu", use=["vx"])
    with pytest.raises(ValueError, match="not both"):
        SourceParameters(topic="odom", use=["x"], differential=True, relative=True)
