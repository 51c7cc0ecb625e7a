"""Batches: what their plans say, which runs they make, how these are kept and put together."""

import csv
import io
import math
import subprocess
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest

from robo import bag
from robo.batch import call, fingerprint, folders, measures, table, words
from robo.batch.conduct import conduct
from robo.batch.engine import Ended
from robo.batch.on_ray import check_ray
from robo.batch.plan import Job, Metric, Outcome, Plan, Result, Work
from robo.batch.points import jobs, key_of, points
from robo.batch.progress import Progress
from robo.batch.reader import read
from robo.batch.shelf import Shelf
from robo.errors import RunError, UsageError
from robo.text.tree import Problem
from robo_messages import Quaternion
from tests import replays

PLAN = """\
run: replay
recordings: [bags/*.mcap, more]
nodes: position_tracker
manifest: launch/robot.yaml
arguments: {demo: none, use_sim: true}
parameters: {position_tracker.log_rate: 2.0}
sweep:
  position_tracker.max_distance: [10, 20.5]
  position_tracker.limits: [[1, 2], [3]]
points:
  - {a.b: 1, a.c: 2}
  - {a.b: 3, a.c: 4}
seeds: 2
metrics:
  far: {topic: current_position, field: z, take: max}
score: scores:of
timeout: 5
attempts: 2
keep: true
"""


def plan_of(text: str) -> Plan:
    problems: list[Problem] = []
    found = read(text, "batch.yaml", "/there", problems)
    assert found is not None, list(map(str, problems))
    return found[0]


def faults_of(text: str) -> list[str]:
    problems: list[Problem] = []
    assert read(text, "batch.yaml", "/there", problems) is None
    return [str(problem) for problem in problems]


def test_a_plan_says_what_is_run() -> None:
    plan = plan_of(PLAN)
    assert plan.work == Work(
        run="replay",
        folder="/there",
        nodes=("position_tracker",),
        manifest="launch/robot.yaml",
        arguments={"demo": "none", "use_sim": "true"},
        metrics={"far": Metric("current_position", "z", "max")},
        score="scores:of",
        timeout=5.0,
        keep=True,
    )
    assert plan.recordings == ("bags/*.mcap", "more")
    assert plan.sweep == {"position_tracker.max_distance": (10, 20.5), "position_tracker.limits": ([1, 2], [3])}
    assert (plan.seeds, plan.attempts) == ((1, 2), 2)


def test_a_command_is_a_line_or_words() -> None:
    assert plan_of("run: command\ncommand: evaluate 'a b' ${recording}\n").work.command == (
        "evaluate", "a b", "${recording}",
    )  # fmt: skip
    assert plan_of("run: command\ncommand: [evaluate, a b]\n").work.command == ("evaluate", "a b")


def test_all_mistakes_of_a_plan_are_told_at_once_each_with_its_place() -> None:
    text = (
        "run: replay\n"
        "nods: tracker\n"
        "recordings: []\n"
        "sweep: {a.b: 3, a.c: [1, 1], a.d: []}\n"
        "points: {}\n"
        "seeds: [1, -2]\n"
        "timeout: soon\n"
        "attempts: 0\n"
        "score: a.b\n"
        "keep: 1\n"
        "metrics: {x: {topic: odom}, y: {topic: odom, field: '..', tak: last}, z: {topic: a, field: b, take: x}}\n"
        "parameters: {a: {b: 1}, b: }\n"
        "command: run\n"
    )
    assert faults_of(text) == [
        "batch.yaml:2:1: there is no key 'nods' here; did you mean nodes?",
        "batch.yaml:13:1: command says something of a command; this is a replay",
        "batch.yaml:1:1: a replay needs nodes",
        "batch.yaml:3:13: recordings: expected a text, or several, not a list",
        "batch.yaml:4:14: a.b: expected a list of values, not 3",
        "batch.yaml:4:26: a.c: 1 stands twice",
        "batch.yaml:4:35: a.d: expected a list of values, not a list",
        "batch.yaml:5:9: points: expected a list of maps from parameters to values, not a map",
        "batch.yaml:6:8: seeds: expected a number of seeds, or a list of different whole numbers from 0, not a list",
        "batch.yaml:7:10: timeout: expected seconds, more than 0 and at most 1000000, not 'soon'",
        "batch.yaml:8:11: attempts: expected a whole number from 1 to 1000, not 0",
        "batch.yaml:9:8: score: expected package.module:function, not 'a.b'",
        "batch.yaml:10:7: keep: expected true or false, not 1",
        "batch.yaml:11:11: x needs field",
        "batch.yaml:11:59: there is no key 'tak' here; did you mean take?",
        "batch.yaml:11:53: field '..': write names and indexes, for example pose.pose.position.x or ranges[0]",
        "batch.yaml:11:101: take: expected one of last, first, min, max, mean, sum, count, not 'x'",
        "batch.yaml:12:17: a is a map; write each value as NODE.PARAMETER",
        "batch.yaml:12:28: b: expected a value, not nothing",
    ]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("- a\n", "batch.yaml:1:1: a plan is a map, not a list"),
        ("nodes: a\n", "batch.yaml:1:1: say what is run: `run:` is one of replay, replay-test, function, command"),
        (
            "run: replai\n",
            "batch.yaml:1:6: run: expected one of replay, replay-test, function, command, not 'replai'; "
            "did you mean replay?",
        ),
        ("run: function\nfunction: a:b\nsweep: {x: [1]}\nparameters: {x: 2}\n", "batch.yaml:3:9: x is in parameters"),
        ("run: function\nfunction: a:b\nsweep: {x: [1]}\npoints: [{x: 2}]\n", "batch.yaml:3:9: x is in points"),
        ('run: command\ncommand: "a \'b"\n', "batch.yaml:2:10: command: no closing quotation"),
        (
            f"run: function\nfunction: a:b\nsweep: {{x: {list(range(1001))}, y: {list(range(1000))}}}\n",
            "batch.yaml:3:1: 1,001,000 combinations for each recording; at most 1,000,000 are run",
        ),
        ("run: [\n", "batch.yaml:2:1: not valid YAML"),
    ],
)
def test_a_mistake_is_a_sentence(text: str, told: str) -> None:
    (first, *_) = faults_of(text)
    assert first.startswith(told)


