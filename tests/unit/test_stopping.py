"""The end of a run without a process: signals, exit codes, the ordered stop and its limits, in a time that jumps."""

import asyncio
import signal
from collections.abc import Callable, Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.launch.plan import StopPlan
from robo.supervisor.changes import Changes
from robo.supervisor.needs import STOP_LIMIT, stop_limit
from robo.supervisor.stopping import HURRY, Stopping
from tests.processes import FakeJournal, FakeProcess, process_plan
from tests.virtual_time import now, run


class Desk:
    """A run that is to end; its processes stop after so many seconds."""

    def __init__(self, needs: Mapping[str, list[str]], takes: Mapping[str, float] | None = None, **stop: float) -> None:
        self.changes, self.journal = Changes(), FakeJournal()
        self.processes: dict[str, FakeProcess] = {}
        for name, needed in needs.items():
            plan = process_plan(f"/r1/{name}", {f"/r1/{one}": "ready" for one in needed})
            if name in stop:
                plan = process_plan(plan.full_name, plan.needs, stop=StopPlan(timeout=stop[name]))
            process = FakeProcess(plan, self.changes, stops_in=(takes or {}).get(name, 0.0))
            self.processes[plan.full_name] = process
        self.stopping = Stopping(self.processes, self.changes, self.journal)

    def __getitem__(self, name: str) -> FakeProcess:
        return self.processes[f"/r1/{name}"]

    def stop(self, *meanwhile: tuple[float, Callable[[], None]]) -> float:
        """Stop all; what happens meanwhile, and when. Returns how long it took, s."""

        async def stop() -> float:
            for at, what in meanwhile:
                asyncio.get_running_loop().call_later(at, what)
            await self.stopping.stop_all()
            return now()

        return run(stop())

    def signal(self, number: signal.Signals) -> Callable[[], None]:
        return lambda: self.stopping.on_signal(number)


# -- exit codes ----------------------------------------------------------------------------------


def test_who_ends_a_run_first_decides_its_exit_code() -> None:
    desk = Desk({"a": []})
    desk.stopping.finish(0)
    desk.stopping.finish(1)
    assert desk.stopping.result == 0


def test_a_run_that_ends_by_itself_has_failed_where_one_of_its_processes_has() -> None:
    fine = Desk({"a": [], "b": []})
    for process in fine.processes.values():
        process.complete()
    fine.stopping.finish(None)
    assert fine.stopping.result == 0
    bad = Desk({"a": [], "b": []})
    bad["a"].fail()
    bad["b"].complete()
    bad.stopping.finish(None)
    assert bad.stopping.result == 1
    assert bad.stopping.failed == [bad["a"]]
    waits = Desk({"a": []})
    waits["a"].wait()
    waits.stopping.finish(None)
    assert waits.stopping.result == 1, "what was never started has not done its work"


def test_what_fails_while_it_ends_does_not_count() -> None:
    desk = Desk({"a": []})
    desk.stopping.finish(None)
    desk["a"].fail()
    assert desk.stopping.failed == []
    assert desk.stopping.result == 0


# -- signals -------------------------------------------------------------------------------------


def test_the_end_comes_sooner_with_each_ctrl_c() -> None:
    desk = Desk({"a": [], "b": ["a"]}, {"a": 60.0, "b": 60.0}, a=60.0, b=60.0)
    interrupt = desk.signal(signal.SIGINT)
    interrupt()
    assert desk.stop((1.0, interrupt)) == 1.0 + HURRY
    assert desk.stopping.result == 130
    assert desk.journal.said == ["stopping; Ctrl-C again to hurry, a third time to kill"]
    assert desk["a"].signals == desk["b"].signals == [signal.SIGTERM, signal.SIGKILL]
    assert sorted(desk.journal.warned) == ["a does not end; killing it", "b does not end; killing it"]
    desk = Desk({"a": []}, {"a": 60.0}, a=60.0)
    interrupt = desk.signal(signal.SIGINT)
    assert desk.stop((0.0, interrupt), (0.1, interrupt), (0.2, interrupt)) == pytest.approx(0.2)
    assert desk["a"].signals == [signal.SIGTERM, signal.SIGKILL]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0), (signal.SIGHUP, 0)])
def test_only_an_interruption_is_an_exit_code_of_its_own(number: signal.Signals, code: int) -> None:
    desk = Desk({})
    desk.stopping.on_signal(number)
    assert desk.stopping.begun
    assert desk.stopping.result == code


def test_a_ctrl_c_after_robo_down_asks_for_patience_first() -> None:
    desk = Desk({"a": []}, {"a": 1.5})
    desk.stopping.finish(0)
    desk.stop((0.1, desk.signal(signal.SIGINT)))
    assert desk["a"].signals == []
    assert desk.stopping.result == 0


# -- the order -----------------------------------------------------------------------------------


