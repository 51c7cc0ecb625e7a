"""What counters of a node say of how well it does: rates, losses, deadlines, callbacks."""

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.node.diagnosis import ERROR, MOST_VALUES, OK, WARN, WINDOW, Diagnosis, Look, Promises, named
from robo.wire.reports import NodeStatus, Refused, check_name, health_of
from robo_messages import DiagnosticStatus, KeyValue

PLAIN = NodeStatus(node="/r1/base", published={}, received={}, malformed={}, dropped={}, callback_errors=0)


def look(at: float, *, time: float | None = None, jumps: int = 0, **changes: Any) -> Look:
    own = {key: changes.pop(key) for key in ("longest", "longest_of") if key in changes}
    return Look(at, at if time is None else time, jumps, msgspec.structs.replace(PLAIN, **changes), **own)


def seen(*looks: Look, promises: Promises | None = None) -> tuple[DiagnosticStatus, DiagnosticStatus]:
    """The statuses after the last look."""
    diagnosis = Diagnosis(looks[0])
    found: list[DiagnosticStatus] = []
    for one in looks[1:]:
        found = diagnosis.of(one, promises or Promises())
    topics, callbacks = found
    assert (topics.name, callbacks.name) == ("topics", "callbacks")
    return topics, callbacks


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {one.key: one.value for one in status.values}


def test_rates_are_those_of_the_last_seconds() -> None:
    looks = [
        look(float(i), published={"r1/odom": 50 * max(0, i - 10)}, received={"r1/scan": 10 * i}) for i in range(21)
    ]
    topics, callbacks = seen(*looks)
    assert (topics.level, topics.message) == (OK, "10.0 Hz in, 50.0 Hz out")
    assert values(topics) == {"r1/odom published": "50.0 Hz", "r1/scan received": "10.0 Hz"}
    assert (callbacks.level, callbacks.message) == (OK, "busy for 0.0% of the time")


def test_what_every_node_publishes_is_left_out() -> None:
    promises = Promises(apart={"r1/log"})
    topics, _ = seen(look(0.0), look(1.0, published={"r1/log": 9, "r1/odom": 50}), promises=promises)
    assert values(topics) == {"r1/odom published": "50.0 Hz"}
    assert topics.message == "0.0 Hz in, 50.0 Hz out"


def test_losses_are_warnings_for_as_long_as_the_window() -> None:
    lost: dict[str, Any] = {
        "received": {"r1/scan": 7},
        "dropped": {"r1/scan": 3},
        "malformed": {"r1/scan": 1},
        "refused": {"r1/cmd": [Refused("/r1/x", 2, 0.0), Refused("/r1/y", 3, 0.0)]},
    }
    diagnosis = Diagnosis(look(0.0))
    topics = diagnosis.of(look(1.0, **lost), Promises())[0]
    assert topics.level == WARN
    assert topics.message == (
        "fell behind by 3 messages on r1/scan in 1 s; could not read 1 message on r1/scan in 1 s; "
        "left out 5 messages on r1/cmd in 1 s"
    )
    assert values(topics)["r1/scan received"] == "7.0 Hz, 3 dropped, 1 malformed"
    levels = [diagnosis.of(look(2.0 + i, **lost), Promises())[0].level for i in range(WINDOW)]
    assert levels == [WARN] * (WINDOW - 1) + [OK]


def test_who_keeps_the_newest_alone_drops_on_purpose() -> None:
    lost = look(1.0, received={"r1/cmd": 5}, dropped={"r1/cmd": 3})
    topics, _ = seen(look(0.0), lost, promises=Promises(newest_only={"r1/cmd"}))
    assert (topics.level, values(topics)["r1/cmd received"]) == (OK, "5.0 Hz, 3 dropped")


def test_a_publisher_that_promised_and_is_silent_is_told() -> None:
    promises = Promises(published={"r1/scan": 0.2})
    topics, _ = seen(look(0.0), look(1.0), promises=promises)
    assert (topics.level, topics.message) == (ERROR, "nothing published on r1/scan for 1 s, its deadline is 0.2 s")
    slow = [look(float(i), published={"r1/scan": 2 * i}) for i in range(6)]
    topics, _ = seen(*slow, promises=promises)
    assert topics.level == WARN, "too few come"
    topics, _ = seen(look(0.0), look(1.0, lifecycle="inactive"), promises=promises)
    assert topics.level == OK, "a managed node that is not active publishes nothing"


def test_a_subscription_is_told_of_silence_after_the_first_message() -> None:
    promises = Promises(received={"r1/scan": 2.5})
    looks = [look(0.0, received={"r1/scan": 0}), *(look(float(i), received={"r1/scan": 0}) for i in range(1, 9))]
    assert seen(*looks, promises=promises)[0].level == OK
    looks += [look(9.0, received={"r1/scan": 1}), *(look(float(i), received={"r1/scan": 1}) for i in range(10, 16))]
    topics, _ = seen(*looks, promises=promises)
    assert (topics.level, topics.message) == (ERROR, "nothing received on r1/scan for 6 s, its deadline is 2.5 s")


