"""What a run can be asked and told, without a process and without a network."""

import asyncio
from collections.abc import Coroutine, Iterable
from typing import Any, Literal

import msgspec
import pytest

from robo.errors import NodeNotFound, RoboError, RunError, UsageError
from robo.machine.log_files import LogFilter
from robo.supervisor.commands import Address, Commands, meant
from robo.supervisor.control import read_request
from robo.supervisor.tasks import Tasks
from robo.wire.keys import ACTS, TELLS
from robo.wire.reports import Event, LogRecord, LogsRequest, Outcome, Request, RunReport, Site
from tests.processes import FakeJournal, FakeProcess, FakeStopping, process_plan
from tests.virtual_time import now, run

SITE = Site("r1", "tcp/10.0.0.5:7447", reached=False, since=1)
ABOUT = RunReport(
    robot="r1", run="id17", host="pi", user="ann", version="1.2.3", manifest="robot.yaml", digest="0a1b", since=1
)
GROUPS = {"base": "drive/motors", "lidar": "drive", "arm/tracker": "", "camera": "vision"}


class Journal(FakeJournal):
    """Tells what it is asked for."""

    problem = ""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[object] = []

    def events(self, nodes: set[str] | None = None) -> list[Event]:
        self.asked.append(nodes)
        return []

    def lines(self, wanted: LogFilter, labels: set[str] | None = None, newest: int | None = None) -> list[LogRecord]:
        self.asked += [labels, newest]
        line = LogRecord(time=5, node="base", message="x", level="INFO")
        return [line] if wanted.wants(line) else []


class Sites:
    def __init__(self) -> None:
        self.all = {SITE.endpoint: SITE}


class Desk:
    """Robot r1 with four nodes; its commands are called as the network would."""

    def __init__(self, *, is_part: bool = False, stops_in: float = 0.0) -> None:
        self.processes: dict[str, FakeProcess] = {}
        for name, group in GROUPS.items():
            process = FakeProcess(process_plan(f"/r1/{name}", group=group), stops_in=stops_in)
            self.processes[process.plan.full_name] = process
        self.journal, self.stopping = Journal(), FakeStopping()
        address = Address("r1", "id17", "pi", is_part=is_part)
        tasks = Tasks(lambda _name, error: pytest.fail(str(error)))
        self.renewed: list[str] = []
        """Who was about to be started anew."""
        commands = Commands(
            address, ABOUT, self.processes, self.journal, Sites(), tasks, self.stopping,
            lambda plan: [*plan.needs], self.renewed.extend,
        )  # fmt: skip
        self.tells, self.acts = commands.tells, commands.acts
        self.verbs = {**self.tells, **self.acts}

    def __getitem__(self, name: str) -> FakeProcess:
        return self.processes[f"/r1/{name}"]

    def ask(self, verb: str, *names: str, **more: Any) -> Any:
        async def ask() -> object:
            answer = await self.verbs[verb](LogsRequest([*names], **more))
            await asyncio.sleep(1.0)  # what it has brought about comes to its end
            return answer

        return run(ask())

    def asked(self) -> dict[str, list[str]]:
        """What processes were asked to do."""
        return {process.label: process.asked for process in self.processes.values() if process.asked}


def test_what_tells_touches_no_process_and_may_be_asked_of_all() -> None:
    desk = Desk()
    assert (set(desk.tells), set(desk.acts)) == (set(TELLS), set(ACTS))
    for verb in desk.tells:
        desk.ask(verb)
    assert desk.asked() == {}
    assert desk.stopping.codes == []


