"""The pure parts of the supervisor: restarts, output, promises about topics, timing, changed files."""

import asyncio
import os
import re
import time
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.errors import NodeNotFound, UsageError
from robo.launch.plan import ReadyPlan, RestartPlan, TopicPlan
from robo.machine import log_files
from robo.machine.log_files import LogFiles, LogFilter, RunInfo, record
from robo.machine.memory_kills import MemoryKills, oom_kills
from robo.machine.output import Budget, Lines, pump
from robo.supervisor.reload import FileWatch
from robo.supervisor.restart import Restarts
from robo.supervisor.timing import Started, critical_path
from robo.supervisor.topic_watch import Flow, promises
from robo.text.terminal import escaped_json
from robo.text.tree import Position
from robo.tools import logs
from robo.wire.reports import LogRecord, ProcessName
from tests.processes import process_plan

# -- restarts ------------------------------------------------------------------------------------


def test_delays_grow_up_to_a_storm() -> None:
    restarts = Restarts(RestartPlan(policy="on-failure"), chance=lambda: 0.0)
    delays = [restarts.after_end(now, failed=True) for now in range(7)]
    assert delays == [0.5, 1.0, 2.0, 4.0, 8.0, 30.0, 30.0]
    assert restarts.storm
    assert restarts.count == 7
    restarts.healthy()
    assert restarts.after_end(8, failed=True) == 0.5
    assert restarts.count == 8


def test_slow_crashes_are_no_storm() -> None:
    restarts = Restarts(RestartPlan(policy="always", max=2, window=10), chance=lambda: 0.0)
    for now in range(0, 100, 6):
        assert restarts.after_end(now, failed=False) is not None
        assert not restarts.storm


def test_policies() -> None:
    assert Restarts(RestartPlan()).after_end(0, failed=True) is None
    assert Restarts(RestartPlan(policy="on-failure")).after_end(0, failed=False) is None
    assert Restarts(RestartPlan(policy="always")).after_end(0, failed=False) is not None


@given(
    plan=st.builds(
        RestartPlan,
        policy=st.just("always"),
        delay=st.floats(0, 1e6),
        backoff=st.floats(1, 1e9),
        max_delay=st.floats(0, 1e6),
        jitter=st.floats(0, 1),
        max=st.integers(0, 20),
    ),
    times=st.lists(st.floats(0, 1e5), max_size=50),
    chance=st.floats(0, 1),
)
def test_a_delay_is_never_longer_than_is_said(plan: RestartPlan, times: list[float], chance: float) -> None:
    restarts = Restarts(plan, chance=lambda: chance)
    for now in sorted(times):
        delay = restarts.after_end(now, failed=True)
        assert delay is not None
        assert 0 <= delay <= max(plan.delay, plan.max_delay)


def test_a_kill_for_want_of_memory_is_told_as_far_as_it_is_known(tmp_path: Path) -> None:
    file = tmp_path / "vmstat"
    assert oom_kills(file) is None
    file.write_text("nr_free_pages 1\n")
    assert oom_kills(file) is None
    assert MemoryKills(0.0, lambda: oom_kills(file)).hint() == ", by somebody or by the kernel for want of memory"
    file.write_text("nr_free_pages 1\noom_kill 3\n")
    kills = MemoryKills(0.0, lambda: oom_kills(file))
    assert kills.hint() == ""
    file.write_text("oom_kill 4\n")
    kills.look(0.5)
    assert kills.hint() == ", most likely by the kernel, for want of memory"
    assert kills.hint() == "", "it has ended one"
    file.write_text("oom_kill 5\n")
    kills.look(1.0)
    kills.look(2.0)
    assert kills.hint() == "", "that one was another"


# -- output --------------------------------------------------------------------------------------


@given(st.lists(st.binary(max_size=50)))
def test_lines_come_out_as_they_were_whatever_the_chunks(chunks: list[bytes]) -> None:
    lines = Lines()
    found = [text for chunk in chunks for text in lines.feed(chunk)] + lines.flush()
    whole = b"".join(chunks).split(b"\n")
    if whole[-1] == b"":
        whole.pop()
    assert found == [line.decode("utf-8", "replace").rstrip("\r") for line in whole]


