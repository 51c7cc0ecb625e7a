"""The parameters of a running node, without a network."""

import threading
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Annotated, Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

import robo
from robo import READ_ONLY, ContractError, ParameterError
from robo.node.loops import checked_period
from robo.node.tuning import Tuning
from robo.node.turn import Turn
from robo.wire.reports import Setting
from robo_messages import ParameterEvent, Time
from tests.support import PATIENCE


class Gains(msgspec.Struct, frozen=True):
    p: Annotated[float, Meta(ge=0)] = 1.0
    i: float = 0.0


class Parameters(robo.Parameters):
    speed: Annotated[float, Meta(ge=-5, le=5)] = 0.5
    rate: float = 20.0
    gains: Gains = Gains()
    frame: Annotated[str, READ_ONLY] = "base_link"


class Base:
    """What tuning sees of a node."""

    full_name = "/r1/base"

    def __init__(self, settings: Mapping[str, Sequence[Setting]] | None = None) -> None:
        self.parameters: Any = Parameters()
        self.turn = Turn()
        self.timers: list[Timer] = []
        self.offered: list[float] = []
        self.changed: list[set[str]] = []
        self.refusal: BaseException | None = None
        self.failure: BaseException | None = None
        self.handled: list[tuple[str, BaseException]] = []
        self.told: list[dict[str, object]] = []
        self.tuning = Tuning(self, settings or {}, self.turn, lambda: list(self.timers), self._handler)
        self.tuning.announce = self._take

    def now(self) -> Time:
        return Time(7, 0)

    def on_parameters_changing(self, new: Any) -> None:
        self.offered.append(new.speed)
        if self.refusal is not None:
            raise self.refusal

    def on_parameters_changed(self, names: Set[str]) -> None:
        self.changed.append(set(names))
        if self.failure is not None:
            raise self.failure

    def _handler(self, callback: Callable[..., object]) -> Callable[[BaseException], None]:
        def handle(error: BaseException) -> None:
            self.handled.append((getattr(callback, "__name__", ""), error))

        return handle

    def _take(self, event: ParameterEvent) -> None:
        assert (event.stamp, event.node) == (Time(7, 0), "/r1/base")
        self.told.append({one.name: one.value for one in event.changed_parameters})


class Timer:
    """One whose period hangs on a parameter."""

    def __init__(self, period: Callable[[], float]) -> None:
        self._period = period
        self.asked: list[float] = []
        self.rescheduled = 0

    def period(self) -> float:
        self.asked.append(checked_period(self._period()))
        return self.asked[-1]

    def reschedule(self) -> None:
        self.rescheduled += 1


@pytest.fixture
def base() -> Base:
    return Base()


def test_a_change_is_offered_set_noted_and_told(base: Base) -> None:
    base.tuning.set({"speed": 2, "gains.p": 3.0})
    assert (base.parameters.speed, base.parameters.gains) == (2.0, Gains(3.0, 0.0))
    assert base.offered == [2.0]
    assert base.changed == [{"speed", "gains.p"}]
    assert base.told == [{"speed": 2.0, "gains.p": 3.0}]


def test_what_is_set_to_what_it_was_is_no_change(base: Base) -> None:
    base.tuning.set({"speed": 0.5})
    assert base.changed == [set()]
    assert base.told == []
    assert base.tuning.explain("speed") == [Setting(0.5, "declared default")]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": 6}, "speed = 6"),
        ({"sped": 1}, "no parameter 'sped'; did you mean speed"),
        ({"frame": "odom"}, "frame is read-only"),
        ({"speed": 1, "gains": {"p": -1}}, "gains.p = -1"),
    ],
)
def test_what_does_not_fit_is_refused_whole_and_costs_the_callbacks_no_time(
    base: Base, changes: dict[str, object], message: str
) -> None:
    base.turn.acquire()  # a callback runs: whoever waited for it would wait for ever
    with pytest.raises(ParameterError, match=message):
        base.tuning.set(changes)
    base.turn.release()
    assert base.parameters == Parameters()
    assert (base.offered, base.changed, base.told) == ([], [], [])


def test_a_node_may_refuse_and_its_own_mistakes_are_handled_as_a_callbacks(base: Base) -> None:
    base.refusal = ValueError("too fast for this floor")
    with pytest.raises(ParameterError, match=r"^/r1/base refuses: too fast for this floor$"):
        base.tuning.set({"speed": 2})
    assert base.handled == []
    base.refusal = KeyError("floor")
    with pytest.raises(ParameterError, match=r"^/r1/base refuses: 'floor'$"):
        base.tuning.set({"speed": 2})
    assert base.handled == [("on_parameters_changing", base.refusal)]
    assert base.parameters == Parameters()
    assert (base.changed, base.told) == ([], [])


