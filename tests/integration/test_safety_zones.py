"""The safety monitor as a node: zones, sources, the emergency stop's ways, and whoever drives past it."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from robo import ParameterError
from robo.testing import Clock, NodeUnderTest, RunNode
from robo.testing.node import NotThere
from robo_messages import (
    Bool,
    Header,
    Joy,
    LaserScan,
    Marker,
    Odometry,
    PointCloud2,
    Quaternion,
    Range,
    TFMessage,
    Transform,
    TransformStamped,
    Trigger,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from robo_services import safety_monitor
from robo_services.safety_monitor import SafetyMonitor

Monitor = NodeUnderTest[SafetyMonitor]


def scan(seen: dict[int, float] | None = None, rest: float = 5.0, frame: str = "") -> LaserScan:
    """A full turn; keys are degrees, 0 ahead."""
    ranges = [rest] * 360
    for degrees, distance in (seen or {}).items():
        ranges[(degrees + 180) % 360] = distance
    return LaserScan(
        Header(frame_id=frame), angle_min=-math.pi, angle_increment=math.tau / 360, range_max=10.0, ranges=ranges
    )


def twist(x: float = 0.0, turn: float = 0.0, y: float = 0.0) -> Twist:
    return Twist(Vector3(x, y), Vector3(z=turn))


def state(monitor: Monitor) -> dict[str, str]:
    return {value.key: value.value for value in monitor.published(SafetyMonitor.state)[-1].values}


@pytest.fixture
def passed(clock: Clock) -> Callable[..., Twist]:
    """Sends a command and whatever sensors say, for 0.1 s, and tells what came out at the end."""

    def pass_on(monitor: Monitor, command: Twist, says: dict[str, object] | None = None) -> Twist:
        for _ in range(5):
            for topic, message in (says or {"scan": scan()}).items():
                monitor.send(topic, message)  # type: ignore[arg-type]
            monitor.send("cmd_vel_raw", command)
            clock.advance(0.02)
        last: Twist = monitor.published(SafetyMonitor.command)[-1]
        return last

    return pass_on


Passed = Callable[..., Twist]


def test_zones_stop_slow_down_limit_and_approach_and_the_most_restrictive_wins(
    run_node: RunNode, passed: Passed
) -> None:
    monitor = run_node(
        SafetyMonitor,
        parameters={
            "zones.near.action": "slow_down", "zones.near.radius": 2.0, "zones.near.share": 0.5,
            "zones.door.action": "limit", "zones.door.polygon": [2.0, 1.0, 3.0, 1.0, 3.0, -1.0, 2.0, -1.0],
            "zones.door.max_speed": 0.2, "zones.side.action": "stop", "zones.side.min_points": 3,
            "zones.side.polygon": [0.5, 0.5, -0.5, 0.5, -0.5, 1.5, 0.5, 1.5],
            "zones.ahead.action": "approach", "zones.ahead.radius": 0.3, "zones.ahead.time": 4.0,
        },
    )  # fmt: skip
    assert passed(monitor, twist(0.8)) == twist(0.8)
    assert state(monitor) == {
        "action": "clear", "reason": "clear", "zone": "", "source": "", "distance": "", "time_to_collision": "",
    }  # fmt: skip
    assert passed(monitor, twist(0.8, 0.4), {"scan": scan({-90: 1.8})}) == twist(0.4, 0.2)
    assert (state(monitor)["action"], state(monitor)["zone"], state(monitor)["source"]) == ("slow", "near", "scan")
    limited = passed(monitor, twist(0.6), {"scan": scan({0: 2.8})})
    assert limited.linear.x == pytest.approx(0.2)
    assert (state(monitor)["action"], state(monitor)["zone"]) == ("limit", "door")
    assert passed(monitor, twist(0.8), {"scan": scan({90: 1.0, 91: 1.0})}) == twist(0.4), "two points are noise"
    assert passed(monitor, twist(0.8), {"scan": scan({90: 1.0, 91: 1.0, 92: 1.0})}) == twist()
    assert (state(monitor)["action"], state(monitor)["zone"]) == ("stop", "side")
    approaching = passed(monitor, twist(0.8), {"scan": scan({0: 1.5})})
    assert approaching.linear.x == pytest.approx(1.2 / 4.0, abs=0.01), "so that it takes 4 s to come there"
    assert state(monitor)["action"] == "approach"
    assert float(state(monitor)["time_to_collision"]) == pytest.approx(1.5, abs=0.02)
    assert float(state(monitor)["distance"]) == pytest.approx(1.2, abs=0.02)

    monitor.set(**{"zones.side.enabled": False, "zones.near.share": 0.25})
    assert passed(monitor, twist(0.8), {"scan": scan({90: 1.0, 91: 1.0, 92: 1.0})}).linear.x == pytest.approx(0.2)


def test_a_zone_grows_with_speed(run_node: RunNode, passed: Passed) -> None:
    zone = {"zones.front.action": "stop", "zones.front.radius": 0.4, "zones.front.time": 2.0}
    monitor = run_node(SafetyMonitor, parameters=zone)
    ahead = {"scan": scan({0: 1.5})}
    assert passed(monitor, twist(0.5), ahead) == twist(0.5)
    assert passed(monitor, twist(0.6), ahead) == twist()
    assert passed(monitor, twist(-0.6), ahead) == twist(-0.6)
    assert passed(monitor, twist(0.6, 2.0), ahead) == twist(0.6, 2.0), "the arc leads past it"


def test_the_footprint_stops_for_what_the_sector_does_not_see(run_node: RunNode, passed: Passed) -> None:
    monitor = run_node(SafetyMonitor, parameters={"sector": 0.5})
    beside = {"scan": scan({80: 0.27, 84: 0.27, 88: 0.27})}
    there = passed(monitor, twist(0.5, 2.0), beside)
    assert there.linear.x < 0.05, "a curve into a wall beside it"
    assert (state(monitor)["reason"], state(monitor)["zone"]) == ("obstacle_near", "footprint")
    assert passed(monitor, twist(0.5, -2.0), beside).linear.x > there.linear.x
    assert passed(monitor, twist(0.5), {"scan": scan({80: 0.23})}) == twist(), "half of the margin"
    assert (state(monitor)["reason"], state(monitor)["zone"]) == ("obstacle", "footprint")
    assert passed(monitor, twist(-0.5), {"scan": scan({80: 0.23})}) == twist(-0.5), "away from it"
    assert passed(monitor, twist(0.0, 2.0), beside) == twist(0.0, 2.0), "a round robot turns on the spot"


def test_a_robot_with_corners_does_not_turn_into_something(run_node: RunNode, passed: Passed) -> None:
    long = [0.5, 0.2, -0.5, 0.2, -0.5, -0.2, 0.5, -0.2]
    monitor = run_node(SafetyMonitor, parameters={"footprint.polygon": long})
    assert passed(monitor, twist(0.0, 1.0)) == twist(0.0, 1.0)
    assert 0.0 < passed(monitor, twist(0.0, 1.0), {"scan": scan({50: 0.45})}).angular.z < 0.5, "as slow as it takes"
    assert passed(monitor, twist()) == twist()
    beside = {"scan": scan({50: 0.32})}
    assert passed(monitor, twist(0.0, 1.0), beside) == twist()
    assert state(monitor)["zone"] == "footprint"
    assert passed(monitor, twist(0.0, -1.0), beside).angular.z < 0.0


def test_what_was_seen_before_the_robot_moved_is_where_it_is_now(run_node: RunNode, clock: Clock) -> None:
    zone = {"zones.front.action": "stop", "zones.front.radius": 0.9, "scan_timeout": 2.0}
    monitor = run_node(SafetyMonitor, parameters=zone)
    monitor.send("scan", scan({0: 1.2}))
    for moment in range(50):
        monitor.send("odom", Odometry(twist=TwistWithCovariance(twist(0.5))))
        monitor.send("cmd_vel_raw", twist(0.5))
        clock.advance(0.02)
        stopped = monitor.published(SafetyMonitor.command)[-1] == twist()
        assert stopped == (moment * 0.02 * 0.5 > 0.3 - 0.015) or abs(moment * 0.01 - 0.3) < 0.03


def test_each_source_is_heard_within_its_timeout_or_the_robot_stands(run_node: RunNode, clock: Clock) -> None:
    sonar = {"sources.sonar.type": "range", "sources.sonar.topic": "front/range", "sources.sonar.timeout": 0.5}
    monitor = run_node(SafetyMonitor, parameters={**sonar, "sources.sonar.x": 0.2})

    def after(seconds: float, reading: float | None) -> str:
        end = clock.monotonic() + seconds
        while clock.monotonic() < end - 1e-6:
            monitor.send("scan", scan())
            monitor.send("cmd_vel_raw", twist(0.4))
            if reading is not None:
                monitor.send("front/range", Range(field_of_view=0.3, min_range=0.02, max_range=4.0, range=reading))
            clock.advance(0.02)
        return state(monitor)["reason"]

    assert after(0.1, None) == "no_source"
    assert state(monitor)["source"] == "sonar"
    assert after(0.1, math.inf) == "clear"
    assert after(0.1, 0.1) == "obstacle"
    assert (state(monitor)["source"], state(monitor)["zone"]) == ("sonar", "footprint")
    assert after(0.1, 3.0) == "clear"
    assert after(0.46, None) == "clear"
    assert after(0.08, None) == "stale_source"
    assert after(0.1, 3.0) == "clear"
    assert after(0.6, math.nan) == "stale_source", "what says nothing is silence"


def test_a_cloud_and_a_base_without_a_laser(run_node: RunNode, passed: Passed) -> None:
    monitor = run_node(
        SafetyMonitor, parameters={"laser": False, "sources.depth.type": "pointcloud", "sources.depth.x": 0.1}
    )

    def cloud(*points: tuple[float, float, float]) -> dict[str, object]:
        return {"depth": PointCloud2.from_array(np.array(points, np.float32).reshape(-1, 3))}

    assert passed(monitor, twist(0.4), cloud()) == twist(0.4)
    assert passed(monitor, twist(0.4), cloud((0.2, 0.0, 0.0))) == twist(0.4), "that is the floor"
    assert passed(monitor, twist(0.4), cloud((0.2, 0.0, 0.3), (math.nan, 0.0, 0.3))) == twist()
    assert state(monitor)["source"] == "depth"
    assert passed(monitor, twist(0.4), cloud((5.0, 0.0, 0.3))) == twist(0.4)
    broken = PointCloud2(height=1, width=5, point_step=12, row_step=60)
    for _ in range(3):
        assert passed(monitor, twist(0.4), {"depth": broken}) in (twist(0.4), twist())
    assert state(monitor)["reason"] == "stale_source"


def test_a_scan_that_somebody_publishes_does_not_count_for_a_base_without_a_laser(
    run_node: RunNode, passed: Passed
) -> None:
    monitor = run_node(SafetyMonitor, laser=False)
    assert passed(monitor, twist(0.4), {"scan": scan({0: 0.1})}) == twist(0.4)
    assert passed(monitor, twist(0.4), {}) == twist(0.4)


@pytest.mark.parametrize("nearest", [0.02, 0.2, 0.3])
def test_what_a_sonar_cannot_measure_any_more_is_not_driven_through(
    run_node: RunNode, clock: Clock, nearest: float
) -> None:
    monitor = run_node(
        SafetyMonitor, parameters={"sources.sonar.type": "range", "sources.sonar.x": 0.2, "sources.sonar.timeout": 0.5}
    )
    x, speed = 0.0, 0.0  # something is 1 m ahead that the laser does not see
    for _ in range(300):
        away = 1.0 - x - 0.2
        monitor.send("scan", scan())
        reading = away if away >= nearest else -math.inf
        monitor.send("sonar", Range(range=reading, min_range=nearest, max_range=4.0, field_of_view=0.3))
        monitor.send("cmd_vel_raw", twist(0.5))
        monitor.send("odom", Odometry(twist=TwistWithCovariance(twist(speed))))
        clock.advance(0.02)
        speed = monitor.published(SafetyMonitor.command)[-1].linear.x
        x += speed * 0.02
    assert speed == 0.0
    assert 0.0 < 1.0 - x - 0.2 < 0.4


def test_a_decision_that_fails_stops(
    run_node: RunNode, passed: Passed, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monitor = run_node(SafetyMonitor)
    assert passed(monitor, twist(0.4)) == twist(0.4)

    def fail(*_: object) -> None:
        raise OverflowError("too much")

    monkeypatch.setattr(safety_monitor, "decide", fail)
    with pytest.raises(OverflowError):  # which a test is told of
        passed(monitor, twist(0.4))
    assert monitor.published(SafetyMonitor.command)[-1] == twist()
    assert (state(monitor)["action"], state(monitor)["reason"]) == ("stop", "failed")
    assert "the decision failed" in caplog.text
    monkeypatch.undo()
    assert passed(monitor, twist(0.4)) == twist(0.4)


@pytest.mark.parametrize("absurd", [twist(1e308), twist(0.0, 1.6e308), twist(1e16), twist(y=math.nan)])
def test_odometry_that_cannot_be_is_silence_and_forgotten(run_node: RunNode, passed: Passed, absurd: Twist) -> None:
    monitor = run_node(SafetyMonitor, command_timeout=2.0)
    good = {"odom": Odometry(twist=TwistWithCovariance(twist(0.4))), "scan": scan({0: 0.27, 60: 0.3})}
    for _ in range(30):
        passed(monitor, twist(0.4), {"odom": Odometry(twist=TwistWithCovariance(absurd)), "scan": scan()})
    assert passed(monitor, twist(0.4), good) == twist()
    assert state(monitor)["reason"] == "obstacle"


def test_decisions_that_come_late_leave_more_room(run_node: RunNode, passed: Passed) -> None:
    monitor = run_node(SafetyMonitor, warning_distance=0.3)
    ahead = {"scan": scan({0: 0.78})}
    assert passed(monitor, twist(0.6), ahead) == twist(0.6)
    monitor.node._decided -= 0.3  # as if the machine had been busy
    late = passed(monitor, twist(0.6), ahead)
    assert late.linear.x < 0.6
    for _ in range(12):
        last = passed(monitor, twist(0.6), ahead)
    assert last == twist(0.6)


def test_sensors_stand_where_tf_static_says(
    run_node: RunNode, passed: Passed, caplog: pytest.LogCaptureFixture
) -> None:
    monitor = run_node(SafetyMonitor, parameters={"use_tf": True})
    backwards = scan({0: 0.31}, frame="rear_laser")
    assert passed(monitor, twist(0.4), {"scan": backwards}) == twist()
    assert state(monitor)["reason"] == "no_scan"
    assert "counts as silent" in caplog.text
    place = Transform(Vector3(x=-0.1), Quaternion(z=1.0, w=0.0))
    monitor.send("tf_static", TFMessage([TransformStamped(Header(frame_id="base_link"), "rear_laser", place)]))
    assert passed(monitor, twist(0.4), {"scan": backwards}) == twist(0.4)
    assert passed(monitor, twist(-0.4), {"scan": backwards}).linear.x > -0.1


def test_an_emergency_stop_by_topic_and_by_button_holds_until_it_is_reset(run_node: RunNode, passed: Passed) -> None:
    monitor = run_node(SafetyMonitor, parameters={"emergency_button": 1})
    assert passed(monitor, twist(0.4)) == twist(0.4)
    monitor.send("emergency_stop", Bool(True))
    assert monitor.published(SafetyMonitor.command)[-1] == twist(), "at once"
    monitor.send("emergency_stop", Bool(False))
    assert passed(monitor, twist(0.4)) == twist()
    assert state(monitor)["reason"] == "emergency_stop"
    monitor.call("reset_emergency_stop", Trigger.Request())
    assert passed(monitor, twist(0.4)) == twist(0.4)
    monitor.send("joy", Joy(buttons=[1]))
    monitor.send("joy", Joy(buttons=[1, 0]))
    assert passed(monitor, twist(0.4)) == twist(0.4)
    monitor.send("joy", Joy(buttons=[0, 1]))
    monitor.send("joy", Joy(buttons=[0, 0]))
    assert passed(monitor, twist(0.4)) == twist()


def test_without_a_button_it_does_not_listen_to_one(run_node: RunNode) -> None:
    with pytest.raises(NotThere):
        run_node(SafetyMonitor).send("joy", Joy())


@pytest.mark.parametrize(("choice", "speed"), [("warn", 0.4), ("stop", 0.0)])
def test_who_drives_past_it_is_named_and_by_choice_stops_the_robot(
    run_node: RunNode, clock: Clock, passed: Passed, caplog: pytest.LogCaptureFixture, choice: str, speed: float
) -> None:
    monitor = run_node(SafetyMonitor, parameters={"on_rival": choice})
    assert passed(monitor, twist(0.4)) == twist(0.4)
    monitor.send("cmd_vel", twist(1.0), source="stranger")
    clock.advance(0.02)
    assert monitor.published(SafetyMonitor.command)[-1].linear.x == speed
    assert state(monitor)["rival"] == "/stranger"
    assert "/stranger commands the base too" in caplog.text
    for _ in range(11):
        passed(monitor, twist(0.4))
    assert passed(monitor, twist(0.4)) == twist(0.4), "he has gone"
    assert "/stranger commands the base no more" in caplog.text


def test_footprint_and_zones_are_shown(run_node: RunNode) -> None:
    monitor = run_node(
        SafetyMonitor, parameters={"zones.near.action": "stop", "zones.near.radius": 1.0, "base_frame": "base"}
    )
    first, footprint, near = monitor.published(SafetyMonitor.shown)[-1].markers
    assert first.action == Marker.DELETEALL
    assert (footprint.ns, near.ns, near.header.frame_id) == ("footprint", "zones/near", "base")
    assert all(math.hypot(point.x, point.y) == pytest.approx(1.0) for point in near.points)
    monitor.set(**{"zones.near.radius": 2.0})
    assert monitor.published(SafetyMonitor.shown)[-1].markers[2].points[0].x == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"zones.a.radius": 1.0}, "has no action"),
        ({"zones.a.action": "stop"}, "zones.a: a zone has a polygon or a radius$"),
        (
            {"zones.a.action": "stop", "zones.a.radius": 1.0, "zones.a.polygon": [0.0, 0.0, 1.0, 0.0, 0.0, 1.0]},
            "not both",
        ),
        ({"zones.a.action": "limit", "zones.a.radius": 1.0}, "zones.a: .* has a max_speed, a max_turn, or both"),
        ({"zones.a.action": "approach", "zones.a.radius": 1.0}, "a time of more than 0"),
        ({"zones.a.action": "stop", "zones.a.polygon": [0.0, 0.0, 1.0]}, "an even number"),
        ({"zones.a.action": "stop", "zones.a.polygon": [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0]}, "cross|flat"),
        ({"zones.a.action": "stop", "zones.a.radius": 1.0, "zones.a.sources": ["sonar"]}, "no source 'sonar'"),
        ({"footprint.polygon": [0.0, 0.0]}, "at least three corners"),
        (
            {"zones.a.action": "stop", "zones.a.radius": 1.0, "zones.a.sources": ["scan"], "laser": False},
            "no source 'scan'; there are none",
        ),
        ({"sources.scan.type": "range"}, "is the laser"),
        ({"sources.scan.topic": "front"}, "remap that to front"),
    ],
)
def test_what_contradicts_itself_is_refused(parameters: dict[str, object], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        SafetyMonitor(parameters=parameters)


def test_the_emergency_stop_is_kept_over_a_restart_by_whatever_way_it_came(
    monkeypatch: pytest.MonkeyPatch, run_node: RunNode
) -> None:
    monitor = run_node(SafetyMonitor)
    kept: dict[str, object] = {}
    monkeypatch.setattr(monitor.node.memory, "keep", kept.__setitem__)
    monitor.send("emergency_stop", Bool(True))
    assert kept == {"emergency_stop": True}
