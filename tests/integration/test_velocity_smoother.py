"""The velocity smoother as a node: what it sends, and when it is silent."""

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec
import pytest
import zenoh

from robo import ParameterError
from robo.testing import Clock, NodeUnderTest, RunNode
from robo.testing.heard import Heard
from robo_messages import Clock as SaidClock
from robo_messages import Odometry, Time, Trigger, Twist, TwistWithCovariance, Vector3
from robo_services.diff_drive_sim import DiffDriveSim
from robo_services.safety_monitor import SafetyMonitor
from robo_services.smoothing import Limits, Motion, twist_of
from robo_services.velocity_smoother import VelocitySmoother
from tests.support import eventually, is_heard

PERIOD = 0.05


def twist(x: float = 0.0, turn: float = 0.0) -> Twist:
    return Twist(Vector3(x), Vector3(z=turn))


def odometry(x: float) -> Odometry:
    return Odometry(twist=TwistWithCovariance(twist(x)))


def drive(
    smoother: NodeUnderTest[VelocitySmoother],
    clock: Clock,
    command: Twist,
    seconds: float,
    *,
    age: float = 0.0,
    measured: float | None = None,
    topic: str = "cmd_vel",
) -> None:
    """Command it before each of its ticks, and say where the base is."""
    for _ in range(round(seconds / PERIOD)):
        smoother.send(topic, command, age=age)
        if measured is not None:
            smoother.send("odom", odometry(measured))
        clock.advance(PERIOD)


def speeds(smoother: NodeUnderTest[VelocitySmoother]) -> list[float]:
    return [sent.linear.x for sent in smoother.published(VelocitySmoother.smoothed)]


def steps(values: Sequence[float]) -> list[float]:
    return [b - a for a, b in pairwise(values)]


def test_it_ramps_up_and_when_commands_end_down_and_is_silent(run_node: RunNode, clock: Clock) -> None:
    smoother = run_node(VelocitySmoother, parameters={"linear.max_acceleration": 1.0, "linear.max_deceleration": 2.0})
    clock.advance(1.0)
    assert speeds(smoother) == [], "nobody has commanded anything"

    drive(smoother, clock, twist(0.4), 1.0)
    up = speeds(smoother)
    assert up[:8] == pytest.approx([0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4])
    assert up[8:] == 12 * [0.4]

    smoother.clear()
    clock.advance(10.0)
    down = speeds(smoother)
    assert down[:5] == 5 * [0.4], "the last command is younger than velocity_timeout"
    assert down[5:] == pytest.approx([0.3, 0.2, 0.1, 0.0])
    assert down[-1] == 0.0, "once, and nothing more"

    smoother.clear()
    drive(smoother, clock, twist(0.4), 0.4)
    clock.advance(0.4)
    drive(smoother, clock, twist(0.4), 0.1)
    assert speeds(smoother)[:2] == pytest.approx([0.05, 0.1]), "it begins anew"
    assert speeds(smoother)[-4:] == pytest.approx([0.2, 0.1, 0.15, 0.2]), "also on its way down"


def test_jerk_is_limited(run_node: RunNode, clock: Clock) -> None:
    smoother = run_node(VelocitySmoother, parameters={"linear.max_jerk": 4.0, "linear.max_acceleration": 1.0})
    drive(smoother, clock, twist(0.5), 2.0)
    clock.advance(2.0)
    ramp = speeds(smoother)
    accelerations = [change / PERIOD for change in steps([0.0, *ramp])]
    assert max(ramp) == 0.5
    assert ramp[-1] == 0.0
    assert max(map(abs, steps([0.0, *accelerations]))) == pytest.approx(4.0 * PERIOD)


def test_commands_keep_their_age_and_what_is_its_own_has_none(run_node: RunNode, clock: Clock) -> None:
    """Whoever stands behind counts from the commander's last word, and lets the way down end."""
    monitor = run_node(SafetyMonitor, laser=False, command_timeout=0.2)
    smoother = run_node(
        VelocitySmoother,
        remap={"cmd_vel": "wanted", "cmd_vel_smoothed": "cmd_vel_raw"},
        parameters={"velocity_timeout": 0.4, "linear.max_deceleration": 1.0},
    )

    def passed(age: float) -> float:
        for _ in range(10):
            smoother.send("wanted", twist(0.5), age=age)
            clock.advance(PERIOD)
        passed_on: Twist = monitor.published("cmd_vel")[-1]
        return passed_on.linear.x

    assert passed(0.0) == 0.5
    assert passed(0.25) == 0.0, "for the smoother it is young enough, for the monitor it is not"
    assert speeds(smoother)[-1] == 0.5
    assert passed(0.0) == 0.5
    monitor.clear()
    clock.advance(1.2)
    slowing = [sent.linear.x for sent in monitor.published("cmd_vel")]
    assert 0.0 in slowing[: slowing.index(pytest.approx(0.45))], "the monitor was first, as its timeout is shorter"
    assert slowing[-1] == 0.0