# -- which processes names mean ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "meant"),
    [
        ([], ["base", "lidar", "arm/tracker", "camera"]),
        (["/r1/base"], ["base"]),
        (["r1/base"], ["base"]),
        (["base"], ["base"]),
        (["tracker"], ["arm/tracker"]),
        (["/r1/arm"], ["arm/tracker"]),
        (["drive"], ["base", "lidar"]),
        (["motors"], ["base"]),
        (["camera", "drive", "base"], ["camera", "base", "lidar"]),
        (["/r1"], ["base", "lidar", "arm/tracker", "camera"]),
    ],
)
def test_a_name_means_nodes_groups_and_namespaces_each_node_once(names: list[str], meant: list[str]) -> None:
    desk = Desk()
    found = [f"/r1/{name}" for name in meant]
    assert [status.node for status in desk.ask("ps", *names)] == found
    assert [one.process.node for one in desk.ask("why", *names)] == found
    assert desk.ask("stop", *names) == Outcome(found)
    assert desk.asked() == {name: ["stop"] for name in meant}


@pytest.mark.parametrize("verb", ["ps", "why", "events", "stop", "start", "restart"])
def test_a_name_that_means_nothing_is_refused_before_anything_is_done(verb: str) -> None:
    desk = Desk()
    with pytest.raises(NodeNotFound, match="robot r1 has no node or group 'lidra'; did you mean lidar"):
        desk.ask(verb, "base", "lidra")
    assert desk.asked() == {}


@pytest.mark.parametrize("verb", ["stop", "start", "restart"])
def test_where_a_robot_has_several_hosts_another_may_know_the_name(verb: str) -> None:
    desk = Desk(is_part=True)
    desk["base"].running = verb != "start"
    assert desk.ask(verb, "base", "elsewhere") == Outcome(["/r1/base"], ["elsewhere"])
    assert desk.ask("ps", "elsewhere") == []


# -- what only tells -----------------------------------------------------------------------------


def test_figures_say_whose_they_are_and_what_is_wrong_with_the_log() -> None:
    desk = Desk()
    desk.journal.problem = "no log files are written"
    (status,) = desk.ask("ps", "base")
    assert (status.robot, status.run, status.host, status.group) == ("r1", "id17", "pi", "drive/motors")
    assert status.log_problem == "no log files are written"


def test_why_tells_what_is_waited_for() -> None:
    desk = Desk()
    desk["base"].plan = process_plan("/r1/base", {"/r1/lidar": "ready"})
    (explanation,) = desk.ask("why", "base")
    assert explanation.unmet_needs == ["/r1/lidar"]


def test_events_and_lines_are_those_of_the_nodes_that_are_named() -> None:
    desk = Desk()
    desk.ask("events")
    desk.ask("events", "drive")
    assert desk.journal.asked == [None, {"/r1/base", "/r1/lidar"}]
    desk.journal.asked.clear()
    desk.ask("logs")
    desk.ask("logs", "tracker", "robo", "nobody", lines=3)
    desk.ask("logs", "nobody")
    assert desk.journal.asked == [None, None, {"arm/tracker", "robo"}, 3, set(), None]


def test_lines_are_those_of_the_time_and_the_level_that_are_asked_for() -> None:
    desk = Desk()
    assert len(desk.ask("logs", since=5, level="info")) == 1
    assert desk.ask("logs", since=6) == []
    assert desk.ask("logs", level="warn") == []
    with pytest.raises(UsageError, match="loud"):
        desk.ask("logs", level="loud")


def test_of_the_run_as_a_whole_is_told_what_it_was_made_of() -> None:
    assert Desk().ask("about") == ABOUT


def test_sites_are_told_whatever_is_named() -> None:
    assert Desk().ask("sites", "base") == [SITE]


# -- what is done --------------------------------------------------------------------------------


def test_start_starts_what_does_not_run_and_restart_all() -> None:
    desk = Desk()
    desk["base"].fail()
    assert desk.ask("start", "drive") == Outcome(["/r1/base"])
    assert desk.ask("restart", "drive") == Outcome(["/r1/base", "/r1/lidar"])
    assert desk.renewed == ["/r1/base", "/r1/lidar"]
    assert desk.asked() == {
        "base": ["start", "restart: starting again as asked"],
        "lidar": ["restart: starting again as asked"],
    }


