"""The filter: where it says that a base is, how sure it is of that, and what it does not believe."""

import math
import random
from collections.abc import Sequence
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo_services.ekf import (
    AX,
    AY,
    VX,
    VY,
    VYAW,
    YAW,
    Estimate,
    Measurement,
    Unusable,
    X,
    Y,
    after_gap,
    begin,
    correct,
    predict,
)
from robo_services.ekf_history import Ekf
from robo_services.ekf_parameters import INITIAL, PROCESS_NOISE
from robo_services.factors import Factors
from robo_services.kinematics import ORIGIN, Pose2, advance
from robo_services.planar import angle_difference
from tests.unit.test_factors import is_covariance

SPEEDS = st.floats(-3, 3)
RATES = st.floats(-6, 6)


def moving(vx: float, vy: float, turning: float, yaw: float = 0.0, ax: float = 0.0, ay: float = 0.0) -> Estimate:
    return begin(INITIAL)._replace(mean=(1.0, -2.0, yaw, vx, vy, turning, ax, ay))


def measured(time: float, deviation: float = 0.01, **values: float) -> Measurement:
    indices = tuple(("x", "y", "yaw", "vx", "vy", "vyaw", "ax", "ay").index(name) for name in values)
    n = len(indices)
    covariance = [[deviation**2 if i == j else 0.0 for j in range(n)] for i in range(n)]
    return Measurement(time, "s", indices, tuple(values.values()), covariance)


def place(estimate: Estimate) -> Pose2:
    return Pose2(*estimate.mean[:VX])


# -- how it moves ------------------------------------------------------------------------------------------------------


@given(SPEEDS, RATES, st.floats(-3, 3), st.floats(0.001, 1), st.integers(1, 10))
def test_a_base_drives_exact_arcs_however_short_the_steps(
    speed: float, rate: float, yaw: float, dt: float, parts: int
) -> None:
    there = moving(speed, 0.0, rate, yaw)
    for _ in range(parts):
        there = predict(there, dt / parts, PROCESS_NOISE)
    expected = advance(Pose2(1.0, -2.0, yaw), speed, rate, dt)
    assert (there.mean[X], there.mean[Y]) == pytest.approx((expected.x, expected.y), abs=1e-9)
    assert angle_difference(there.mean[YAW], expected.yaw) == pytest.approx(0.0, abs=1e-9)
    assert there.time == pytest.approx(dt)


@given(SPEEDS, SPEEDS, RATES, st.floats(-3, 3), SPEEDS, SPEEDS, st.floats(0.001, 0.5))
def test_how_the_motion_depends_on_what_is_known_is_its_derivative(
    vx: float, vy: float, rate: float, yaw: float, ax: float, ay: float, dt: float
) -> None:
    """The covariance of what is known nearly, moved, is that of the moved differences."""
    begun, step = moving(vx, vy, rate, yaw, ax, ay), 1e-6
    there = predict(begun, dt, (0.0,) * 8)
    columns: list[list[float]] = []
    for k in range(8):
        ends = []
        for sign in (1, -1):
            shifted = tuple(one + sign * step * (i == k) for i, one in enumerate(begun.mean))
            ends.append(predict(begun._replace(mean=shifted), dt, (0.0,) * 8).mean)
        columns.append(
            [
                (angle_difference(a, b) if i == YAW else a - b) / (2 * step)
                for i, (a, b) in enumerate(zip(*ends, strict=True))
            ]
        )
    expected = [[sum(INITIAL[k] * columns[k][i] * columns[k][j] for k in range(8)) for j in range(8)] for i in range(8)]
    for row, wanted in zip(there.factors.matrix(), expected, strict=True):
        assert row == pytest.approx(wanted, rel=1e-4, abs=1e-5)


@given(SPEEDS, SPEEDS, RATES)
def test_what_an_imu_feels_on_a_curve_is_no_acceleration(vx: float, vy: float, rate: float) -> None:
    """What goes round at a constant speed feels vyaw × v; its velocities do not change."""
    begun = moving(vx, vy, rate)
    felt = measured(0.0, ax=-rate * vy, ay=rate * vx)
    assert correct(begun, felt)[0].mean == pytest.approx(begun.mean, abs=1e-9)