def test_a_line_without_end_comes_in_pieces() -> None:
    lines = Lines()
    found = [text for _ in range(10) for text in lines.feed(b"x" * 10_000)] + lines.flush()
    assert "".join(found) == "x" * 100_000
    assert max(map(len, found)) <= 16_384


def test_a_flood_is_cut_and_counted() -> None:
    async def flood() -> list[str]:
        seen: list[str] = []
        stream = asyncio.StreamReader()
        for _ in range(100):
            stream.feed_data(b"y" * 99_999 + b"\n")
        stream.feed_data(b"the end\n")
        stream.feed_eof()
        await pump(stream, seen.append, Budget(0.0))
        return seen

    seen = asyncio.run(flood())
    assert sum(map(len, seen)) < 2 * Budget.RESERVE
    assert any("left out: it prints too much" in line for line in seen)


@pytest.mark.parametrize("chunk", [b"y\n" * 131_072, b"x" * 262_144, b"\0" * 262_144, bytes(range(128, 256)) * 2_048])
def test_a_flood_at_full_speed_is_shown_in_part(chunk: bytes) -> None:
    budget = Budget(0.0)
    passed = [budget.take(chunk, second / 200) for second in range(2_000)]  # of ten seconds
    assert passed[0] > 0, "its beginning is shown"
    assert sum(1 for size in passed[200:] if size) == pytest.approx(9, abs=1), "and some of it each second"
    lines = Lines()
    written = 0
    for size in passed:
        for text in lines.feed(chunk[:size]) + lines.flush():
            line = LogRecord(time=1_700_000_000_000_000_000, node="noisy", message=text, stream="stdout")
            written += len(escaped_json(msgspec.json.encode(line).decode()).encode()) + 1
    granted = Budget.RESERVE + 10 * Budget.PER_SECOND
    assert 0.6 * granted < written < 1.05 * granted, "by what its log takes"


def test_a_flood_is_told_while_it_lasts() -> None:
    async def flood() -> list[str]:
        seen: list[str] = []
        stream = asyncio.StreamReader(limit=2**20)
        task = asyncio.create_task(pump(stream, seen.append, Budget(time.monotonic())))
        while not any("left out" in line for line in seen):
            stream.feed_data(b"y\n" * 131_072)
            await asyncio.sleep(0)
        stream.feed_data(b"y")
        stream.feed_eof()
        await task
        return seen

    seen = asyncio.run(flood())
    told = next(number for number, line in enumerate(seen) if "left out" in line)
    assert told > 1_000
    assert set(seen[:told]) == {"y"}
    assert re.fullmatch(r"… [\d,]+ lines \(\d+\.\d MB\) left out: it prints too much", seen[told])


def test_the_beginning_of_a_line_does_not_wait_for_ever() -> None:
    async def ask() -> list[str]:
        seen: list[str] = []
        stream = asyncio.StreamReader()
        stream.feed_data("Passwörd? ".encode())
        task = asyncio.create_task(pump(stream, seen.append, Budget(0.0)))
        while not seen:
            await asyncio.sleep(0.01)
        task.cancel()
        return seen

    assert asyncio.run(ask()) == ["Passwörd? "]


# -- names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("/r1/arm/tracker", True),
        ("r1/arm/tracker", True),
        ("arm/tracker", True),
        ("tracker", True),
        ("control", True),
        ("left", True),
        ("control/left", True),
        ("control/left/", True),
        ("/r2/arm/tracker", False),
        ("arm", False),
        ("contr", False),
        ("", False),
        ("/", False),
    ],
)
def test_a_word_means_a_process(word: str, *, meant: bool) -> None:
    assert ProcessName("r1", "/r1/arm/tracker", "control/left").is_meant(word) == meant
    assert not ProcessName("r1", "/r1/other", "").is_meant(word)


