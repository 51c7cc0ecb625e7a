"""What a child says of itself: beats, rates, inputs, and when it hangs."""

import msgspec
import pytest

from robo.supervisor.pulse import Pulse, beat_period
from robo.supervisor.topic_watch import Flow
from robo.wire.reports import Beat, NodeStatus
from robo_messages import DiagnosticStatus
from tests.plans import topic_plan


def status(**changes: object) -> NodeStatus:
    plain = NodeStatus(node="/r1/base", published={}, received={}, malformed={}, dropped={}, callback_errors=0)
    return msgspec.structs.replace(plain, **changes)


def said(*, late: bool = False, files: list[str] | None = None, **changes: object) -> bytes:
    return msgspec.msgpack.encode(Beat(status(**changes), late=late, files=files or []))


def silent_flow(max_age: float = 0.5) -> Flow:
    return Flow(topic_plan("r1/odom", max_age=max_age), 0.0)


def alive(watchdog: float = 5.0, flow: Flow | None = None) -> Pulse:
    """The pulse of a node that was started at 0 s, ready at 1 s, and has given a beat at 2 s."""
    pulse = Pulse(watchdog, (), lambda key: flow if key == "odom" else None, 0.0)
    pulse.became_ready(1.0)
    pulse.hear(said(published={"odom": 10}, received={"scan": 4, "map": 0}), 2.0)
    return pulse


@pytest.mark.parametrize(("watchdog", "period"), [(0.0, 1.0), (100.0, 1.0), (4.0, 1.0), (1.0, 0.25)])
def test_beats_come_often_enough_for_the_watchdog(watchdog: float, period: float) -> None:
    assert beat_period(watchdog) == period


def test_a_node_hangs_when_its_beats_cease() -> None:
    pulse = alive()
    assert pulse.hang(7.0) is None
    assert pulse.hang(7.2) == "hangs: no sign of life for 5.2 s"
    pulse.hear(said(), 7.3)
    assert pulse.hang(12.0) is None


def test_what_has_never_given_a_beat_does_not_hang() -> None:
    pulse = Pulse(5.0, (), lambda _: None, 0.0)
    pulse.became_ready(1.0)
    pulse.hear(b"\xc1 not a beat", 2.0)
    pulse.hear(b"\x01", 2.0)
    assert pulse.hang(100.0) is None
    assert alive(watchdog=0.0).hang(100.0) is None, "nor does what has no watchdog"


def test_the_callback_that_does_not_return_is_named_by_a_late_beat() -> None:
    pulse = alive()
    assert pulse.hear(said(late=True, running="work", running_for=3.0), 5.0) is not None
    assert pulse.held_up is not None
    assert (pulse.held_up.running, pulse.held_up.running_for) == ("work", 3.0)
    assert pulse.hang(7.5) == "hangs: no sign of life for 5.5 s; work does not return"
    pulse.hear(said(), 8.0)
    assert pulse.held_up is None


def test_nobody_is_blamed_while_the_supervisor_slept() -> None:
    pulse = alive()
    pulse.excuse_silence(60.0)
    assert pulse.hang(64.0) is None
    assert pulse.hang(66.0) == "hangs: no sign of life for 6.0 s"


def test_rates_are_counted_between_beats_and_forgotten_when_they_cease() -> None:
    pulse = alive()
    assert pulse.rates(2.0) == ({}, {})
    pulse.excuse_silence(3.9)
    pulse.hear(said(published={"odom": 110, "new": 3}, received={"scan": 14}), 4.0)
    assert pulse.rates(4.5) == ({"odom": 50.0, "new": 1.5}, {"scan": 5.0})
    assert pulse.rates(7.5) == ({}, {})