# -- runs --------------------------------------------------------------------------------------------------------------


def function_plan(**more: Any) -> Plan:
    return Plan(work=Work(run="function", folder="/there", function="a:b"), **more)


def test_each_point_is_run_with_each_combination_and_seed() -> None:
    plan = plan_of(PLAN)
    found = list(points(plan))
    assert len(found) == 2 * 2 * 2 * 2
    assert found[0] == (
        {
            "position_tracker.log_rate": 2.0,
            "a.b": 1,
            "a.c": 2,
            "position_tracker.max_distance": 10,
            "position_tracker.limits": [1, 2],
        },
        1,
    )
    assert [seed for _, seed in found[:4]] == [1, 2, 1, 2]
    assert list(points(function_plan())) == [({}, None)]


def all_jobs(plan: Plan, recordings: Sequence[str], content: str = "") -> list[Job]:
    return jobs(plan, recordings, lambda recording: [recording, content], lambda key: f"/kept/{key}.mcap")


def test_a_key_follows_from_what_determines_a_run_and_from_nothing_else() -> None:
    plan = function_plan(sweep={"x": (1, 2)}, seeds=(1, 2))
    first = all_jobs(plan, ["a", "b"])
    assert len({job.key for job in first}) == len(first) == 8
    assert [job.recording for job in first] == ["a"] * 4 + ["b"] * 4
    assert [job.key for job in all_jobs(plan, ["a", "b"])] == [job.key for job in first]
    assert not {job.key for job in all_jobs(plan, ["a", "b"], "another")} & {job.key for job in first}
    more = function_plan(sweep={"x": (1, 2, 3)}, seeds=(1, 2))
    assert {job.key for job in all_jobs(more, ["a", "b"])} > {job.key for job in first}
    assert key_of({"a": 1, "b": 2}) == key_of({"b": 2, "a": 1}) != key_of({"a": 1, "b": 2.0})


def test_a_plan_without_recordings_runs_once_for_each_combination() -> None:
    assert [job.parameters for job in all_jobs(function_plan(sweep={"x": (1, 2)}), [])] == [{"x": 1}, {"x": 2}]
    assert all_jobs(function_plan(), [])[0].output == ""


def test_what_is_kept_has_a_place() -> None:
    plan = Plan(work=Work(run="replay", folder="/there", nodes=("a",), keep=True))
    (job,) = all_jobs(plan, ["a.mcap"])
    assert job.output == f"/kept/{job.key}.mcap"