@given(SPEEDS, SPEEDS, st.floats(0.01, 1.0))
def test_accelerations_fade_as_much_in_one_step_as_in_many(ax: float, ay: float, dt: float) -> None:
    begun = moving(0.5, 0.0, 0.0, ax=ax, ay=ay)
    once, often = predict(begun, dt, PROCESS_NOISE), begun
    for _ in range(50):
        often = predict(often, dt / 50, PROCESS_NOISE)
    assert once.mean == pytest.approx(often.mean, abs=1e-9)
    covariances = once.covariance(), often.covariance()
    for a, b in ((AX, AX), (AY, AY), (VX, AX), (VY, AY)):
        expected, found = (one[a][b] for one in covariances)
        assert expected == pytest.approx(found, rel=1e-6)


def test_without_anybody_who_measures_them_there_are_no_accelerations() -> None:
    begun = begin(INITIAL[:AX])
    assert len(predict(begun, 0.1, PROCESS_NOISE).mean) == AX
    assert correct(begun, measured(0.0, ax=1.0, ay=1.0)) == (begun, 0.0)


# -- how sure it is ----------------------------------------------------------------------------------------------------


STEPS = st.lists(
    st.tuples(
        st.floats(0, 2),
        st.sampled_from([(X, Y, YAW), (VX, VYAW), (VX, VY, VYAW), (YAW,), (VYAW,), (AX, AY)]),
        st.floats(-100, 100),
        st.floats(-9, 6),
    ),
    min_size=1,
    max_size=40,
)


@given(STEPS, st.booleans())
def test_the_covariance_stays_one_and_all_stays_finite(
    steps: list[tuple[float, tuple[int, ...], float, float]], accelerates: bool
) -> None:
    now = begin(INITIAL if accelerates else INITIAL[:AX])
    for dt, indices, value, exponent in steps:
        now = predict(now, dt, PROCESS_NOISE)
        n = len(indices)
        errors = [[10.0**exponent * (1.0 if i == j else 0.5) for j in range(n)] for i in range(n)]
        now, distance = correct(now, Measurement(now.time, "s", indices, (value,) * n, errors))
        assert distance >= 0.0
        assert is_covariance(now.factors.matrix())
        assert all(map(math.isfinite, now.mean))
        assert -math.pi < now.mean[YAW] <= math.pi
    assert is_covariance(after_gap(now, 1.0, INITIAL[VX:]).factors.matrix())


@given(STEPS)
def test_a_measurement_makes_nothing_less_sure(steps: list[tuple[float, tuple[int, ...], float, float]]) -> None:
    now = begin(INITIAL)
    for dt, indices, value, exponent in steps:
        now = predict(now, dt, PROCESS_NOISE)
        before = [now.variance(i) for i in range(8)]
        n = len(indices)
        errors = [[10.0**exponent * (i == j) for j in range(n)] for i in range(n)]
        now, _ = correct(now, Measurement(now.time, "s", indices, (value,) * n, errors))
        assert all(now.variance(i) <= old * (1 + 1e-9) + 1e-17 for i, old in enumerate(before))


@given(st.floats(-3.14, 3.14), st.floats(-3.14, 3.14))
def test_headings_meet_on_the_short_way_round(known: float, said: float) -> None:
    begun = begin(INITIAL)._replace(mean=(0.0, 0.0, known, 0.0, 0.0, 0.0, 0.0, 0.0))
    now, _ = correct(begun, measured(0.0, 1e-3, yaw=said))  # both are equally sure
    assert abs(angle_difference(now.mean[YAW], known)) <= abs(angle_difference(said, known)) / 2 + 1e-9
    assert abs(angle_difference(now.mean[YAW], said)) == pytest.approx(
        abs(angle_difference(now.mean[YAW], known)), abs=1e-6
    )


def test_several_numbers_at_once_are_as_one_after_the_other() -> None:
    begun = predict(moving(0.5, 0.0, 0.3), 0.2, PROCESS_NOISE)
    once, _ = correct(begun, measured(0.2, vx=0.6, vyaw=0.1, x=1.2))
    turns = begun
    for one in ({"vx": 0.6}, {"vyaw": 0.1}, {"x": 1.2}):
        turns, _ = correct(turns, measured(0.2, **one))
    assert once.mean == pytest.approx(turns.mean, abs=1e-12)