def test_the_age_of_an_input_is_that_of_its_last_message() -> None:
    pulse = alive()
    pulse.hear(said(received={"scan": 4, "map": 0}, malformed={"scan": 1}, dropped={"map": 2}, callback_errors=3), 5.0)
    scan, map_ = pulse.inputs(6.0)
    assert (scan.topic, scan.received, scan.age, scan.malformed, scan.dropped) == ("scan", 4, 4.0, 1, 0)
    assert (map_.topic, map_.received, map_.age, map_.dropped) == ("map", 0, 6.0, 2), "since the start"
    assert pulse.callback_errors == 3


def test_a_promise_counts_once_its_topics_had_the_time_to_come() -> None:
    pulse = alive(flow=silent_flow())
    assert pulse.problem(2.9) is None
    assert pulse.problem(3.1) == "nothing on r1/odom for 2.1 s", "since it was ready"


def test_a_silent_topic_means_a_hang_from_readiness_on() -> None:
    flow = silent_flow()
    pulse = alive(watchdog=2.0, flow=flow)
    assert pulse.silent_topic(2.9) is None
    assert pulse.silent_topic(3.5) == "hangs: nothing on r1/odom for 2.5 s", "it was not ready before"
    flow.add(3.6)
    assert pulse.silent_topic(3.7) is None
    assert alive(watchdog=0.0, flow=silent_flow()).silent_topic(50.0) is None


def test_a_node_that_says_itself_why_it_is_silent_does_not_hang() -> None:
    pulse = alive(watchdog=2.0, flow=silent_flow())

    def tells(name: str, level: int) -> None:
        check = DiagnosticStatus(level=level, name=f"/r1/base: {name}", message="no port")
        pulse.hear(said(published={"odom": 10}, checks=[check]), 9.0)

    for name, level in (("topics", DiagnosticStatus.ERROR), ("board", DiagnosticStatus.WARN)):
        tells(name, level)
        assert (pulse.silent_topic(9.1), pulse.problem(9.1)) == (
            "hangs: nothing on r1/odom for 8.1 s", "nothing on r1/odom for 8.1 s",
        )  # fmt: skip
    tells("board", DiagnosticStatus.ERROR)
    assert (pulse.silent_topic(9.1), pulse.problem(9.1)) == (None, "nothing on r1/odom for 8.1 s; board: no port")
    assert pulse.hang(11.5) == "hangs: no sign of life for 2.5 s", "what it said does not excuse its beats"
    tells("board", DiagnosticStatus.OK)
    assert (pulse.silent_topic(10.9), pulse.problem(10.9)) == (None, "nothing on r1/odom for 9.9 s"), "it may begin now"
    assert pulse.silent_topic(11.4) is None, "its check is asked once a second, and its beats come twice"
    assert pulse.silent_topic(11.6) == "hangs: nothing on r1/odom for 2.6 s"


def test_a_slow_topic_has_its_time_after_a_restart() -> None:
    flow = Flow(topic_plan("r1/odom", min_rate=0.5), 0.0)
    pulse = Pulse(5.0, {"odom": ""}, lambda _: flow, 70.0)
    pulse.became_ready(70.0)
    problems = {}
    for quarter in range(4 * 90):
        now = quarter / 4
        is_down, is_slow = 50 <= now < 71, now >= 80
        if now % (4 if is_slow else 2) == 1 and not is_down:
            flow.add(now)
        flow.mark(now)
        if now >= 70:
            problems[now] = pulse.problem(now)
    assert not any(problem for now, problem in problems.items() if now < 80), "the time without a publisher counts not"
    assert problems[89.0] == "r1/odom comes at 0.3 Hz, promised are 0.5"


def test_a_publisher_that_comes_back_does_not_excuse_another() -> None:
    flow = Flow(topic_plan("r1/odom", max_age=1.0), 0.0)
    old, new = (Pulse(5.0, {"odom": ""}, lambda _: flow, begin) for begin in (0.0, 10.0))
    old.became_ready(0.0)
    new.became_ready(10.0)
    assert new.problem(12.5) == "nothing on r1/odom for 2.5 s"
    assert old.problem(12.5) == "nothing on r1/odom for 12.5 s"


