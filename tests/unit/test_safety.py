import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import LaserScan, Twist, Vector3
from robo_services.safety import Decision, Limits, Situation, decide, nearest_in_sector

LIMITS = Limits(
    min_distance=0.3, warning_distance=0.5, max_speed=1.0, sector=2.0, scan_timeout=0.25, command_timeout=0.5
)
RAYS = 360


def scan(ranges: dict[int, float] | None = None, rest: float = math.inf) -> LaserScan:
    """A full turn; keys are degrees, 0 ahead."""
    values = [rest] * RAYS
    for degrees, value in (ranges or {}).items():
        values[(degrees + 180) % RAYS] = value
    return LaserScan(angle_min=-math.pi, angle_increment=math.tau / RAYS, range_min=0.05, range_max=10.0, ranges=values)


def drive(x: float = 0.4, y: float = 0.0, turn: float = 0.0) -> Twist:
    return Twist(Vector3(x, y), Vector3(z=turn))


def decided(command: Twist | None = None, sees: LaserScan | None = None, **changes: object) -> Decision:
    situation = Situation(command=command or drive(), command_age=0.01, scan=sees or scan(), scan_age=0.01, speed=0.0)
    return decide(msgspec.structs.replace(situation, **changes), LIMITS)


def test_a_free_way() -> None:
    decision = decided(drive(0.4, turn=0.2))
    assert (decision.action, decision.twist) == ("clear", drive(0.4, turn=0.2))


DOUBTS = pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"scan": None}, "no_scan"),
        ({"scan_age": 0.3}, "stale_scan"),
        ({"scan_age": math.nan}, "stale_scan"),
        ({"scan": scan(rest=math.nan)}, "invalid_scan"),
        ({"scan": LaserScan()}, "invalid_scan"),
        ({"scan": LaserScan(angle_min=math.nan, ranges=[1.0])}, "invalid_scan"),
        ({"scan": LaserScan(angle_increment=0.1, ranges=[1.0])}, "invalid_scan"),  # it sees no further than 0 m
        ({"command": None}, "no_command"),
        ({"command_age": 0.6}, "stale_command"),
        ({"command": drive(math.nan)}, "invalid_command"),
        ({"command": drive(math.inf)}, "invalid_command"),
        ({"command": Twist(angular=Vector3(x=math.nan))}, "invalid_command"),
        ({"speed": 1.2}, "overspeed"),
        ({"speed": math.nan}, "overspeed"),
    ],
)


@DOUBTS
def test_a_base_without_a_laser_is_stopped_by_all_but_obstacles(changes: dict[str, object], reason: str) -> None:
    blind = msgspec.structs.replace(LIMITS, laser=False)
    situation = Situation(command=drive(2.0), command_age=0.01, speed=0.0)
    decision = decide(situation, blind)
    assert (decision.action, decision.reason, decision.twist) == ("clear", "no_laser", drive(1.0))
    near = msgspec.structs.replace(situation, scan=scan(rest=0.1), scan_age=0.01)
    assert decide(near, blind).action == "clear"
    if not reason.endswith("_scan"):
        stopped = decide(msgspec.structs.replace(situation, **changes), blind)
        assert (stopped.action, stopped.reason) == ("stop", reason)
    assert decide(msgspec.structs.replace(situation, emergency_stop=True), blind).reason == "emergency_stop"


@DOUBTS
def test_doubt_stops_and_says_why(changes: dict[str, object], reason: str) -> None:
    situation = Situation(command=drive(), command_age=0.01, scan=scan(), scan_age=0.01, speed=0.0)
    decision = decide(msgspec.structs.replace(situation, **changes), LIMITS)
    assert (decision.action, decision.reason, decision.twist) == ("stop", reason, Twist())
    assert decision.text


@pytest.mark.parametrize(
    ("distance", "speed"),
    [(10.0, 0.4), (0.5, 0.4), (0.4, 0.2), (0.45, 0.3), (0.3, 0.0), (0.305, 0.0), (0.1, 0.0), (0.01, 0.0), (-1.0, 0.0)],
)
def test_speed_falls_in_proportion_to_the_distance_ahead(distance: float, speed: float) -> None:
    decision = decided(drive(0.4, turn=0.2), scan({0: distance}))
    assert decision.twist.linear.x == pytest.approx(speed)
    assert decision.twist.angular.z == pytest.approx(speed / 2)  # the same path, more slowly


def test_minus_infinity_is_an_obstacle_and_nan_is_nothing() -> None:
    assert decided(sees=scan({0: -math.inf})).reason == "obstacle"
    assert decided(sees=scan({0: math.nan})).action == "clear"
    assert decided(sees=scan({0: 99.0})).action == "clear"


@pytest.mark.parametrize(
    ("command", "direction"), [(drive(0.4), 0), (drive(-0.4), 180), (drive(0, 0.4), 90), (drive(0.3, 0.3), 45)]
)
def test_only_what_is_in_the_direction_of_motion_counts(command: Twist, direction: int) -> None:
    assert decided(command, scan({direction: 0.2})).action == "stop"
    assert decided(command, scan({direction + 50: 0.2})).action == "stop"
    assert decided(command, scan({direction + 90: 0.2})).action == "clear"
    assert decided(command, scan({direction + 180: 0.2})).action == "clear"


def test_turning_on_the_spot_is_free() -> None:
    assert decided(drive(0.0, turn=1.0), scan(rest=0.1)).twist == drive(0.0, turn=1.0)


def test_a_laser_that_does_not_see_there_stops() -> None:
    half = LaserScan(angle_min=-math.pi / 2, angle_increment=math.pi / 180, range_max=10, ranges=[5.0] * 181)
    assert decided(drive(0.4), half).action == "clear"
    assert decided(drive(-0.4), half).reason == "blind"


def test_max_speed_keeps_the_path() -> None:
    decision = decided(drive(2.0, turn=1.0))
    assert decision.twist == drive(1.0, turn=0.5)


@given(
    st.floats(allow_nan=True), st.floats(allow_nan=True), st.lists(st.floats(allow_nan=True), max_size=40),
    st.floats(allow_nan=True), st.floats(allow_nan=True),
)  # fmt: skip
def test_whatever_comes_in_what_goes_out_is_safe(
    x: float, y: float, ranges: list[float], age: float, inc: float
) -> None:
    sees = LaserScan(angle_min=-1.0, angle_increment=inc, range_max=10.0, ranges=ranges)
    decision = decided(drive(x, y), sees, scan_age=age)
    speed = math.hypot(decision.twist.linear.x, decision.twist.linear.y)
    assert math.isfinite(speed)
    assert speed <= LIMITS.max_speed * (1 + 1e-9)
    if not age <= LIMITS.scan_timeout:
        assert decision.action == "stop"


def test_nearest() -> None:
    assert nearest_in_sector(scan({10: 2.0, 20: 1.0, 100: 0.5}), 0.0, 1.0) == 1.0
    assert nearest_in_sector(scan(rest=math.nan), 0.0, 1.0) is None
