"""Which containers the keeper starts again: no engine, no time passes."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.errors import EngineError
from robo.export.compose.engine import Container, ContainerEvent
from robo.export.compose.keeper import DELAY, Keeper, Kills


class FakeEngine:
    """Containers by name; tells events as if they had happened."""

    def __init__(self, containers: Mapping[str, Container], *events: str) -> None:
        self.containers = dict(containers)
        self.started: list[str] = []
        self._events = events

    def events(self, project: str) -> Iterator[ContainerEvent | None]:
        assert project == "mine"
        yield None
        yield from map(happening, self._events)

    def container(self, container: str) -> Container | None:
        if container == "broken":
            raise EngineError("the engine does not answer")
        return self.containers.get(container)

    def start(self, container: str) -> bool:
        self.started.append(container)
        return container != "going"


def happening(line: str) -> ContainerEvent:
    """`web kill 9`, `web die`: what happens to a container."""
    container, action, *signal = line.split()
    return ContainerEvent(container, f"the {container}", action, signal[0] if signal else None)


def kept(engine: FakeEngine, ready_file: Path | None = None, *, at_once: bool = True) -> tuple[list[str], list[float]]:
    """What a keeper says while the engine tells, and after which delays it looks."""
    said: list[str] = []
    delays: list[float] = []
    waiting: list[Callable[[], None]] = []

    def later(seconds: float, work: Callable[[], None]) -> None:
        delays.append(seconds)
        waiting.append(work)
        if at_once:
            work()

    Keeper(engine, "mine", said.append, later).run(ready_file)
    assert said.pop(0) == "keeps the containers of mine running by their restart policies"
    return said, delays


@pytest.mark.parametrize("policy", ["on-failure", "always"])
def test_what_is_killed_by_hand_is_started_after_a_moment(policy: str) -> None:
    engine = FakeEngine({"web": Container(False, policy)}, "web kill 9", "web die")
    assert kept(engine) == (
        [f"the web was killed and is started again: its restart policy is {policy}"],
        [DELAY],
    )
    assert engine.started == ["web"]


@pytest.mark.parametrize(
    ("container", "told"),
    [
        (Container(False, "no"), ["the web was killed and stays down: its restart policy is no"]),
        (
            Container(False, "unless-stopped"),
            ["the web was killed and stays down: its restart policy is unless-stopped"],
        ),
        (Container(True, "always"), []),  # somebody has been quicker
        (None, []),  # it was removed
    ],
)
def test_what_stays_down(container: Container | None, told: list[str]) -> None:
    engine = FakeEngine({} if container is None else {"web": container}, "web kill 9", "web die")
    assert kept(engine)[0] == told
    assert engine.started == []


@pytest.mark.parametrize(
    "events",
    [
        ("web die",),  # it crashed: its engine sees to that
        ("web kill 15", "web die"),
        ("web kill 15", "web kill 9", "web die"),  # `docker stop` lost its patience
        ("web kill 9",),  # and lives on
        ("web start", "web destroy"),
    ],
)
def test_what_was_not_killed_by_hand_is_left_alone(events: tuple[str, ...]) -> None:
    assert kept(FakeEngine({"web": Container(False, "always")}, *events)) == ([], [])


def test_a_container_that_is_removed_in_the_meantime_is_not_missed() -> None:
    engine = FakeEngine({"going": Container(False, "always")}, "going kill 9", "going die")
    assert kept(engine)[0] == []
    assert engine.started == ["going"]


def test_an_engine_that_fails_is_told_and_the_others_are_kept() -> None:
    events = "broken kill 9", "broken die", "web kill 9", "web die"
    engine = FakeEngine({"web": Container(False, "always")}, *events)
    assert kept(engine)[0][0] == "the broken was killed and stays down: the engine does not answer"
    assert engine.started == ["web"]


def test_nothing_is_done_before_the_delay_is_over(tmp_path: Path) -> None:
    engine = FakeEngine({"web": Container(False, "always")}, "web kill 9", "web die")
    assert kept(engine, tmp_path / "ready", at_once=False) == ([], [DELAY])
    assert (tmp_path / "ready").exists()
    assert engine.started == []


ACTIONS = st.sampled_from(["kill 9", "kill 9", "kill 15", "kill 2", "die", "start"])


@given(st.lists(st.tuples(st.sampled_from("ab"), ACTIONS), max_size=20))
def test_a_kill_is_one_whatever_happens_to_others(history: list[tuple[str, str]]) -> None:
    kills = Kills()
    shown = [(name, action, kills.shows(happening(f"{name} {action}"))) for name, action in history]
    for wanted in "ab":
        own = [(action, is_kill) for name, action, is_kill in shown if name == wanted]
        since: list[str] = []
        for action, is_kill in own:
            assert is_kill == (action == "die" and bool(since) and set(since) == {"kill 9"})
            since = [*since, action] if action.startswith("kill") else []