def test_several_are_stopped_beside_each_other() -> None:
    desk = Desk(stops_in=10.0)

    async def stop() -> float:
        await desk.verbs["stop"](LogsRequest())
        return now()

    assert run(stop()) == 10.0


def test_a_stop_that_nobody_waits_for_any_more_is_done_all_the_same() -> None:
    desk = Desk(stops_in=100.0)

    async def stop() -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(60.0):
                await desk.verbs["stop"](LogsRequest(["base"]))
        await asyncio.sleep(60.0)

    run(stop())
    assert desk["base"].ended == 100.0


def test_down_answers_before_the_run_ends() -> None:
    desk = Desk()

    async def down() -> object:
        answer = await desk.verbs["down"](LogsRequest())
        assert desk.stopping.codes == []
        await asyncio.sleep(1.0)
        return answer

    assert run(down()) == Outcome([*desk.processes])
    assert desk.stopping.codes == [0]
    assert desk.journal.said == ["stopping, as robo down asks"]


def test_down_takes_no_names() -> None:
    desk = Desk()
    with pytest.raises(RunError, match="stop ends nodes and groups"):
        desk.ask("down", "base")
    assert desk.stopping.codes == []


# -- requests ------------------------------------------------------------------------------------


def test_nothing_asks_for_all() -> None:
    assert read_request(b"") == LogsRequest()


def test_a_request_of_every_verb_is_read_as_it_was_before_logs_had_one_of_its_own() -> None:
    whole = {"names": ["base"], "since": 0, "level": None, "lines": None}
    for asked in (whole, {"names": ["base"]}, Request(["base"]), LogsRequest(["base"])):
        assert read_request(msgspec.msgpack.encode(asked)) == LogsRequest(["base"])
    with pytest.raises(RoboError, match="unknown field `name`"):
        read_request(msgspec.msgpack.encode({"name": "base"}))


# -- tasks ---------------------------------------------------------------------------------------


def all_of(*works: Coroutine[Any, Any, object]) -> Iterable[Coroutine[Any, Any, object]]:
    return works


@pytest.mark.parametrize("kind", ["lasting", "passing"])
def test_work_that_ought_to_last_and_dies_is_told(kind: Literal["lasting", "passing"]) -> None:
    told: list[str] = []

    async def dies() -> None:
        raise OSError("no more room")

    async def go() -> None:
        tasks = Tasks(lambda name, error: told.append(f"{name}: {error}"))
        task = tasks.tend(dies(), "the router") if kind == "lasting" else tasks.do(dies())
        await asyncio.wait([task])
        await asyncio.sleep(0)
        assert isinstance(task.exception(), OSError)

    run(go())
    assert told == (["the router: no more room"] if kind == "lasting" else [])


def test_at_the_end_all_work_is_cancelled_and_that_is_no_failure() -> None:
    told: list[str] = []
    ended: list[float] = []

    async def works(seconds: float) -> None:
        try:
            await asyncio.sleep(seconds)
        finally:
            ended.append(now())

    async def go() -> None:
        tasks = Tasks(lambda name, _: told.append(name))
        tasks.tend(works(100.0), "a")
        tasks.do(works(100.0))
        tasks.do(works(1.0))
        await asyncio.sleep(5.0)
        tasks.cancel()
        await asyncio.sleep(1.0)
        await tasks.all(all_of(works(1.0), works(2.0)))

    run(go())
    assert told == []
    assert ended == [1.0, 5.0, 5.0, 7.0, 8.0]


def test_the_name_of_a_process_means_the_nodes_that_share_it() -> None:
    plans = [
        process_plan("/r1/a", process="/r1/team"),
        process_plan("/r1/b", process="/r1/team"),
        process_plan("/r1/c"),
    ]
    processes = [FakeProcess(plan) for plan in plans]
    for word in ("team", "r1/team", "/r1/team"):
        assert [one.label for one in meant(word, "r1", processes)] == ["a", "b"]
