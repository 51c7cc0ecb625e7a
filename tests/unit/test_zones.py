"""What zones and the footprint make of a command: pure."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo_messages import LaserScan, Twist, Vector3
from robo_services.collision import Body, Sighting, free_share
from robo_services.contact import STANDING, Velocity, disc, polygon
from robo_services.kinematics import Pose2
from robo_services.obstacles import Obstacle, from_scan
from robo_services.safety import Limits, Situation, decide
from robo_services.zones import Zone, verdicts

STILL = Body(footprint=disc(0.2), margin=0.05, reaction_time=0.2, deceleration=2.0)
"""Where nothing else moves."""

HERE = Pose2()


def seen(*points: tuple[float, float], source: str = "scan", moved: Pose2 = HERE) -> list[Sighting]:
    obstacles = sorted(Obstacle(math.hypot(x, y), x, y) for x, y in points)
    return [Sighting(source=source, obstacles=obstacles, moved=moved)]


def test_it_can_stop_before_what_is_ahead() -> None:
    # Reaction and braking at 1 m/s take 0.2 m and 0.25 m, behind 0.2 m of the robot and 0.05 m of margin.
    assert free_share(Velocity(1.0), STANDING, STILL, seen((0.71, 0.0))).share == 1.0
    found = free_share(Velocity(1.0), STANDING, STILL, seen((0.45, 0.0)))
    assert found.share * 0.2 + found.share**2 * 0.25 == pytest.approx(0.2, abs=2e-3)
    assert found.source == "scan"
    assert found.distance == pytest.approx(0.25)
    assert free_share(Velocity(-1.0), STANDING, STILL, seen((0.45, 0.0))).share == 1.0
    assert free_share(Velocity(1.0), STANDING, STILL, seen((0.45, 0.26))).share == 1.0, "beside the way"
    assert free_share(Velocity(1.0, 0.0, 2.0), STANDING, STILL, seen((0.45, 0.26))).share < 1.0


def test_how_it_moves_counts_as_well_as_what_is_commanded() -> None:
    wall = seen((0.35, 0.0))
    assert free_share(Velocity(turn=1.0), Velocity(1.0), STILL, wall).share == 0.0, "it drives into it"
    assert free_share(Velocity(turn=1.0), Velocity(0.02), STILL, wall).share == 1.0, "odometry trembles"
    assert free_share(Velocity(-0.5), STANDING, STILL, wall).share == 1.0
    between = seen(*((0.4 * math.cos(a / 100), 0.4 * math.sin(a / 100)) for a in range(30, 60)))
    assert free_share(Velocity(0.6, 0.0, 2.5), Velocity(0.6, 0.0, -2.5), STILL, between).share == 0.0


def test_who_is_near_may_drive_along_and_away_but_no_nearer() -> None:
    near = seen(*((x / 100, 0.235) for x in range(-60, 61)))
    assert free_share(Velocity(0.5), STANDING, STILL, near).share == 1.0
    assert free_share(Velocity(0.5, 0.0, 0.4), STANDING, STILL, near).share < 0.5
    assert free_share(Velocity(0.5, 0.0, -0.4), STANDING, STILL, near).share == 1.0
    touching = seen((0.15, 0.0))
    assert free_share(Velocity(0.1), STANDING, STILL, touching).share == 0.0
    assert free_share(Velocity(-0.1), STANDING, STILL, touching).share == 1.0


def test_the_faster_obstacles_may_be_the_more_room_is_left() -> None:
    speeds = [0.0, 0.1, 0.3, 0.6]
    bodies = [msgspec.structs.replace(STILL, obstacle_speed=speed) for speed in speeds]
    shares = [free_share(Velocity(1.0), STANDING, body, seen((0.5, 0.0))).share for body in bodies]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 1.5 * shares[2] > 0.0
    beside = seen((0.4, 0.4))
    assert free_share(Velocity(1.0), STANDING, bodies[0], beside).share == 1.0
    assert free_share(Velocity(1.0), STANDING, bodies[2], beside).share < 1.0


POINTS = st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), max_size=8)
MOTIONS = st.builds(Velocity, st.floats(-1, 1), st.just(0.0), st.floats(-3, 3))


@given(POINTS, MOTIONS, MOTIONS, st.sampled_from([0.0, 0.3]), st.booleans())
def test_a_share_is_a_share_and_more_obstacles_leave_no_more(
    points: list[tuple[float, float]], command: Velocity, measured: Velocity, obstacle_speed: float, round_: bool
) -> None:
    shape = disc(0.2) if round_ else polygon([(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)])
    body = msgspec.structs.replace(STILL, footprint=shape, obstacle_speed=obstacle_speed)
    found = free_share(command, measured, body, seen(*points))
    assert 0.0 <= found.share <= 1.0
    several = [each for i, point in enumerate(points) for each in seen(point, source=str(i))]
    assert free_share(command, measured, body, several).share >= 0.0
    assert free_share(command, measured, body, []).share == 1.0


def test_the_most_restrictive_zone_wins_in_a_decision() -> None:
    slow = Zone(name="slow", action="slow_down", shape=disc(1.0), share=0.5)
    limit = Zone(name="limit", action="limit", shape=disc(1.0), max_speed=0.1, max_turn=9.0)
    stop = Zone(name="stop", action="stop", shape=polygon([(0.9, 0.1), (0.6, 0.1), (0.6, -0.1), (0.9, -0.1)]))
    twist = Twist(Vector3(0.4), Vector3(z=0.2))

    def decided(*zones: Zone, at: tuple[float, float]) -> tuple[str, str, float]:
        limits = Limits(
            min_distance=0.3, warning_distance=0.5, max_speed=1.0, sector=2.0, scan_timeout=1.0, command_timeout=1.0,
            laser=False, zones=zones, timeouts=(("scan", 1.0),),
        )  # fmt: skip
        decision = decide(Situation(command=twist, command_age=0.0, sightings=seen(at)), limits)
        assert decision.twist.angular.z == pytest.approx(decision.twist.linear.x / 2), "the same arc"
        return decision.action, decision.zone, round(decision.twist.linear.x, 9)

    assert decided(slow, limit, stop, at=(2.0, 0.0)) == ("clear", "", 0.4)
    assert decided(slow, limit, stop, at=(0.0, 0.9)) == ("limit", "limit", 0.1)
    assert decided(slow, at=(0.0, 0.9)) == ("slow", "slow", 0.2)
    assert decided(slow, limit, stop, at=(0.7, 0.0)) == ("stop", "stop", 0.0)


def test_zones_take_the_points_of_their_sources_and_where_they_are_by_now() -> None:
    zone = Zone(name="near", action="stop", shape=disc(0.5), min_points=2, sources=("front",))
    two = ((0.6, 0.0), (0.6, 0.05))
    ahead = Pose2(0.2, 0.0, 0.0)
    assert not verdicts(Velocity(0.1), [zone], seen(*two, source="front"))
    assert verdicts(Velocity(0.1), [zone], seen(*two, source="front", moved=ahead))
    assert not verdicts(Velocity(0.1), [zone], seen(*two, source="rear", moved=ahead))
    assert not verdicts(Velocity(0.1), [zone], seen(two[0], source="front", moved=ahead)), "one point is noise"
    both = seen(two[0], source="front", moved=ahead) + seen(two[1], source="rear", moved=ahead)
    assert not verdicts(Velocity(0.1), [zone], both)
    assert verdicts(Velocity(0.1), [msgspec.structs.replace(zone, sources=())], both), "of all sources together"


def test_a_thick_scan_has_few_points_and_counts_all_of_them() -> None:
    scan = LaserScan(angle_min=-0.5, angle_increment=1.0 / 5000, range_max=10.0, ranges=[1.0] * 5000)
    points = from_scan(scan, Pose2())
    assert sum(point.points for point in points) == 5000
    assert len(points) < 200
    assert points == sorted(points)


@pytest.mark.parametrize("x", [0.25, 0.249, 0.24])
def test_what_is_just_within_the_outline_is_as_in_the_way_as_what_is_just_outside(x: float) -> None:
    box = Body(footprint=polygon([(0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.25, -0.2)]), margin=0.05)
    corner = seen((x + 0.01, 0.19))
    assert free_share(Velocity(turn=-1.0), STANDING, box, corner).share == 0.0, "the corner swings into it"
    assert free_share(Velocity(turn=1.0), STANDING, box, corner).share == 1.0
    assert free_share(Velocity(-0.3), STANDING, box, corner).share == 1.0, "away from it"
    assert free_share(Velocity(0.3), STANDING, box, corner).share == 0.0


def test_motions_that_no_base_makes_raise_nothing() -> None:
    absurd = Velocity(1e300, -1e300, -1.6e308)
    assert free_share(Velocity(0.5), absurd, STILL, seen((0.34, 0.0))).share < 1.0