def test_what_a_node_does_wrong_with_a_change_takes_nothing_back(base: Base) -> None:
    base.failure = RuntimeError("broken")
    base.tuning.set({"speed": 2})
    assert base.handled == [("on_parameters_changed", base.failure)]
    assert base.parameters.speed == 2.0
    assert base.told == [{"speed": 2.0}]


def test_timers_are_asked_before_anything_is_settled_and_rescheduled_after(base: Base) -> None:
    timer = Timer(base.tuning.period("rate"))
    base.timers.append(timer)
    base.tuning.set({"rate": 50.0})
    assert (timer.asked, timer.rescheduled) == ([0.02], 1)


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e300])
def test_a_period_that_no_timer_can_keep_takes_the_change_back(base: Base, rate: float) -> None:
    timer = Timer(base.tuning.period("rate"))
    base.timers.append(timer)
    with pytest.raises(ParameterError, match=r"^/r1/base: rate: a timer's rate of .*: use 1e-"):
        base.tuning.set({"rate": rate, "speed": 1.0})
    assert base.parameters == Parameters()
    assert (timer.rescheduled, base.changed, base.told) == (0, [], [])


def test_a_period_of_a_nodes_own_that_cannot_be_kept_is_a_refusal(base: Base) -> None:
    base.timers.append(Timer(lambda: base.parameters.speed))
    with pytest.raises(ParameterError, match=r"^/r1/base refuses: a timer's period of"):
        base.tuning.set({"speed": -1.0})
    assert base.parameters == Parameters()


def test_the_period_of_a_fixed_rate_is_found_wrong_at_once(base: Base) -> None:
    assert base.tuning.period(4.0)() == 0.25
    with pytest.raises(ContractError, match="a timer's rate of 0"):
        base.tuning.period(0.0)


def test_a_parameter_as_text_is_the_one_that_holds(base: Base) -> None:
    assert base.tuning.text(None) is None
    text = base.tuning.text("speed")
    assert text is not None
    base.tuning.set({"speed": 3})
    assert text() == "3.0"


def test_all_that_was_said_of_a_parameter_is_kept_and_of_what_was_set_the_last() -> None:
    before = [Setting(0.1, "config/params.yaml:3:5"), Setting(0.2, "command line")]
    base = Base({"speed": before})
    for speed in (1.0, 2.0):
        base.tuning.set({"speed": speed})
    assert base.tuning.explain("speed") == [
        Setting(0.5, "declared default"),
        *before,
        Setting(2.0, "set while running"),
    ]
    assert base.tuning.explain("gains.p") == [Setting(1.0, "declared default")]
    assert len(before) == 2, "the giver's list is left alone"


def test_a_node_that_does_not_run_changes_and_tells_nobody(base: Base) -> None:
    base.tuning.announce = None
    base.tuning.set({"speed": 1})
    base.tuning.announce = base.told.append  # type: ignore[assignment]
    base.tuning.set({"speed": 2})
    assert len(base.told) == 1, "what was changed before is old by now"


def test_a_change_within_a_change_is_told_after_it() -> None:
    class Clamping(Base):
        def on_parameters_changed(self, names: Set[str]) -> None:
            super().on_parameters_changed(names)
            if self.parameters.speed > 2:
                self.tuning.set({"speed": 2.0})  # it has the turn already

    base = Clamping()
    base.tuning.set({"speed": 3.0})
    assert base.changed == [{"speed"}, {"speed"}]
    assert base.told == [{"speed": 3.0}, {"speed": 2.0}], "whoever follows the events ends with what holds"


def test_threads_that_set_at_once_leave_what_was_told_last(base: Base) -> None:
    def set_many(begin: int) -> None:
        for number in range(begin, begin + 50):
            base.tuning.set({"speed": number / 100})

    threads = [threading.Thread(target=set_many, args=(begin,)) for begin in (0, 100, 200, 300)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    assert base.told[-1] == {"speed": base.parameters.speed}
    assert len(base.changed) == 200


@given(st.lists(st.dictionaries(st.sampled_from(["speed", "rate", "gains.p", "frame"]), st.floats(-9, 9)), max_size=6))
def test_whoever_follows_the_events_knows_the_parameters(changes: list[dict[str, object]]) -> None:
    base = Base()
    for change in changes:
        before = base.parameters
        try:
            base.tuning.set(change)
        except ParameterError:
            assert base.parameters is before
    followed: dict[str, object] = {"speed": 0.5, "rate": 20.0, "gains.p": 1.0}
    for event in base.told:
        followed |= event
    now = base.parameters
    assert followed == {"speed": now.speed, "rate": now.rate, "gains.p": now.gains.p}
    assert [base.tuning.explain(name)[-1].value for name in followed] == list(followed.values())