@pytest.mark.parametrize("age", [0.31, 5.0, 1e9])
def test_what_is_old_is_no_command(run_node: RunNode, clock: Clock, age: float) -> None:
    smoother = run_node(VelocitySmoother)
    drive(smoother, clock, twist(0.4), 0.5, age=age)
    assert speeds(smoother) == []


@pytest.mark.parametrize(("unstamped", "reached"), [(True, [0.4]), (False, [])])
def test_what_has_no_stamp_counts_from_its_arrival_or_not_at_all(
    run_node: RunNode, clock: Clock, robo_session: zenoh.Session, unstamped: bool, reached: list[float]
) -> None:
    smoother = run_node(VelocitySmoother, unstamped=unstamped)
    for _ in range(20):
        robo_session.put("cmd_vel", '{"linear": {"x": 0.4}}', encoding="application/json")
        clock.advance(PERIOD)
    assert speeds(smoother)[-1:] == reached
    clock.advance(1.0)
    assert speeds(smoother)[-1:] == [0.0 for _ in reached]


def test_bad_commands_count_as_silence_and_are_told_once(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    smoother = run_node(VelocitySmoother)
    drive(smoother, clock, twist(0.4), 1.0)
    for odd in (twist(math.nan), twist(math.inf), twist(turn=-math.inf), Twist(angular=Vector3(x=math.nan))):
        drive(smoother, clock, odd, 0.25)
    drive(smoother, clock, twist(math.nan), 1.0)
    sent = speeds(smoother)
    assert all(map(math.isfinite, sent))
    assert sent[-1] == 0.0
    assert sum("NaN or an infinity" in text for text in caplog.messages) == 1
    clock.advance(5.0)
    smoother.send("cmd_vel", twist(math.nan))
    assert "NaN or an infinity, 41 so far" in caplog.messages[-1]


def test_all_axes_are_smoothed_and_those_that_are_not_there_stay_out(run_node: RunNode, clock: Clock) -> None:
    smoother = run_node(VelocitySmoother, scale_velocities=True)
    drive(smoother, clock, Twist(Vector3(0.4, 0.3, 9.0), Vector3(9.0, 9.0, 1.6)), 1.0)
    sent = smoother.published(VelocitySmoother.smoothed)
    assert sent[-1] == twist(0.4, 1.6)
    assert [one.angular.z for one in sent] == pytest.approx([4 * one.linear.x for one in sent]), "on its curve"
    assert all(one == twist(one.linear.x, one.angular.z) for one in sent)


def test_a_closed_loop_begins_each_step_where_the_base_is(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    smoother = run_node(VelocitySmoother, feedback="closed_loop", parameters={"linear.max_acceleration": 1.0})
    drive(smoother, clock, twist(0.4), 0.5, measured=0.1)
    assert speeds(smoother) == pytest.approx(10 * [0.15]), "the base does not get on"
    assert "odometry" not in caplog.text

    smoother.clear()
    drive(smoother, clock, twist(0.4), 0.5)
    assert speeds(smoother)[-1] == 0.4, "without odometry it goes by itself"
    assert sum("no odometry on odom that is newer than 0.25 s" in text for text in caplog.messages) == 1

    smoother.send("odom", odometry(math.nan))
    drive(smoother, clock, twist(0.0), 0.5, measured=0.4)
    assert speeds(smoother)[-1] == 0.0, "a base that does not obey is told to stand all the same"


@pytest.mark.parametrize(("feedback", "gained"), [("closed_loop", 0.2), ("open_loop", 0.4)])
def test_a_base_that_was_held_up_begins_anew_in_a_closed_loop(
    run_node: RunNode, clock: Clock, feedback: str, gained: float
) -> None:
    """In an open one it is told its full speed at once."""
    base = run_node(DiffDriveSim, linear_acceleration=10.0)
    monitor = run_node(SafetyMonitor)
    smoother = run_node(
        VelocitySmoother,
        remap={"cmd_vel": "wanted", "cmd_vel_smoothed": "cmd_vel_raw"},
        parameters={"feedback": feedback, "linear.max_acceleration": 1.0},
    )

    def go(seconds: float) -> list[float]:
        base.clear()
        drive(smoother, clock, twist(0.4), seconds, topic="wanted")
        return [sent.twist.twist.linear.x for sent in base.published("odom")]

    assert go(2.0)[-1] == pytest.approx(0.4)
    monitor.call("emergency_stop", Trigger.Request())
    assert go(1.0)[-1] == 0.0
    monitor.call("reset_emergency_stop", Trigger.Request())
    again = go(2.0)
    assert again[-1] == pytest.approx(0.4)
    in_200_ms = max(b - a for a, b in zip(again, again[10:], strict=False))
    assert in_200_ms == pytest.approx(gained, abs=0.06)  # the ticks of both nodes do not go together


def test_it_follows_parameters_that_change_while_it_drives(run_node: RunNode, clock: Clock) -> None:
    smoother = run_node(VelocitySmoother, parameters={"linear.max_deceleration": 2.0})
    drive(smoother, clock, twist(0.5), 1.0)
    smoother.clear()
    smoother.set(**{"linear.max_velocity": 0.2})
    drive(smoother, clock, twist(0.5), 0.2)
    assert speeds(smoother) == pytest.approx([0.4, 0.3, 0.2, 0.2]), "within its deceleration"

    smoother.clear()
    smoother.set(smoothing_frequency=100.0, velocity_timeout=0.1)
    clock.advance(1.0)
    down = speeds(smoother)
    assert max(map(abs, steps(down))) == pytest.approx(0.02)
    assert down[-1] == 0.0

    for refused in ({"linear.max_jerk": 1e-300}, {"angular.max_jerk": 0.009}, {"lateral.max_acceleration": 0.0}):
        with pytest.raises(ParameterError, match=r"max_jerk|max_acceleration"):
            smoother.set(**refused)
    with pytest.raises(ParameterError, match=r"use 0 for no limit, or at least 0\.01"):
        run_node(VelocitySmoother, name="another", parameters={"linear.max_jerk": 0.001})


def test_the_deadband_is_zero_and_ends_the_way_down(run_node: RunNode, clock: Clock) -> None:
    smoother = run_node(VelocitySmoother, parameters={"linear.deadband": 0.18, "linear.max_deceleration": 1.0})
    drive(smoother, clock, twist(0.4), 1.0)
    clock.advance(1.0)
    sent = speeds(smoother)
    assert all(speed == 0.0 or speed >= 0.18 for speed in sent)
    assert sent[-2:] == pytest.approx([0.2, 0.0]), "one zero, although the ramp ends later"
    smoother.clear()
    smoother.set(**{"linear.max_acceleration": 1.0})
    drive(smoother, clock, twist(0.4), 0.2)
    assert speeds(smoother) == pytest.approx([0.0, 0.0, 0.0, 0.2]), "it stood"


def test_time_that_was_missed_makes_no_jump(run_node: RunNode, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    smoother = run_node(VelocitySmoother, parameters={"linear.max_acceleration": 1.0, "velocity_timeout": 2.0})

    def ponder(motion: Motion, limits: Limits) -> Twist:
        smoother.node.sleep(0.52)  # the next tick comes late then, and the one after it soon
        return twist_of(motion, limits)

    drive(smoother, clock, twist(0.4), 0.1)
    monkeypatch.setattr("robo_services.velocity_smoother.twist_of", ponder)
    drive(smoother, clock, twist(0.4), PERIOD)
    monkeypatch.undo()
    drive(smoother, clock, twist(0.4), 1.0)
    assert speeds(smoother)[:5] == pytest.approx([0.05, 0.1, 0.15, 0.2, 0.23])
    assert max(steps(speeds(smoother))) == pytest.approx(0.05)


def test_it_leaves_a_standing_robot(run_node: RunNode, clock: Clock) -> None:
    smoother = run_node(VelocitySmoother)
    drive(smoother, clock, twist(0.4), 1.0)
    smoother.close()
    assert speeds(smoother)[-1] == 0.0


def test_it_goes_by_simulated_time(session: zenoh.Session, other: zenoh.Session) -> None:
    with VelocitySmoother(parameters={"use_sim_time": True, "linear.max_acceleration": 1.0}, session=session):
        heard = Heard(other, "cmd_vel_smoothed")
        clock = other.declare_publisher("clock")
        eventually(lambda: is_heard(clock), "it listens to /clock")
        time = 100.0

        def reaches(wanted: float, *, commanded: bool) -> list[float]:
            heard.clear()

            def sent() -> list[float]:
                return [one.linear.x for one in heard.messages("cmd_vel_smoothed")]

            def there() -> bool:
                nonlocal time
                time += 0.01
                clock.put(msgspec.msgpack.encode(SaidClock(Time.from_seconds(time))))
                if commanded:
                    other.put("cmd_vel", msgspec.msgpack.encode(twist(0.4)))
                return sent()[-1:] == [wanted]

            eventually(there, f"{wanted} m/s")
            return sent()

        ramp = reaches(0.4, commanded=True)
        assert len(ramp) >= 8
        assert max(steps([0.0, *ramp])) <= 0.05 + 1e-9
        time = 1.0  # what was commanded before says nothing any more
        reaches(0.0, commanded=False)
        reaches(0.4, commanded=True)
        heard.close()
