"""The way through waypoints is where it says that it is, whatever the waypoints."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robo_services.planar import angle_difference
from robo_services.routes import SAME, SHARPEST, Goal, Route, route_through

few = settings(max_examples=200, derandomize=True)

places = st.floats(-10, 10) | st.sampled_from([0.0, 1.0, 1.0 + 1e-9, -2.0])
"""Some of them again and again, so that waypoints coincide, stand in a line and turn back."""
goals = st.builds(Goal, places, places, st.floats(0.01, 1.0), st.booleans() | st.just(False))
begins = st.tuples(places, places)
ways = st.lists(goals, min_size=1, max_size=12)


def gap(route: Route, along: float, x: float, y: float) -> float:
    pose = route.at(along)
    return math.hypot(pose.x - x, pose.y - y)


@few
@given(begins, ways)
def test_it_passes_each_goal_within_its_slack_and_stands_at_the_point(
    begin: tuple[float, float], way: list[Goal]
) -> None:
    route = route_through(begin, way)
    assert list(route.marks) == sorted(route.marks)
    assert gap(route, 0.0, *begin) <= SAME + 1e-9
    assert gap(route, route.length, way[-1].x, way[-1].y) <= SAME + 1e-9
    for goal, mark, stands in zip(way, route.marks, route.stands, strict=True):
        assert gap(route, mark, goal.x, goal.y) <= (0.0 if stands else goal.slack) + SAME + 1e-6
        assert stands or not goal.stands


@few
@given(begins, ways)
def test_it_has_no_gaps_and_bends_but_where_the_robot_stands(begin: tuple[float, float], way: list[Goal]) -> None:
    route = route_through(begin, way)
    stands = [mark for mark, one in zip(route.marks, route.stands, strict=True) if one]
    for a, b in pairwise(route.pieces):
        end = a.at(a.length)
        assert b.start == pytest.approx(a.start + a.length)
        assert (end.x, end.y) == pytest.approx((b.begin.x, b.begin.y), abs=1e-6)
        if not any(abs(b.start - mark) < 1e-6 for mark in stands):
            assert abs(angle_difference(end.yaw, b.begin.yaw)) < 1e-5
    straight = sum(math.hypot(b.x - a.x, b.y - a.y) for a, b in pairwise([Goal(*begin, 1.0), *way]))
    assert route.length <= straight + 1e-6, "corners are cut, never taken wide"


@few
@given(begins, ways, places, places, st.floats(0, 1), st.floats(0, 1))
def test_the_nearest_point_is_the_nearest(
    begin: tuple[float, float], way: list[Goal], x: float, y: float, a: float, b: float
) -> None:
    route = route_through(begin, way)
    low, high = sorted((a * route.length, b * route.length))
    found = route.nearest(x, y, low, high)
    assert low <= found <= high
    sampled = min(gap(route, low + (high - low) * i / 200, x, y) for i in range(201))
    assert gap(route, found, x, y) <= sampled + 1e-6


@few
@given(begins, ways)
def test_poses_that_show_it_lie_on_it(begin: tuple[float, float], way: list[Goal]) -> None:
    route = route_through(begin, way)
    poses = list(route.poses())
    assert len(poses) <= 1 + len(route.pieces) * (1 + math.ceil(SHARPEST / 0.2))
    assert (poses[-1].x, poses[-1].y) == pytest.approx(route.at(route.length)[:2])
    assert all(gap(route, route.nearest(p.x, p.y, 0.0, route.length), p.x, p.y) < 1e-6 for p in poses)


def test_a_right_angle_is_rounded_off_by_the_slack() -> None:
    route = route_through((0, 0), [Goal(4, 0, 0.1), Goal(4, 4, 0.1)])
    line, arc, other = route.pieces
    assert (line.curvature, other.curvature) == (0.0, 0.0)
    assert arc.curvature == pytest.approx((math.sqrt(2) - 1) / 0.1)
    assert gap(route, route.marks[0], 4, 0) == pytest.approx(0.1)
    assert route.stands == (False, False)


def test_an_arc_takes_at_most_half_of_a_side() -> None:
    route = route_through((0, 0), [Goal(1, 0, 9.0), Goal(1, 0.5, 9.0), Goal(0, 0.5, 9.0)])
    assert [piece.curvature for piece in route.pieces] == pytest.approx([0.0, 4.0, 4.0, 0.0])


@pytest.mark.parametrize("turn", [math.pi, -3.0, 2.1])
def test_the_robot_stands_where_the_way_turns_back(turn: float) -> None:
    route = route_through((0, 0), [Goal(2, 0, 0.2), Goal(2 + math.cos(turn), math.sin(turn), 0.2)])
    assert route.stands == (True, False)
    assert route.length == pytest.approx(3.0)


def test_waypoints_in_one_place_are_one() -> None:
    nowhere = route_through((1, 1), [Goal(1, 1, 0.1), Goal(1, 1, 0.1)])
    assert (nowhere.length, nowhere.marks) == (0.0, (0.0, 0.0))
    assert nowhere.at(5.0)[:2] == (1, 1)
    twice = route_through((0, 0), [Goal(1, 0, 0.1), Goal(1, 0, 0.1, stands=True), Goal(1, 1, 0.1)])
    assert twice.stands == (True, True, False)
    assert twice.marks == (1.0, 1.0, 2.0)