SURE = (1e-4, 1e-4, 1e-4, 0.01, 1e-4, 0.01)


def consistency(seed: int) -> float:
    """A base that moves as the filter takes it to, measured as it takes it to be: how far it errs in its own measure.

    Returns:
        The squared Mahalanobis distance of all six quantities after 4 s.
    """
    rng = random.Random(seed)
    noise = (1e-6, 1e-6, 1e-6, 0.3, 1e-4, 0.5)
    truth = Estimate(0.0, tuple(rng.gauss(0.0, math.sqrt(one)) for one in SURE), Factors.diagonal(SURE))
    ekf = Ekf(begin(SURE), noise)
    for step in range(1, 201):
        time, dt = step * 0.02, 0.02
        middle = predict(truth, dt / 2, noise)
        shaken = tuple(one + rng.gauss(0.0, math.sqrt(noise[i] * dt)) for i, one in enumerate(middle.mean))
        truth = predict(middle._replace(mean=shaken), dt / 2, noise)
        vx, vyaw = truth.mean[VX] + rng.gauss(0.0, 0.02), truth.mean[VYAW] + rng.gauss(0.0, 0.02)
        ekf.take([measured(time, 0.02, vx=vx, vyaw=vyaw)])
        if step % 50 == 0:
            x, y = truth.mean[X] + rng.gauss(0.0, 0.1), truth.mean[Y] + rng.gauss(0.0, 0.1)
            ekf.take([measured(time, 0.1, x=x, y=y)])
    return _distance(ekf.now, truth.mean)


def _distance(estimate: Estimate, truth: Sequence[float]) -> float:
    gaps = [
        [angle_difference(a, b) if i == YAW else a - b]
        for i, (a, b) in enumerate(zip(truth, estimate.mean, strict=True))
    ]
    apart = estimate.factors.correlate(gaps)
    return sum(gap[0] ** 2 / variance for gap, variance in zip(apart, estimate.factors.d, strict=True))


def test_an_error_that_stays_the_same_does_not_average_out() -> None:
    """A gyro whose bias is known to 0.01 rad/s: after 10 s the heading is known to 0.1 rad, however often it speaks."""
    for rate in (20, 100):
        ekf = Ekf(begin(INITIAL[:AX]), PROCESS_NOISE)
        for step in range(10 * rate + 1):
            gyro = measured(step / rate, 1e-3, vyaw=0.3)._replace(drift=0.01)
            ekf.take([gyro, measured(step / rate, 0.01, vx=0.5, vy=0.0)])
        assert math.sqrt(ekf.now.variance(YAW)) == pytest.approx(0.1, rel=0.05)
        assert math.sqrt(ekf.now.variance(VYAW)) == pytest.approx(0.01, rel=0.05)
        assert is_covariance(ekf.now.covariance())
        lost = after_gap(ekf.now, 0.0, INITIAL[VX:AX])
        assert lost.variance(YAW) == pytest.approx(ekf.now.variance(YAW), rel=1e-6)
        assert lost.variance(VYAW) == pytest.approx(INITIAL[VYAW])
    compass = measured(10.0, 0.05, yaw=ekf.now.mean[YAW] + 0.3)
    wanted = 0.3 / math.hypot(0.05, math.sqrt(ekf.now.variance(YAW)))
    known, distance = correct(ekf.now, compass)
    assert distance == pytest.approx(wanted), "what is no noise makes it less sure too"
    assert known.variance(YAW) < ekf.now.variance(YAW)
    assert correct(ekf.now, compass._replace(threshold=2.0))[0] is ekf.now


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3), st.floats(0.0, 1.0))
def test_how_far_one_is_away_counts_errors_in_common_once(values: list[float], drift: float) -> None:
    """Beside the whole matrix: gᵀ S⁻¹ g with S = H P Hᵀ + R, all errors counted."""
    now = begin((0.1, 0.2, 0.3, 0.4, 0.5, 0.6))._replace(drift=(0.3, -0.2, 0.5, 0.0, 0.1, -0.4))
    pose = measured(0.0, 0.1, x=values[0], y=values[1], yaw=values[2])._replace(drift=drift)
    common = [drift - one for one in now.drift[:VX]]
    noise = now.factors.matrix()
    whole = [[noise[i][j] + 0.01 * (i == j) + common[i] * common[j] for j in range(3)] for i in range(3)]
    factors = Factors.of(whole)
    apart = factors.correlate([[one] for one in values])
    expected = math.sqrt(sum(gap[0] ** 2 / variance for gap, variance in zip(apart, factors.d, strict=True)))
    assert correct(now, pose)[1] == pytest.approx(expected, abs=1e-9)