@given(
    deadline=st.floats(0.01, 20.0),
    parts=st.lists(st.floats(0.01, 1.0), min_size=1, max_size=400),
    period=st.floats(0.9, 1.5),
)
def test_who_keeps_its_deadline_is_never_told_of(deadline: float, parts: list[float], period: float) -> None:
    """Whatever the gaps are, as long as none is longer than the deadline; and silence is always told of."""
    promises = Promises(published={"t": deadline})
    moments, at = [], 0.0
    for part in parts:
        at += part * deadline
        moments.append(at)
    diagnosis, now = Diagnosis(look(0.0)), 0.0
    while now + period <= at:
        now += period
        count = sum(moment <= now for moment in moments)
        assert diagnosis.of(look(now, published={"t": count}), promises)[0].level == OK
    for _ in range(int(1.2 * deadline / period) + 3):
        now += period
        last = diagnosis.of(look(now, published={"t": len(moments)}), promises)[0]
    assert last.level in (WARN, ERROR)


@pytest.mark.parametrize("to", [1e9, -90.0, 0.0])
def test_a_clock_that_is_set_blames_nobody(to: float) -> None:
    promises = Promises(published={"t": 0.5}, received={"t": 0.5})
    first = [look(float(i), time=100.0 + i, published={"t": 10 * i}, received={"t": 10 * i}) for i in range(4)]
    diagnosis = Diagnosis(first[0])
    for i, one in enumerate(first[1:]):
        assert diagnosis.of(one, promises)[0].level == OK, i
    for i in range(8):
        n = 10 * (4 + i)
        after = look(4.0 + i, time=to + i, jumps=1, published={"t": n}, received={"t": n})
        assert diagnosis.of(after, promises)[0].level == OK, i
    stands = [look(12.0 + i, time=to + 7.0, jumps=1, published={"t": 110}, received={"t": 110}) for i in range(4)]
    levels = [diagnosis.of(one, promises)[0].level for one in stands]
    assert levels == [OK] * 4, "while simulated time stands still nothing is late"


def test_callbacks_that_raise_hang_or_hold_up_others_are_told_the_worst_first() -> None:
    begin = look(0.0, missed={"tick": 2})
    trouble = look(
        2.0, callback_errors=3, missed={"tick": 6, "beat": 0}, busy=1.5, running="plan", running_for=6.25,
        longest=1.75, longest_of="grip",
    )  # fmt: skip
    _, callbacks = seen(begin, trouble)
    assert callbacks.level == ERROR
    assert callbacks.message == (
        "plan has been running for 6.2 s; raised 3 exceptions in 2 s; grip held up the others for 1.8 s; "
        "tick skipped 4 ticks in 2 s"
    )
    assert values(callbacks) == {
        "load": "75.0%", "longest": "1750.0 ms, grip", "skipped ticks": "6", "exceptions": "3",
    }  # fmt: skip


@pytest.mark.parametrize(("skipped", "level"), [(0, OK), (10, OK), (11, WARN)])
def test_a_few_ticks_may_be_skipped(skipped: int, level: int) -> None:
    diagnosis = Diagnosis(look(0.0, time=50.0, missed={"guard": 3}))
    _, callbacks = diagnosis.of(look(2.0, time=52.0, missed={"guard": 3 + skipped}), Promises(ticks={"guard": 50.0}))
    assert (callbacks.level, values(callbacks)["skipped ticks"]) == (level, str(3 + skipped))


@pytest.mark.parametrize(("running_for", "level"), [(0.9, OK), (1.0, WARN), (4.9, WARN), (5.0, ERROR)])
def test_how_long_a_callback_may_run(running_for: float, level: int) -> None:
    _, callbacks = seen(look(0.0), look(1.0, running="plan", running_for=running_for))
    assert callbacks.level == level


def test_the_longest_callback_of_the_window_is_told_and_forgotten() -> None:
    looks = [
        look(0.0),
        look(1.0, longest=1.25, longest_of="plan"),
        *(look(float(i), longest=0.001) for i in range(2, 8)),
    ]
    diagnosis = Diagnosis(looks[0])
    levels = [diagnosis.of(one, Promises())[1].level for one in looks[1:]]
    assert levels == [WARN] * WINDOW + [OK, OK]


def test_a_managed_node_says_its_state() -> None:
    _, callbacks = seen(look(0.0), look(1.0, lifecycle="inactive"))
    assert values(callbacks)["lifecycle"] == "inactive"


def test_a_status_can_be_sent_whatever_it_quotes() -> None:
    many = [KeyValue(f"k{i}", "v" * 5000) for i in range(250)]
    told = named("/r1/base", "battery", DiagnosticStatus(WARN, message="half a pair \ud800 " + 9000 * "x", values=many))
    assert told.name == "/r1/base: battery"
    assert len(msgspec.msgpack.encode(told)) < 200_000
    assert len(told.values) == MOST_VALUES + 1
    assert told.values[-1].value == "and 150 more"
    assert told.message.startswith("half a pair ? xxx")


def test_the_health_of_a_node_is_its_worst_check() -> None:
    assert health_of([]) == (None, "")
    fine = DiagnosticStatus(OK, "/r1/base: topics", "50 Hz")
    low = DiagnosticStatus(WARN, "/r1/base: battery", "low")
    worn = DiagnosticStatus(WARN, "/r1/base: brushes", "worn")
    hot = DiagnosticStatus(ERROR, "/r1/base: motor", "hot")
    assert health_of([fine]) == ("ok", "")
    assert health_of([fine, low, worn]) == ("warn", "battery: low")
    assert health_of([low, hot, fine]) == ("error", "motor: hot")
    assert check_name(fine) == "topics"