def test_a_promise_that_is_longer_than_the_watchdog_is_waited_for() -> None:
    pulse = alive(watchdog=2.0, flow=silent_flow(max_age=8.0))
    assert pulse.silent_topic(8.9) is None
    assert pulse.silent_topic(9.1) == "hangs: nothing on r1/odom for 8.1 s"


def test_a_command_is_held_to_what_its_manifest_says_that_it_publishes() -> None:
    pulse = Pulse(5.0, {"odom": "nav/Odometry"}, lambda _: silent_flow(), 0.0)
    pulse.became_ready(0.0)
    assert pulse.problem(4.0) == "nothing on r1/odom for 4.0 s"


def test_the_files_of_a_node_come_with_its_first_beat() -> None:
    beat = Pulse(5.0, (), lambda _: None, 0.0).hear(said(files=["a.py"]), 1.0)
    assert beat is not None
    assert beat.files == ["a.py"]


def test_that_nothing_came_before_it_was_ready_is_not_held_against_it() -> None:
    flow = Flow(topic_plan("r1/odom", min_rate=0.2), 0.0)  # one in 5 s: looked at over 15 s
    flow.add(1.0)
    for second in range(60):
        flow.mark(float(second))
    pulse = Pulse(5.0, (), lambda key: flow if key == "odom" else None, 57.0)
    pulse.became_ready(58.0)
    pulse.hear(said(published={"odom": 0}), 59.0)
    assert flow.problem(60.5) == "nothing on r1/odom for 59.5 s"
    assert pulse.problem(60.5) is None, "it has been ready for 2.5 s"
    assert pulse.problem(73.5) == "nothing on r1/odom for 15.5 s"


def test_a_beat_between_two_others_makes_no_rate_of_its_own() -> None:
    pulse = Pulse(5.0, (), lambda _: None, 0.0)
    for now, published in ((1.0, 10), (2.0, 20), (2.001, 24)):
        pulse.hear(said(published={"odom": published}), now)
    assert pulse.rates(2.1) == ({"odom": 10.0}, {})


def test_a_hook_of_a_managed_node_may_take_as_long_as_a_start() -> None:
    pulse = Pulse(5.0, (), lambda _: None, 0.0, hooks=60.0)
    pulse.hear(said(lifecycle="configuring"), 1.0)
    pulse.hear(said(lifecycle="configuring", running="on_configure", late=True), 50.0)
    assert pulse.hang(61.0) is None
    assert pulse.hang(61.1) == "hangs: no sign of life for 60.1 s; on_configure does not return"
    pulse.hear(said(lifecycle="inactive"), 62.0)
    assert pulse.hang(67.1) == "hangs: no sign of life for 5.1 s"


@pytest.mark.parametrize(("watchdog", "hooks"), [(0.0, 60.0), (5.0, 0.0)])
def test_a_hook_may_take_for_ever_where_that_is_said(watchdog: float, hooks: float) -> None:
    pulse = Pulse(watchdog, (), lambda _: None, 0.0, hooks)
    pulse.hear(said(lifecycle="activating"), 1.0)
    assert pulse.hang(10_000.0) is None


def test_it_is_as_well_as_it_said_last_and_stale_once_it_says_nothing() -> None:
    low = DiagnosticStatus(DiagnosticStatus.WARN, "/r1/base: battery", "low")
    pulse = Pulse(5.0, (), lambda _: None, 0.0)
    assert pulse.health(10.0) == (None, ""), "it has never said anything"
    pulse.hear(said(), 11.0)
    assert (pulse.health(11.5), pulse.checks) == ((None, ""), [])
    pulse.hear(said(checks=[low]), 12.0)
    assert pulse.health(14.0) == ("warn", "battery: low")
    assert pulse.checks == [low]
    assert pulse.health(15.5) == ("stale", "has said nothing for 3.5 s")
    pulse.hear(said(late=True, running="plan", running_for=4.0, checks=[]), 16.0)
    assert pulse.health(17.0) == (None, ""), "what it says while a callback holds its beat back is newer"