def test_each_stops_after_those_that_need_it() -> None:
    desk = Desk({"base": [], "map": [], "drive": ["base"], "mission": ["drive", "map"]}, dict.fromkeys(["drive"], 0.3))
    assert desk.stop() == pytest.approx(0.3)
    ended = {name: process.ended for name, process in desk.processes.items()}
    assert ended == pytest.approx({"/r1/mission": 0.0, "/r1/map": 0.0, "/r1/drive": 0.3, "/r1/base": 0.3})
    assert all(process.asked == ["stop"] for process in desk.processes.values())


def test_what_was_over_already_is_not_asked() -> None:
    desk = Desk({"a": [], "b": ["a"]})
    desk["b"].fail()
    desk.stop()
    assert desk["b"].asked == []
    assert desk["a"].ended == 0.0


def test_what_is_just_being_started_is_stopped_once_it_is_there() -> None:
    desk = Desk({"a": [], "b": ["a"]})
    desk["b"].wait().spawning = True
    assert desk.stop((0.7, desk["b"].come_up)) == pytest.approx(0.7)
    assert desk["b"].told_to_stop == desk["a"].told_to_stop == pytest.approx(0.7)


def test_nothing_is_started_again_once_the_run_ends() -> None:
    desk = Desk({"a": [], "b": ["a"]}, {"b": 0.5})
    desk.stop((0.2, lambda: None))
    assert not any(process.wanted for process in desk.processes.values())


# -- the limits ----------------------------------------------------------------------------------


def test_what_does_not_end_is_killed_at_the_limit() -> None:
    desk = Desk({"stubborn": [], "fine": []}, {"stubborn": 1e9})
    assert desk.stop() == STOP_LIMIT
    assert desk.journal.warned == ["stubborn does not end; killing it"]
    assert desk["fine"].signals == []


def test_what_comes_up_after_the_limit_is_killed_at_once() -> None:
    desk = Desk({"late": []}, {"late": 1e9})
    desk["late"].wait().spawning = True
    assert desk.stop((STOP_LIMIT + 1.0, desk["late"].come_up)) == STOP_LIMIT + 1.0


def test_a_manifest_may_give_more_time_to_one_and_to_those_that_it_needs() -> None:
    needs = {"a": [], "b": ["a"], "c": []}
    assert Desk(needs).stopping.limit == STOP_LIMIT
    assert Desk(needs, a=0.1, b=0.5).stopping.limit == STOP_LIMIT
    assert Desk(needs, c=10.0).stopping.limit == 15.0
    assert Desk(needs, a=10.0, b=4.0).stopping.limit == 21.0, "one after the other"
    assert Desk({"b": ["elsewhere"]}, b=2.0).stopping.limit == 3.0, "what another host runs is not stopped here"


# -- any run -------------------------------------------------------------------------------------

NAMES = "abcdef"


@st.composite
def runs(draw: st.DrawFn) -> Desk:
    """A run with any needs, in any phase of its start, whose processes take any time to stop."""
    needs = {name: draw(st.lists(st.sampled_from(NAMES[:at] or "-"), unique=True)) for at, name in enumerate(NAMES)}
    needs["a"] = []
    takes = {name: draw(st.sampled_from([0.0, 0.1, 0.7, 3.0, 1e6])) for name in NAMES}
    stop = {name: draw(st.sampled_from([0.1, 1.0, 5.0])) for name in NAMES}
    desk = Desk(needs, takes, **stop)
    for name in NAMES:
        phase = draw(st.sampled_from(["runs", "runs", "waits", "spawns", "failed", "completed"]))
        if phase == "waits":
            desk[name].wait()
        elif phase == "spawns":
            desk[name].wait().spawning = True
        elif phase == "failed":
            desk[name].fail()
        elif phase == "completed":
            desk[name].complete()
    return desk


@given(
    desk=runs(),
    spawned=st.floats(0.0, 1.0),
    signals=st.lists(st.tuples(st.floats(0.0, 30.0), st.sampled_from([signal.SIGINT, signal.SIGTERM])), max_size=4),
)
def test_every_stop_ends_in_time_and_in_order(
    desk: Desk, spawned: float, signals: list[tuple[float, signal.Signals]]
) -> None:
    spawning = [process for process in desk.processes.values() if process.spawning]
    meanwhile = [(spawned, process.come_up) for process in spawning]
    limit = stop_limit({name: process.plan for name, process in desk.processes.items()})
    took = desk.stop(*meanwhile, *((at, desk.signal(number)) for at, number in signals))
    assert took <= limit + 1e-6
    assert not any(process.running or process.spawning for process in desk.processes.values())
    for name, process in desk.processes.items():
        if process.told_to_stop is None:
            continue
        assert process.asked == ["stop"], "it is asked once"
        for other in desk.processes.values():
            if name in other.plan.needs and other.ended is not None:
                assert other.ended <= process.told_to_stop, f"{other.label} needs {process.label}"
    killed = [process for process in desk.processes.values() if signal.SIGKILL in process.signals]
    assert len(desk.journal.warned) == len(killed), "whoever is killed is named, and nobody else"
