"""Who drives: the decisions of the multiplexer, and where they are ROS's."""

import math
from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st

from robo_services.mux import Input, Lock, choose

JOY, NAV = Input(100, 0.5), Input(10, 0.5)


def test_the_highest_that_is_heard_drives() -> None:
    assert choose({"nav": NAV._replace(age=0.1), "joy": JOY._replace(age=0.1)}, {}).driver == "joy"
    assert choose({"nav": NAV._replace(age=0.1), "joy": JOY._replace(age=0.6)}, {}).driver == "nav"
    assert choose({"nav": NAV, "joy": JOY}, {}) == ("", "silence", "nobody commands", "")
    assert choose({}, {}).reason == "silence"


def test_a_lock_keeps_out_what_is_below_it() -> None:
    inputs = {"nav": NAV._replace(age=0.0), "joy": JOY._replace(age=0.0)}
    closed = Lock(50, 0.0, closed=True, age=9.0)
    assert choose(inputs, {"pause": closed}).driver == "joy"
    assert choose(inputs, {"pause": closed}).lock == "pause"
    assert choose({"nav": inputs["nav"]}, {"pause": closed})[:2] == ("", "locked")
    assert choose(inputs, {"pause": closed._replace(priority=100)}).driver == "joy", "one of its own priority passes"
    assert choose(inputs, {"pause": closed._replace(priority=101)}).reason == "locked"
    assert choose(inputs, {"pause": closed._replace(closed=False)}).driver == "joy"
    text = choose({"nav": inputs["nav"]}, {"pause": closed, "stop": closed._replace(priority=255)}).text
    assert text == "lock stop is closed: nav must not drive"


def test_a_lock_that_is_not_heard_is_closed() -> None:
    inputs = {"nav": NAV._replace(age=0.0)}
    for age in (math.inf, 1.1, math.nan):
        silent = Lock(255, 1.0, closed=False, age=age)
        assert choose(inputs, {"alive": silent})[:2] == ("", "locked")
        assert "is not heard" in choose(inputs, {"alive": silent}).text
    assert choose(inputs, {"alive": Lock(255, 1.0, closed=False, age=1.0)}).driver == "nav"
    assert choose(inputs, {"latched": Lock(255, 0.0)}).driver == "nav", "without a timeout its silence says nothing"


@given(
    st.lists(st.tuples(st.integers(0, 255), st.floats(0.01, 10), st.floats(0, 20) | st.just(math.inf)), max_size=5),
    st.lists(st.tuples(st.integers(0, 255), st.floats(0, 10), st.booleans(), st.floats(0, 20)), max_size=4),
)
def test_nobody_drives_who_is_old_or_kept_out(
    inputs: list[tuple[int, float, float]], locks: list[tuple[int, float, bool, float]]
) -> None:
    named = {str(index): Input(*one) for index, one in enumerate(inputs)}
    held = {f"lock{index}": Lock(*one) for index, one in enumerate(locks)}
    choice = choose(named, held)
    barrier = max((lock.priority for lock in held.values() if lock.holds), default=0)
    free = [one for one in named.values() if one.age <= one.timeout and one.priority >= barrier]
    assert bool(choice.driver) == bool(free)
    if free:
        assert named[choice.driver].priority == max(one.priority for one in free)
    assert choice.text
    assert (choice.lock != "") == any(lock.holds for lock in held.values())


class Handle(NamedTuple):
    """What ROS's twist_mux keeps of a topic: its state machine in short, as its documentation and its code have it."""

    priority: int
    timeout: float
    stamp: float = -math.inf
    closed: bool = False

    def expired(self, now: float) -> bool:
        return self.timeout > 0 and now - self.stamp > self.timeout


def model_passes(name: str, topics: dict[str, Handle], locks: dict[str, Handle], now: float) -> bool:
    """Whether ROS's twist_mux passes on a command that has just come."""
    barrier = max((lock.priority for lock in locks.values() if lock.closed or lock.expired(now)), default=0)
    highest, winner = 0, ""
    for other, topic in topics.items():
        if not topic.expired(now) and topic.priority >= barrier and topic.priority > highest:
            highest, winner = topic.priority, other
    return winner == name


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["nav", "key", "joy", "pause", "alive"]),
        st.booleans(),
        st.floats(0.001, 0.8).map(lambda gap: round(gap, 3)),
    ),
    max_size=60,
)


@given(EVENTS, st.tuples(*5 * [st.integers(1, 255)]), st.tuples(*3 * [st.sampled_from([0.1, 0.5, 1.0])]))
def test_it_passes_on_what_the_model_in_ros_passes_on(
    events: list[tuple[str, bool, float]], priorities: tuple[int, ...], timeouts: tuple[float, ...]
) -> None:
    """For inputs with a timeout and a priority above 0; with the others the model does what nobody wants."""
    names = ("nav", "key", "joy", "pause", "alive")
    handles = {
        name: Handle(priority, timeout)
        for name, priority, timeout in zip(names, priorities, (*timeouts, 0.0, 0.5), strict=True)
    }
    now = 100.0
    for name, closed, gap in events:
        now += gap
        handles[name] = handles[name]._replace(stamp=now, closed=closed)
        topics = {name: handles[name] for name in names[:3]}
        locks = {name: handles[name] for name in names[3:]}
        choice = choose(
            {other: Input(one.priority, one.timeout, now - one.stamp) for other, one in topics.items()},
            {other: Lock(one.priority, one.timeout, one.closed, now - one.stamp) for other, one in locks.items()},
        )
        if name in topics:
            assert (choice.driver == name) == model_passes(name, topics, locks, now)