def test_it_errs_as_much_as_it_says() -> None:
    """The mean over 40 runs is that of χ² with six degrees of freedom, 6 ± 0.55 (Bar-Shalom et al. 2001, §5.4)."""
    runs = [consistency(seed) for seed in range(40)]
    assert sum(runs) / len(runs) == pytest.approx(6.0, abs=1.1)


# -- what it does not believe ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "broken",
    [
        measured(0.0, vx=math.nan),
        measured(0.0, x=math.inf),
        measured(0.0, x=1e8),
        measured(math.nan, vx=1.0),
        measured(0.0, vx=1.0)._replace(covariance=[[math.nan]]),
        measured(0.0, vx=1.0)._replace(covariance=[[-1.0]]),
        measured(0.0, vx=1.0, vyaw=1.0)._replace(covariance=[[1.0, 2.0], [2.0, 1.0]]),
    ],
)
def test_what_says_nothing_is_refused_and_counted(broken: Measurement) -> None:
    with pytest.raises(Unusable):
        correct(begin(INITIAL), broken)
    ekf = Ekf(begin(INITIAL), PROCESS_NOISE)
    ekf.take([measured(0.0, vx=0.5)])
    before = ekf.now
    ekf.take([broken])
    assert ekf.now == before
    assert ekf.refused == {"s": 1}
    assert ekf.complaints["s"]


def test_what_is_too_far_away_is_left_out() -> None:
    ekf = Ekf(begin(INITIAL), PROCESS_NOISE)
    for step in range(50):
        ekf.take([measured(step * 0.02, vx=0.5, vyaw=0.0)])
    before = ekf.now
    wild = measured(1.0, vx=5.0)._replace(threshold=5.0)
    ekf.take([wild])
    assert ekf.now.mean[VX] == pytest.approx(before.mean[VX])
    assert ekf.rejected == {"s": 1}
    ekf.take([wild._replace(time=1.02, threshold=math.inf)])
    assert ekf.now.mean[VX] > 2.0


# -- what comes late, and gaps -----------------------------------------------------------------------------------------


def drive(rng: random.Random) -> list[Measurement]:
    """Wheels at 50 Hz and a gyro at 100 Hz, for 0.6 s."""
    found = [measured(k * 0.02, vx=rng.uniform(-1, 1), vy=0.0) for k in range(30)]
    found += [measured(k * 0.01 + 0.003, vyaw=rng.uniform(-2, 2)) for k in range(60)]
    return sorted(found, key=lambda one: one.time)


@settings(max_examples=20)
@given(st.integers(0, 10_000), st.floats(0.0, 0.25))
def test_in_whatever_order_they_come_it_ends_the_same(seed: int, delay: float) -> None:
    rng = random.Random(seed)
    in_order = drive(rng)
    begun = measured(-1.0, vx=0.0, vyaw=0.0)  # the first one that comes says when it begins
    arrived = sorted(in_order, key=lambda one: one.time + rng.uniform(0.0, delay))
    straight, mixed = (Ekf(begin(INITIAL[:AX]), PROCESS_NOISE, history=0.3) for _ in range(2))
    straight.take([begun, *in_order])
    mixed.take([begun])
    rest = arrived
    while rest:
        count = rng.randint(1, 5)
        mixed.take(rest[:count])
        rest = rest[count:]
    assert not mixed.late
    assert mixed.now.mean == pytest.approx(straight.now.mean, abs=1e-12)
    assert mixed.now.factors.d == pytest.approx(straight.now.factors.d, rel=1e-9)
    for row, other in zip(mixed.now.factors.u, straight.now.factors.u, strict=True):
        assert row == pytest.approx(other, rel=1e-9, abs=1e-12)


