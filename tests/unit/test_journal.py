"""What is told of a run, where, and what is kept of it."""

import os

import pytest

from robo.launch.plan import LogPlan
from robo.machine.log_files import LogFilter
from robo.supervisor import journal
from robo.supervisor.journal import Journal
from robo.wire.reports import MOST_LINES, Event, LogRecord
from tests.processes import FakeAudience, FakeProcess, last_exit, process_plan

ALL = LogFilter()


class Console:
    def __init__(self) -> None:
        self.shown: list[str] = []

    def line(self, node: str, text: str) -> None:
        self.shown.append(f"{node} | {text}")

    def say(self, text: str) -> None:
        self.shown.append(text)

    def warn(self, text: str) -> None:
        self.shown.append(f"! {text}")


class Files:
    problem = "no room"

    def __init__(self) -> None:
        self.written: list[LogRecord] = []

    def write(self, line: LogRecord) -> None:
        self.written.append(line)


class Desk:
    """A journal whose clock ticks once with each look at it."""

    def __init__(self) -> None:
        self.time = 0
        self.console, self.files, self.audience = Console(), Files(), FakeAudience()
        self.journal = Journal("r1", self.console, self.files, self.tick)

    def tick(self) -> int:
        self.time += 1
        return self.time


@pytest.fixture
def desk() -> Desk:
    return Desk()


def noisy(where: str = "both", name: str = "cam") -> FakeProcess:
    return FakeProcess(process_plan(f"/r1/{name}", log=LogPlan(output=where)))  # type: ignore[arg-type]


def test_what_the_supervisor_says_goes_everywhere(desk: Desk) -> None:
    desk.journal.say("before anybody listens")
    desk.journal.audience = desk.audience
    desk.journal.warn("it burns")
    assert desk.console.shown == ["before anybody listens", "! it burns"]
    first, second = desk.files.written
    assert first == LogRecord(time=1, node="robo", message="before anybody listens", level="INFO")
    assert second == LogRecord(time=2, node="robo", message="it burns", level="WARN")
    assert desk.audience.lines == [second]
    assert desk.journal.lines(ALL) == [first, second]


@pytest.mark.parametrize(("where", "shown", "written"), [("both", 1, 1), ("screen", 1, 0), ("file", 0, 1)])
def test_the_output_of_a_process_goes_where_its_manifest_wants_it(
    desk: Desk, where: str, shown: int, written: int
) -> None:
    desk.journal.output(noisy(where), "stderr", "WARN  slow")
    assert desk.console.shown == ["cam | WARN  slow"] * shown
    assert [(one.node, one.level, one.message, one.stream) for one in desk.files.written] == [
        ("cam", "WARN", "slow", "stderr")
    ] * written
    assert desk.journal.lines(ALL) == desk.files.written


def test_trouble_with_the_files_is_not_written_to_them(desk: Desk) -> None:
    desk.journal.audience = desk.audience
    line = LogRecord(time=1, node="robo", message="no log files are written", level="WARN")
    desk.journal.note_trouble(line)
    assert desk.console.shown == ["! no log files are written"]
    assert desk.files.written == []
    assert desk.audience.lines == desk.journal.lines(ALL) == [line]
    assert desk.journal.problem == "no room"


def test_a_mistake_of_robos_own_is_told_with_its_place(desk: Desk) -> None:
    try:
        raise ZeroDivisionError("x")
    except ZeroDivisionError as error:
        desk.journal.warn_of(error)
    assert desk.console.shown[0] == "! the supervisor has failed: ZeroDivisionError: x"
    assert any("test_journal.py" in line for line in desk.console.shown)


def test_events_tell_of_processes_and_of_the_run(desk: Desk) -> None:
    desk.journal.audience = desk.audience
    process = noisy()
    process.restarts.count = 3
    desk.journal.event("up")
    desk.journal.event("degraded", "nothing comes", process)
    assert desk.audience.events == desk.journal.events() == [
        Event(time=1, robot="r1", node="", event="up", reason="", pid=os.getpid(), restarts=0),
        Event(time=2, robot="r1", node="/r1/cam", event="degraded", reason="nothing comes", pid=100, restarts=3,
              alarm="degraded"),
    ]  # fmt: skip
    assert [event.event for event in desk.journal.events({"/r1/cam"})] == ["degraded"]
    assert desk.journal.events(set()) == []


def test_the_newest_lines_and_events_are_kept(desk: Desk) -> None:
    for number in range(MOST_LINES + 10):
        desk.journal.output(noisy(), "stdout", str(number))
        desk.journal.event("ready")
    lines = desk.journal.lines(ALL)
    assert (len(lines), lines[0].message) == (MOST_LINES, "10")
    assert len(desk.journal.events()) == journal.MOST_EVENTS


def test_lines_are_found_by_process_level_and_number(desk: Desk) -> None:
    for name in ("a", "b", "a"):
        desk.journal.output(noisy(name=name), "stdout", f"of {name}")
    desk.journal.warn("slow")
    assert [one.message for one in desk.journal.lines(ALL, {"a"})] == ["of a", "of a"]
    assert [one.message for one in desk.journal.lines(LogFilter(least="warn"))] == ["slow"]
    assert [one.message for one in desk.journal.lines(ALL, None, 2)] == ["of a", "slow"]
    assert desk.journal.lines(ALL, None, 0) == []
    assert desk.journal.lines(ALL, set()) == []


# -- the summary at the end ----------------------------------------------------------------------


def failed(desk: Desk, where: str, *last_lines: str) -> list[str]:
    process = noisy(where).fail()
    process.exits = [last_exit("exit code 3", *last_lines)]
    before = len(desk.console.shown)
    desk.journal.summarize([process])
    return desk.console.shown[before:]


def test_what_stands_on_the_screen_is_not_repeated(desk: Desk) -> None:
    desk.journal.output(noisy(), "stderr", "ERROR it broke")
    desk.journal.output(noisy(), "stderr", "for good")
    assert failed(desk, "both", "ERROR it broke", "for good") == ["! cam failed: exit code 3", "!   for good"]


def test_last_words_that_have_scrolled_away_are_repeated(desk: Desk) -> None:
    desk.journal.output(noisy(), "stderr", "ERROR it broke")
    for number in range(30):
        desk.journal.output(noisy(name="other"), "stdout", str(number))
    assert failed(desk, "both", "ERROR it broke", "for good")[1:] == ["!   ERROR it broke", "!   for good"]


def test_last_words_that_went_into_a_file_alone_are_repeated_up_to_eight(desk: Desk) -> None:
    lines = [f"line {n}" for n in range(10)]
    for line in lines:
        desk.journal.output(noisy("file"), "stderr", line)
    assert failed(desk, "file", *lines)[1:] == [f"!   line {n}" for n in range(2, 10)]


def test_what_never_ran_has_no_last_words(desk: Desk) -> None:
    desk.journal.summarize([noisy().wait()])
    assert desk.console.shown == []