def test_a_namespace_means_all_that_is_in_it() -> None:
    process = ProcessName("fleet", "/r1/arm/tracker", "")
    assert all(map(process.is_meant, ("r1", "/r1", "/r1/arm", "r1/arm/")))
    assert not any(map(process.is_meant, ("r", "r1/a", "/r2", "fleet")))


# -- log files -----------------------------------------------------------------------------------


def _info(begin: int = 1_700_000_000_000_000_000, pid: int = 1) -> RunInfo:
    return RunInfo(run=f"id{pid}", robot="r1", manifest="robot.yaml", begin=begin, pid=pid, nodes=["/r1/a", "/r1/b"])


def test_levels_are_taken_off() -> None:
    assert (record("a", "stderr", "WARN  slow").level, record("a", "stderr", "WARN  slow").message) == ("WARN", "slow")
    assert record("a", "stderr", "ERROR x: y").message == "x: y"
    assert record("a", "stdout", "WARNING: that").level is None
    assert record("a", "stdout", "").message == ""


def test_files_are_rotated_and_read_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_files, "LARGEST", 600)
    files = LogFiles(_info(), tmp_path)
    files.begin()
    (run,) = logs.list_runs(base=tmp_path)
    follower = logs.Follower(run, set())
    for number in range(40):
        files.write(LogRecord(time=number, node="ab"[number % 2], message=f"line {number}"))
    files.close()
    names = sorted(path.name for path in files.folder.iterdir())
    assert names == ["a.jsonl", "a.jsonl.1", "b.jsonl", "b.jsonl.1", "run.json"]
    assert all(path.stat().st_size <= 600 for path in files.folder.iterdir())
    assert [r.time for r in logs.read(run, set())] == list(range(40))
    assert [r.time for r in logs.read(run, {"b"})] == list(range(1, 40, 2))
    coming = follower.records()
    assert [next(coming).time for _ in range(40)] == list(range(40))


def test_what_was_cut_short_is_passed_over(tmp_path: Path) -> None:
    files = LogFiles(_info(), tmp_path)
    files.begin()
    files.write(LogRecord(time=1, node="a", message="whole"))
    files.close()
    with (files.folder / "a.jsonl").open("ab") as file:
        file.write(b'{"time": 2, "node": "a", "mess')
    (tmp_path / "r1" / "x").mkdir()
    (tmp_path / "r1" / "x" / "run.json").write_text("{")
    (run,) = logs.list_runs(base=tmp_path)
    assert [r.message for r in logs.read(run, set())] == ["whole"]


def test_a_robot_of_a_fleet_has_the_logs_of_the_run_that_it_is_part_of(tmp_path: Path) -> None:
    for begin, robot in ((1, "r2"), (2, "fleet"), (3, "other")):
        nodes = {"r2": ["/r2/base"], "fleet": ["/r1/base", "/r2/base", "/r2/arm/motor"]}.get(robot, [])
        groups = ["left", "right", "right"]
        info = msgspec.structs.replace(_info(begin * 10**9), robot=robot, nodes=nodes, groups=groups)
        files = LogFiles(info, tmp_path)
        files.begin()
    assert [run.info.robot for run in logs.list_runs("r2", tmp_path)] == ["r2", "fleet"]
    run = logs.find_run("r2", None, tmp_path)
    assert run.info.robot == "fleet"
    assert logs.labels_meant([], run.processes, "r2") == {"r2/base", "r2/arm/motor"}
    assert logs.labels_meant(["base"], run.processes, "r2") == {"r2/base"}
    assert logs.labels_meant(["/r2/arm"], run.processes) == {"r2/arm/motor"}
    with pytest.raises(NodeNotFound, match="left"):
        logs.labels_meant(["left"], run.processes, "r2")