def test_fingerprints_follow_contents(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    package = tmp_path / "own_package"
    (package / "within").mkdir(parents=True)
    for file in ("__init__.py", "within/deep.py"):
        (package / file).write_text("a = 1\n")
    (tmp_path / "params.yaml").write_text("{}\n")
    (tmp_path / "evaluate.py").write_text("a = 1\n")

    def now(**more: Any) -> str:
        given: dict[str, Any] = {"run": "command", "folder": "/there", "command": ("evaluate.py", "x"), **more}
        return key_of(fingerprint.of_work(Work(**given), ["params.yaml"], ["own_package.within:Thing"]))

    before = now()
    assert now(folder="/elsewhere", timeout=1.0) == now() == before
    assert now(ignore=("x",)) != before
    for file in ("own_package/within/deep.py", "params.yaml", "evaluate.py"):
        (tmp_path / file).write_text("b = 1\n")
        after = now()
        assert after != before, file
        before = after
    assert fingerprint.of_file(tmp_path / "nothing.mcap") == "unreadable: No such file or directory"
    assert fingerprint.of_code("no_package_of_this_name") == ""
    assert len({fingerprint.of_file(package), fingerprint.of_file(package / "within")}) == 2


# -- words -------------------------------------------------------------------------------------------------------------


def test_words_say_values() -> None:
    assert words.sweep(["a.rate=10,20.5,fast", "a.list=[1, 2],[3]", 'a.text="x,y",z', "a.on:=true,false"]) == {
        "a.rate": (10, 20.5, "fast"),
        "a.list": ([1, 2], [3]),
        "a.text": ("x,y", "z"),
        "a.on": (True, False),
    }
    assert words.parameters(["a.b=1", "c=x=y"]) == {"a.b": 1, "c": "x=y"}
    assert words.seeds("1,5-7, 6") == (1, 5, 6, 7)
    assert words.metrics(["x=odom:pose.pose.position.x", "n=r1/odom:twist.twist.linear.x:mean"]) == {
        "x": Metric("odom", "pose.pose.position.x"),
        "n": Metric("r1/odom", "twist.twist.linear.x", "mean"),
    }


@pytest.mark.parametrize(
    ("make", "word", "told"),
    [
        (words.sweep, ["a.b"], "write NODE.PARAMETER=VALUE,VALUE"),
        (words.sweep, ["a.b=1,,2"], "a value is missing between two commas"),
        (words.sweep, ["a.b=1,1"], "1 stands twice"),
        (words.sweep, ["a.b=1", "a.b=2"], "a.b is said twice"),
        (words.sweep, ["a.b=[1"], "--sweep: value"),
        (words.parameters, ["=1"], "write NODE.PARAMETER=VALUE"),
        (words.metrics, ["x=odom"], "write NAME=TOPIC:FIELD"),
        (words.metrics, ["x=odom:a:lst"], "did you mean last?"),
        (words.metrics, ["x=odom:a..b"], "write names and indexes"),
        (words.seeds, "1,x", "write whole numbers"),
        (words.seeds, "5-1", "write whole numbers"),
        (words.seeds, "1-99999999", "write whole numbers"),
    ],
)
def test_words_that_make_no_sense_are_refused(make: Any, word: Any, told: str) -> None:
    with pytest.raises(UsageError, match=None) as error:
        make(word)
    assert told in str(error.value)


# -- how it goes -------------------------------------------------------------------------------------------------------


class FakeEngine:
    """Ends jobs at once, as a test has it."""

    def __init__(self, outcomes: dict[str, list[Outcome]]) -> None:
        self._outcomes = outcomes
        self.begun: list[str] = []

    def run(self, queue: deque[Job]) -> Iterator[Ended]:
        while queue:
            job = queue.popleft()
            self.begun.append(job.key)
            yield Ended(job, self._outcomes[job.key].pop(0))

    def close(self) -> None:
        pass


class Notes:
    def __init__(self) -> None:
        self.told: list[str] = []

    def ended(self, result: Result) -> None:
        self.told.append(f"{result.key} {'passed' if result.passed else 'failed'}")

    def again(self, job: Job, reason: str) -> None:
        self.told.append(f"{job.key} again: {reason}")


def job_of(key: str) -> Job:
    return Job(key=key, work=function_plan().work, recording=f"{key}.mcap", parameters={"x": 1})


def died() -> Outcome:
    return Outcome(passed=False, died=True, reason="its worker died")


def test_what_dies_is_begun_anew_so_many_times_and_each_result_stands_once(tmp_path: Path) -> None:
    engine = FakeEngine(
        {
            "a": [died(), died(), Outcome(passed=True, metrics={"y": 2})],
            "b": [died(), died(), died()],
            "c": [Outcome(passed=False, reason="it raised", log="Traceback")],
        }
    )
    notes, shelf = Notes(), Shelf(tmp_path)
    all_jobs = list(map(job_of, "abc"))
    with shelf.held():
        found = conduct(all_jobs, engine, shelf, 3, notes)
        there = shelf.there(all_jobs)
    assert engine.begun == ["a", "b", "c", "a", "b", "a", "b"]
    assert found == there
    assert {key: (one.passed, one.attempts, one.reason) for key, one in found.items()} == {
        "c": (False, 1, "it raised"),
        "a": (True, 3, ""),
        "b": (False, 3, "its worker died, in each of 3 attempts"),
    }
    assert notes.told == [
        "a again: its worker died", "b again: its worker died", "c failed", "a again: its worker died",
        "b again: its worker died", "a passed", "b failed",
    ]  # fmt: skip
    assert (tmp_path / found["c"].log).read_text() == "c.mcap x=1\nit raised\n\nTraceback"
    assert found["a"].log == ""
    assert sorted(path.name for path in (tmp_path / "logs").iterdir()) == ["b.log", "c.log"]


def test_results_are_there_whole_or_not_at_all(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    with shelf.held():
        for key in "abc":
            shelf.put(job_of(key), Outcome(passed=True), 1)
    (tmp_path / "results" / "a.json").write_bytes(b'{"key": "a", "recor')
    (tmp_path / "results" / "b.json").rename(tmp_path / "results" / "x.json")
    (tmp_path / "results" / ".d.json.part").write_bytes(b"half")
    with shelf.held():
        assert list(shelf.there(map(job_of, "abcx"))) == ["c"]
        shelf.forget(["c", "none"])
        assert shelf.there(map(job_of, "c")) == {}
        with pytest.raises(UsageError, match="another batch works there"), Shelf(tmp_path).held():
            pass
    assert not (tmp_path / "results" / ".d.json.part").exists()


def test_a_result_whose_recording_was_to_be_kept_is_there_with_it(tmp_path: Path) -> None:
    shelf, kept = Shelf(tmp_path), tmp_path / "recordings" / "a.mcap"
    job = msgspec.structs.replace(job_of("a"), output=str(kept))
    with shelf.held():
        shelf.put(job, Outcome(passed=True), 1)
        assert shelf.there([job]) == {}
        kept.write_bytes(b"")
        assert [*shelf.there([job])] == ["a"]
        shelf.put(job, Outcome(passed=False), 1)
        kept.unlink()
        assert [*shelf.there([job])] == ["a"]


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="Not a directory"), Shelf(tmp_path / "file").held():
        pass


def test_progress_tells_what_is_left() -> None:
    progress = Progress(10, begun=100.0, there=2, failed=1)
    assert progress.sentence(110.0) == "2 of 10 done, 1 failed, 8 left"
    progress.done, progress.again = 4, 1
    assert progress.sentence(120.0) == "6 of 10 done, 1 failed, 4 left, 1 begun anew, 20.0s to go"
    progress.done = 8
    assert progress.sentence(120.0).endswith("0 left, 1 begun anew")


def test_folders_of_processes_that_are_gone_go(tmp_path: Path) -> None:
    mine = folders.make("robo-x-", tmp_path)
    with subprocess.Popen([sys.executable, "-c", ""]) as gone:
        gone.wait()
    (tmp_path / f"robo-x-{gone.pid}-abc" / "within").mkdir(parents=True)
    (tmp_path / "robo-x-name-abc").mkdir()
    folders.sweep("robo-x-", tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted([mine, tmp_path / "robo-x-name-abc"])


# -- the table ---------------------------------------------------------------------------------------------------------

ROWS = [
    Result(
        key="k1", recording="a.mcap", parameters={"t.x": 1, "t.same": [1]}, seed=1, passed=True, metrics={"far": 1 / 3}
    ),
    Result(
        key="k2",
        recording="b,c.mcap",
        parameters={"t.x": 2, "t.same": [1]},
        seed=1,
        passed=False,
        reason="it raised\nmore",
        metrics={"seconds": 2},
        attempts=3,
        log="logs/k2.log",
    ),
]


def test_the_table_has_all_as_csv() -> None:
    head, first, second = csv.reader(io.StringIO(table.as_csv(ROWS)))
    assert head == [
        "recording", "t.x", "t.same", "seed", "passed", "far", "metric.seconds", "seconds", "attempts", "reason",
        "log", "key",
    ]  # fmt: skip
    assert first == ["a.mcap", "1", "[1]", "1", "true", str(1 / 3), "", "0.0", "1", "", "", "k1"]
    assert second[:2] == ["b,c.mcap", "2"]
    assert second[-3:] == ["it raised\nmore", "logs/k2.log", "k2"]


def test_people_see_what_varies_and_what_failed() -> None:
    assert table.shown(ROWS) == [
        ["RECORDING", "t.x", "SEED", "PASSED", "far", "metric.seconds", "ATTEMPTS"],
        ["a.mcap", "1", "1", "passed", "0.333333", "", "1"],
        ["b,c.mcap", "2", "1", "FAILED", "", "2", "3"],
    ]
    assert table.as_lines(ROWS) == ["failed: b,c.mcap t.x=2 t.same=[1] seed=1: it raised (logs/k2.log)"]
    assert table.shown(ROWS[:1]) == [["RECORDING", "SEED", "PASSED", "far"], ["a.mcap", "1", "passed", "0.333333"]]


# -- what is measured --------------------------------------------------------------------------------------------------


def test_the_way_is_the_sum_of_its_steps() -> None:
    assert measures.way([]) == {}
    assert measures.way([(0.0, 0.0, 0.0), (3.0, 4.0, 0.5), (3.0, 0.0, 1.0)]) == {
        "distance": 9.0, "x": 3.0, "y": 0.0, "heading": 1.0,
    }  # fmt: skip
    assert measures.yaw(Quaternion(z=math.sin(0.3), w=math.cos(0.3))) == pytest.approx(0.6)
    # q = (x, y, z, w) of a turn of 90° about x after one of 60° about z, by the product of both.
    s, c = math.sin(math.radians(30)), math.cos(math.radians(30))
    r = math.sqrt(0.5)
    assert measures.yaw(Quaternion(c * r, s * r, s * r, c * r)) == pytest.approx(math.radians(60))


def test_numbers_are_taken_of_topics(tmp_path: Path) -> None:
    path = replays.odometry(tmp_path / "drive.mcap", 50)
    empty = replays.words(tmp_path / "words.mcap", 3)
    with bag.open(path) as recording, bag.open(empty) as said:
        driven = measures.standard(said, recording)
        assert driven["distance"] == pytest.approx(49 / 50 * 0.2, rel=1e-4)
        assert driven["x"] == pytest.approx(math.sin(49 / 50 * 0.2))

        def asked(topic: str, field: str, take: Any = "last") -> Any:
            return measures.asked({"m": Metric(topic, field, take)}, said, recording)["m"]

        assert asked("odom", "twist.twist.linear.x", "mean") == pytest.approx(0.2)
        assert asked("r1/odom", "pose.pose.position.y", "first") == 0.0
        assert asked("r1/odom", "pose.pose.position.y", "max") == driven["y"]
        assert asked("r1/odom", "header.stamp", "count") == 50
        assert asked("r1/scan", "ranges[1]", "sum") == 6.0
        for topic, field, told in (
            ("odm", "x", "there is no topic odm; did you mean r1/odom?"),
            ("odom", "header.frame_id", "m: r1/odom header.frame_id is no number"),
            ("odom", "pose.pos", "m: r1/odom pose.pos: pose has no field 'pos'; did you mean pose?"),
            ("scan", "ranges[7]", "m: r1/scan ranges[7]: ranges has 2 items, no [7]"),
        ):
            with pytest.raises(UsageError) as error:
                asked(topic, field)
            assert str(error.value) == told


class NumpyLike:
    """As numpy's numbers are."""

    def __init__(self, value: float) -> None:
        self._value = value

    def item(self) -> float:
        return self._value


def test_what_a_function_returns_is_an_outcome() -> None:
    returned = {"a": 1, "b": NumpyLike(0.5), "c": math.nan, "d": "x", "e": True, "passed": True}
    assert call.outcome_of(returned, "f") == Outcome(
        passed=True, metrics={"a": 1, "b": 0.5, "c": "nan", "d": "x", "e": True}
    )
    assert call.outcome_of({"passed": False}, "f") == Outcome(passed=False, reason="f says that it has not passed")
    assert "return a dict" in call.outcome_of([1], "f").reason
    assert call.outcome_of({"a": [1]}, "f").reason == "f: 'a' is [1]; use numbers and words"
    assert call.outcome_of({"passed": 1}, "f").reason == "f: passed is 1; use true or false"


def test_a_command_has_its_values_filled_in() -> None:
    job = Job(
        key="k",
        work=Work(run="command", folder="/"),
        recording="a b.mcap",
        parameters={"gain": 0.5, "name": "x", "on": True},
        seed=3,
    )
    assert call.filled(("run", "${recording}", "--gain=${gain}", "${name}${on}", "${seed}", "${other}"), job) == [
        "run", "a b.mcap", "--gain=0.5", "xtrue", "3", "${other}",
    ]  # fmt: skip
    assert call.filled(("${parameters}",), job) == ['{"gain":0.5,"name":"x","on":true}']


def test_ray_that_is_missing_is_told_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(RunError, match=r"a batch needs the module ray, .* pip install 'robo-zenoh\[ray\]'; --engine"):
        check_ray()