def test_it_says_what_was_measured_by_those_that_it_took() -> None:
    ekf = Ekf(begin(INITIAL[:AX]), PROCESS_NOISE, history=0.3)
    assumed = measured(1.0, vy=0.0)._replace(assumed=True)
    assert ekf.take([measured(1.0, vx=0.0, vyaw=0.0), assumed]) == {VX, VYAW}
    far = measured(1.1, vx=500.0)._replace(threshold=5.0)
    assert ekf.take([far, measured(1.1, x=0.0)]) == {X}
    assert ekf.complaints["s"].startswith("vx: ")
    assert ekf.complaints["s"].endswith(" standard deviations from what was expected")
    assert ekf.take([measured(0.2, vx=0.0)]) == set()
    assert ekf.take([measured(1.05, vyaw=math.nan)]) == set()


def test_where_it_is_slow_it_takes_nothing_once_more() -> None:
    ekf = Ekf(begin(INITIAL[:AX]), PROCESS_NOISE, history=0.3)
    ekf.take([measured(step * 0.01, vx=0.5) for step in range(100)])
    assert ekf.take([measured(0.9, vx=0.5), measured(1.0, vyaw=0.0)], replay=False) == {VYAW}
    assert (ekf.replayed, ekf.late) == (0, {"s": 1})
    assert ekf.take([measured(0.905, vx=0.5)]) == {VX}
    assert ekf.replayed == 10


def test_what_is_older_than_the_history_is_left_out_and_counted() -> None:
    ekf = Ekf(begin(INITIAL), PROCESS_NOISE, history=0.3)
    for step in range(100):
        ekf.take([measured(step * 0.02, vx=0.5)])
    before = ekf.now
    ekf.take([measured(1.0, vx=-5.0)])
    assert (ekf.late, ekf.now) == ({"s": 1}, before)
    assert ekf.complaints == {"s": "0.98 s late"}
    ekf.take([measured(1.8, vx=-5.0)])
    assert ekf.late == {"s": 1}
    assert ekf.replayed == 9
    assert ekf.now.mean[X] < before.mean[X]


def test_the_history_holds_no_more_than_it_has_to() -> None:
    ekf = Ekf(begin(INITIAL[:AX]), PROCESS_NOISE, history=0.1)
    for step in range(500):
        ekf.take([measured(step * 0.01, vx=0.5)])
    assert len(ekf._steps) <= 12


def test_after_a_gap_it_is_where_it_was_and_less_sure() -> None:
    ekf = Ekf(begin(INITIAL[:AX]), PROCESS_NOISE, longest_step=0.25)
    for step in range(51):
        ekf.take([measured(step * 0.02, vx=1.0, vy=0.0, vyaw=0.0)])
    assert ekf.now.mean[X] == pytest.approx(1.0, abs=0.02)
    ekf.take([measured(3.0, vx=0.0, vy=0.0, vyaw=0.0)])
    assert ekf.now.mean[X] == pytest.approx(1.0, abs=0.03), "nobody knows whether it went on"
    assert math.sqrt(ekf.now.variance(X)) == pytest.approx(2.0, abs=0.1), "it may be 2 m further"


def test_after_whatever_gap_it_is_no_less_sure_than_lost() -> None:
    moving_on = begin(INITIAL)._replace(mean=(0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0))
    there = after_gap(moving_on, 1e9, INITIAL[VX:])
    assert math.sqrt(there.variance(X)) == pytest.approx(1e3)
    assert math.sqrt(there.variance(YAW)) == pytest.approx(math.pi, rel=1e-3)


def test_a_velocity_is_integrated_as_by_the_trapezoid_rule() -> None:
    """Over a turn whose rate is measured exactly twenty times a second, the heading errs by less than Euler's rule."""
    ekf = Ekf(begin(INITIAL[:AX]), PROCESS_NOISE)
    rates = [(k * 0.05, math.sin(k * 0.05)) for k in range(41)]
    for time, rate in rates:
        ekf.take([measured(time, 1e-4, vyaw=rate)])
    expected = sum((a[1] + b[1]) / 2 * 0.05 for a, b in pairwise(rates))
    assert ekf.now.mean[YAW] == pytest.approx(expected, abs=1e-4)
    assert advance(ORIGIN, 0.0, expected, 1.0).yaw == pytest.approx(1 - math.cos(2.0), abs=1e-3)
