"""The position tracker as a node: what it publishes and tells of what it hears."""

import math

import pytest

from robo.testing import Clock, RunNode
from robo_messages import Header, Odometry, Point, Pose, PoseWithCovariance, Time
from robo_services.position_tracker import PositionTracker


def odometry(x: float, y: float, at: float) -> Odometry:
    return Odometry(header=Header(Time.from_seconds(at)), pose=PoseWithCovariance(Pose(Point(x, y))))


def test_it_adds_up_the_way_and_warns_once(run_node: RunNode, caplog: pytest.LogCaptureFixture) -> None:
    tracker = run_node(PositionTracker, max_distance=5.0)
    for i, (x, y) in enumerate([(0.0, 0.0), (3.0, 4.0), (math.nan, 0.0), (3.0, 3.0), (9.0, 3.0)]):
        tracker.send("odom", odometry(x, y, at=5.0 * i))
    positions = tracker.published("current_position")
    assert [position.z for position in positions] == [0.0, 5.0, 6.0, 12.0]
    assert positions[-1] == Point(9.0, 3.0, 12.0)
    assert sum("more than max_distance" in text for text in caplog.messages) == 1


def test_it_leaves_out_what_the_base_cannot_have_done(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    tracker = run_node(PositionTracker, log_rate=50.0, max_linear_velocity=1.5)
    for i in range(100):
        tracker.send("odom", odometry(0.01 * i, 0.0, at=0.02 * i))
        tracker.send("odom", odometry(1e3 * i + 50, math.inf if i % 3 else -70.0, at=1e6 * i))
        clock.advance(0.02)
    for i in range(10):  # the base is put back to its start
        tracker.send("odom", odometry(0.01 * i, 0.0, at=0.02 * (i + 100)))
        clock.advance(0.02)
    positions = tracker.published("current_position")
    assert len(positions) == 110
    before, last = positions[99], positions[-1]
    assert (before.x, before.y, before.z) == pytest.approx((0.99, 0.0, 0.99))
    assert (last.x, last.y, last.z) == pytest.approx((0.09, 0.0, 0.99 + 0.09))
    assert sum("cannot be" in text for text in caplog.messages) == 1
    assert any("begins anew, 0.990 m" in text for text in caplog.messages)
    clock.advance(60.0)
    assert any("left out 100 of odometry" in text for text in caplog.messages)


def test_it_says_where_it_is_when_that_is_news(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    def said() -> list[str]:
        return [text for text in caplog.messages if text.startswith("position (")]

    tracker = run_node(PositionTracker)
    clock.advance(5.0)
    assert said() == []
    for i in range(20):
        tracker.send("odom", odometry(0.1 * min(i, 10), 0.0, at=0.5 * i))
        clock.advance(0.5)
    assert said()[0] != said()[-1] == "position (1.000, 0.000), distance 1.000 m"
    assert 5 <= len(said()) <= 7, "once a second, and only while it drives"
    before = len(said())
    clock.advance(30.0)
    assert len(said()) == before
    tracker.close()
    assert said()[before:] == ["position (1.000, 0.000), distance 1.000 m"], "where it ended"
