"""Which run a command is for, and which of its processes, by what somebody has typed."""

from collections.abc import Sequence
from typing import Any

import pytest

from robo.errors import NodeNotFound, RunError, UsageError
from robo.tools import logs, runs
from robo.tools.runs import Target
from robo.wire.keys import SupervisorToken
from robo.wire.reports import ProcessName, ProcessStatus
from tests.reports import process

SESSION: Any = None
"""Nobody asks it anything."""


FLEET = [process("fleet", f"/{robot}/{node}", "drive") for robot in ("r1", "r2") for node in ("base", "tracker")]
SINGLE = [process("r9", "/r9/base"), process("r9", "/r9/lamp")]


def there_are(monkeypatch: pytest.MonkeyPatch, *found: Sequence[ProcessStatus]) -> None:
    """These runs, as their supervisors tell."""
    every = [status for one in found for status in one]

    def processes(_: object, robot: str | None = None, timeout: float = 0.0) -> list[ProcessStatus]:
        del timeout
        mine = [one for one in every if robot is None or one.robot == robot or one.name.is_within(robot)]
        if robot is not None and not mine:
            raise RunError(f"no supervisor runs a robot {robot}")
        return mine

    def supervisors(_: object, robot: str) -> list[SupervisorToken]:
        return [SupervisorToken(robot, 1, "h")] if any(one.robot == robot for one in every) else []

    monkeypatch.setattr(runs, "processes", processes)
    monkeypatch.setattr(runs, "supervisors", supervisors)


def test_the_only_run_is_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    there_are(monkeypatch, FLEET)
    assert runs.target_of(SESSION, None) == Target("fleet")
    there_are(monkeypatch)
    with pytest.raises(RunError, match="no supervisor answers"):
        runs.target_of(SESSION, None)


def test_a_robot_is_a_run_or_a_part_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    there_are(monkeypatch, FLEET, SINGLE)
    assert runs.target_of(SESSION, "r9") == Target("r9")
    assert runs.target_of(SESSION, "fleet") == Target("fleet")
    assert runs.target_of(SESSION, "r2") == Target("fleet", "r2")
    with pytest.raises(RunError, match="no supervisor runs a robot r7"):
        runs.target_of(SESSION, "r7")
    there_are(monkeypatch, FLEET, [process("other", "/r2/base")])
    with pytest.raises(UsageError, match="r2 is in several runs: fleet, other"):
        runs.target_of(SESSION, "r2")


@pytest.mark.parametrize(
    ("words", "run"),
    [
        (["/r9/lamp"], "r9"),
        (["r1/base", "/r2/base"], "fleet"),
        (["r1"], "fleet"),
        (["base"], None),
        (["/r9/base", "/r1/base"], None),
        (["/r9/nothing"], None),
        ([], None),
    ],
)
def test_of_several_runs_words_may_say_which(
    words: list[str], run: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    there_are(monkeypatch, FLEET, SINGLE)
    if run is not None:
        assert runs.target_of(SESSION, None, words) == Target(run)
        return
    with pytest.raises(UsageError, match="several robots run: fleet, r9; say --robot-name"):
        runs.target_of(SESSION, None, words)


# -- lines of output -------------------------------------------------------------------------------

PROCESSES = [
    ProcessName("r1", "/r1/base", "drive"),
    ProcessName("r1", "/r1/arm/grip", "arm/hand"),
    ProcessName("r1", "/lamp", ""),
]


@pytest.mark.parametrize(
    ("words", "labels"),
    [
        ([], set()),
        (["base"], {"base"}),
        (["/r1/base", "grip"], {"base", "arm/grip"}),
        (["hand"], {"arm/grip"}),
        (["arm"], {"arm/grip"}),
        (["/lamp"], {"lamp"}),
        (["r1"], {"base", "arm/grip"}),
        (["robo"], {"robo"}),
    ],
)
def test_words_mean_labels(words: list[str], labels: set[str]) -> None:
    assert logs.labels_meant(words, PROCESSES) == labels


def test_what_a_shared_process_prints_is_told_with_its_nodes() -> None:
    team = [ProcessName("r1", f"/r1/{node}", "g", "/r1/team") for node in ("a", "b")]
    assert logs.labels_meant(["team"], [*PROCESSES, *team]) == {"a", "b", "team"}
    assert logs.labels_meant(["a"], team) == {"a", "team"}


def test_a_part_of_a_run_has_its_own_labels() -> None:
    fleet = [ProcessName("fleet", f"/{robot}/base", "") for robot in ("r1", "r2")]
    assert logs.labels_meant([], fleet, "r2") == {"r2/base"}
    assert logs.labels_meant(["base"], fleet, "r2") == {"r2/base"}
    with pytest.raises(NodeNotFound, match="there is no node or group bsae; did you mean base"):
        logs.labels_meant(["bsae"], PROCESSES)