def test_a_traceback_belongs_to_its_error() -> None:
    wanted = LogFilter(least="error")
    records = [
        LogRecord(time=1, node="a", message="fine", level="INFO"),
        LogRecord(time=2, node="a", message="callback raised", level="ERROR"),
        LogRecord(time=3, node="a", message="Traceback (most recent call last):"),
        LogRecord(time=4, node="b", message="a line of another"),
        LogRecord(time=5, node="a", message="printed", stream="stdout"),
        LogRecord(time=6, node="a", message="fine again", level="INFO"),
    ]
    assert [r.time for r in records if wanted.wants(r)] == [2, 3]


def test_since() -> None:
    assert logs.begin_of("10m", now=lambda: 1000.0) == 400 * 10**9
    assert logs.begin_of("2001-09-09T01:46:40+00:00") == 10**18
    with pytest.raises(UsageError, match="write 30s, 10m"):
        logs.begin_of("yesterday")


# -- promises about topics -------------------------------------------------------------------------


def _flow(min_rate: float | None = None, max_age: float | None = None) -> Flow:
    place = Position("m.yaml", 1, 1)
    promise = TopicPlan(key="r1/scan", min_rate=min_rate, max_age=max_age, source=place)
    return Flow(promise, 0.0)


def _feed(flow: Flow, rate: float, begin: float, end: float) -> None:
    steps = int((end - begin) * 100)
    due = begin
    for step in range(steps):
        now = begin + step / 100
        while due <= now:
            flow.add(now)
            due += 1 / rate
        if step % 25 == 0:
            flow.mark(now)
    flow.mark(end)


def test_a_rate_that_is_kept_and_one_that_is_not() -> None:
    flow = _flow(min_rate=10.0)
    _feed(flow, 10.0, 0.0, 5.0)
    assert flow.problem(5.0) is None
    assert flow.flows(5.0)
    _feed(flow, 5.0, 5.0, 10.0)
    assert flow.problem(10.0) == "r1/scan comes at 5.0 Hz, promised are 10"
    assert flow.problem(13.0) == "nothing on r1/scan for 3.2 s"
    assert flow.silent(13.0) == pytest.approx(3.2, abs=0.05)


def test_an_age_that_is_kept_and_one_that_is_not() -> None:
    flow = _flow(max_age=0.5)
    assert not flow.flows(0.1)
    flow.add(1.0)
    assert flow.flows(1.1)
    assert flow.problem(1.4) is None
    assert flow.problem(1.6) == "nothing on r1/scan for 0.6 s"


def test_topics_are_watched_for_what_is_promised_and_for_whoever_waits() -> None:
    here = Position("m.yaml", 1, 1)
    kept = TopicPlan(key="r1/scan", min_rate=10.0, source=here)
    waited_for = TopicPlan(key="r1/map", source=here)
    found = promises(
        [
            kept,
            waited_for,
            TopicPlan(key="r1/plain", max_rate=5.0, source=here),
            TopicPlan(key="r1/gps", max_age=1.0, external=True, source=here),
        ],
        [process_plan("/r1/nav", ready=ReadyPlan(topics=("r1/map", "r1/scan")))],
    )
    assert [(one.key, one.min_rate, one.max_age) for one in found] == [("r1/scan", 10.0, None), ("r1/map", None, None)]


# -- timing and changed files ------------------------------------------------------------------------


def test_the_critical_path_is_what_the_last_one_waited_for() -> None:
    processes = {
        "/a": Started("a", [], 0.1, 0.4),
        "/b": Started("b", ["/a"], 0.4, 0.9),
        "/c": Started("c", [], 0.1, 0.8),
        "/d": Started("d", ["/b", "/c"], 0.9, 1.0),
    }
    assert [p.name for p in critical_path(processes)] == ["a", "b", "d"]
    assert critical_path({}) == []


def test_changed_files_are_noticed_once(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_text("1")
    two.write_text("2")
    watch, files = FileWatch(), {"a": [str(one)], "b": [str(one), str(two)]}
    assert watch.changed(files) == {}
    os.utime(two, ns=(1, 1))
    assert watch.changed(files) == {"b": {str(two)}}
    assert watch.changed(files) == {}
    two.unlink()
    assert watch.changed(files) == {}
    two.write_text("3")
    assert watch.changed(files) == {"b": {str(two)}}
