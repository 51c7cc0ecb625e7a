"""`robo batch`: many runs, on threads of its own and on Ray; what is killed in the middle goes on where it was."""

import csv
import os
import signal
import subprocess
import sys
import uuid
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import psutil
import pytest

from tests import replays
from tests.extras import needs_ray
from tests.support import Running, eventually, plain_environment, run_robo

pytestmark = pytest.mark.timeout(600)

SCORES = '''
import json, os, random, signal, subprocess, sys, threading, time
from pathlib import Path

import robo.bag
from robo.batch import Run


def note(run):
    """Say that a run has begun."""
    with open("begun.txt", "a") as file:
        file.write(f"{run.recording.name if run.recording else run.parameters}\\n")


def length(run: Run):
    with robo.bag.open(run.recording) as recording:
        return {"length": recording.duration, "chance": random.random(), **run.parameters}


def waits(run: Run):
    note(run)
    while run.recording.name not in ("0.mcap", "1.mcap") and not Path("go").exists():
        time.sleep(0.01)
    return {"name": run.recording.stem}


def dies_once(run: Run):
    note(run)
    if Path("begun.txt").read_text().count(run.recording.name) == 1:
        os.kill(os.getpid(), signal.SIGKILL)


def kills_its_worker(run: Run):
    note(run)
    if run.recording.name == "1.mcap" or Path("begun.txt").read_text().count(run.recording.name) == 1:
        os.kill(os.getppid(), signal.SIGKILL)
        threading.Event().wait()


def hangs(run: Run):
    print("it begins", flush=True)
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"])
    threading.Event().wait()


def raises(run: Run):
    raise ValueError("there is no way")


def is_short(run: Run):
    return {"passed": length(run)["length"] < 0.5}


def after_birds(run: Run):
    with robo.bag.open(run.said) as said:
        return {"words": [message.value.data for message in said.messages("r1/said")][-1]}


def robot(run: Run):
    def robo_(*words):
        return subprocess.run([sys.executable, "-m", "robo", *words], capture_output=True, text=True, check=True).stdout

    robo_("up", "birds.yaml", "--robot-name", "r1", "-d", "--wait")
    try:
        nodes = [word for word in robo_("node", "list").split() if word.startswith("/")]
        return {"nodes": " ".join(nodes), "at": os.environ["ROBO_LISTEN"]}
    finally:
        robo_("down")
'''


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A folder with nodes, functions, and six recordings of different lengths."""
    replays.nodes(tmp_path)
    (tmp_path / "scores.py").write_text(SCORES)
    (tmp_path / "bags").mkdir()
    for number in range(6):
        replays.words(tmp_path / "bags" / f"{number}.mcap", number + 4)
    return tmp_path


def batch(project: Path, *words: str, timeout: float = 120.0) -> "subprocess.CompletedProcess[str]":
    return run_robo("batch", *words, "-o", "out", "--engine", "local", cwd=str(project), timeout=timeout)


def rows_of(project: Path) -> list[dict[str, Any]]:
    """The table; it says the same as CSV and as JSON Lines."""
    lines = (project / "out" / "results.jsonl").read_bytes().splitlines()
    rows: list[dict[str, Any]] = [msgspec.json.decode(line) for line in lines]
    with (project / "out" / "results.csv").open() as file:
        told = [(one["key"], one["passed"]) for one in csv.DictReader(file)]
    assert told == [(row["key"], str(row["passed"]).lower()) for row in rows]
    return rows


def begun(project: Path) -> Counter[str]:
    """How often each run has begun."""
    path = project / "begun.txt"
    return Counter(path.read_text().split() if path.exists() else [])


def test_recordings_are_replayed_with_each_combination(project: Path) -> None:
    words = "bags/[01].mcap", "--node", "parrot", "--node", "birds:Ticks", "--sweep", "ticks.rate=10,20"
    done = batch(project, "replay", *words, "--manifest", "birds.yaml")
    assert done.returncode == 2
    assert "birds.yaml has no node birds:Ticks" in done.stderr
    words = "bags/[01].mcap", "--node", "birds:Parrot", "--node", "birds:Ticks", "--sweep", "ticks.rate=10,20"
    done = batch(project, "replay", *words, "--score", "scores:after_birds", "--keep")
    assert (done.returncode, done.stderr) == (0, "")
    rows = rows_of(project)
    assert [(row["recording"], row["parameters"]["ticks.rate"]) for row in rows] == [
        ("bags/0.mcap", 10), ("bags/0.mcap", 20), ("bags/1.mcap", 10), ("bags/1.mcap", 20),
    ]  # fmt: skip
    heard = [row["metrics"]["messages"] for row in rows]
    assert heard == [4, 4, 5, 5]
    slow, fast = (row["metrics"]["said"] - 4 for row in rows[:2])
    assert fast == pytest.approx(2 * slow, abs=2)
    assert slow == pytest.approx(3, abs=1)
    assert {row["metrics"]["words"].split()[0] for row in rows[2:]} == {"4"}
    kept = {path.stem for path in (project / "out" / "recordings").iterdir()}
    assert kept == {row["key"] for row in rows}
    assert done.stdout.splitlines()[0].split()[:3] == ["RECORDING", "ticks.rate", "PASSED"]
    assert done.stdout.splitlines()[-1] == "4 runs: 4 passed, 0 failed; out/results.csv, out/results.jsonl"


def test_only_what_is_missing_is_run(project: Path) -> None:
    words = "replay", "bags/[01].mcap", "--node", "parrot", "--manifest", "birds.yaml"
    assert batch(project, *words).returncode == 0
    first = {path.name: path.stat().st_mtime_ns for path in (project / "out" / "results").iterdir()}
    assert len(first) == 2

    again = batch(project, *words)
    assert (again.returncode, again.stderr) == (0, "")
    more = batch(project, *words, "bags/2.mcap")
    assert (more.returncode, more.stderr) == (0, "2 results there already, 1 to run\n")
    now = {path.name: path.stat().st_mtime_ns for path in (project / "out" / "results").iterdir()}
    assert {name: now[name] for name in first} == first
    assert len(rows_of(project)) == 3

    for file in ("birds.py", "birds.yaml", "bags/1.mcap"):
        count = len(list((project / "out" / "results").iterdir()))
        if file.endswith(".mcap"):
            (project / file).unlink()
            replays.words(project / file, 9)
        else:
            (project / file).write_text((project / file).read_text() + "# another one\n")
        assert batch(project, *words).returncode == 0
        assert len(rows_of(project)) == 2
        added = len(list((project / "out" / "results").iterdir())) - count
        assert added == (1 if file.endswith(".mcap") else 2), file

    stamps = {path: path.stat().st_mtime_ns for path in (project / "out" / "results").iterdir()}
    assert batch(project, *words, "--again").returncode == 0
    assert sum(path.stat().st_mtime_ns != stamp for path, stamp in stamps.items()) == 2


def test_what_fails_is_told_with_its_log(project: Path) -> None:
    words = "replay", "bags/[04].mcap", "--node", "birds:Raises"
    done = batch(project, *words)
    assert done.returncode == 1
    assert "failed: bags/4.mcap: /r1/raises: raised ValueError: seven is too much" in done.stderr
    passed, failed = rows_of(project)
    assert (passed["passed"], passed["log"]) == (True, "")
    assert failed["reason"] == "/r1/raises: raised ValueError: seven is too much"
    log = (project / "out" / failed["log"]).read_text()
    assert log.startswith("bags/4.mcap\n")
    assert "seven is too much" in log
    assert done.stdout.splitlines()[-2:] == [
        f"failed: bags/4.mcap: {failed['reason']} ({failed['log']})",
        "2 runs: 1 passed, 1 failed; out/results.csv, out/results.jsonl",
    ]
    source = (project / "birds.py").read_text()
    stays = batch(project, *words, "--json")
    assert stays.returncode == 1
    assert [msgspec.json.decode(line)["passed"] for line in stays.stdout.splitlines()] == [True, False]
    assert "1 to run" in batch(project, *words, "--retry").stderr
    (project / "birds.py").write_text(source.replace('"7"', '"77"'))
    assert batch(project, *words).returncode == 0


def test_a_regression_over_many_recordings(project: Path) -> None:
    for number in range(3):
        recording = f"bags/{number}.mcap"
        accepted = run_robo("replay-test", recording, "--node", "birds:Parrot", "--accept", cwd=str(project))
        assert accepted.returncode == 0, accepted.stderr
    words = "replay-test", "bags/[012].mcap", "--node", "birds:Parrot"
    assert batch(project, *words).returncode == 0
    assert {row["metrics"]["verdict"] for row in rows_of(project)} == {"same"}
    source = (project / "birds.py").read_text()
    (project / "birds.py").write_text(source.replace("String(word.data)", 'String(word.data.replace("4", "5"))', 1))
    done = batch(project, *words)
    assert done.returncode == 1
    assert [(row["passed"], row["reason"]) for row in rows_of(project)] == [
        (True, ""), (False, "DIFFERENT: r1/said"), (False, "DIFFERENT: r1/said"),
    ]  # fmt: skip
    assert batch(project, *words, "--ignore", "data").returncode == 0


def test_functions_are_called_with_values_and_seeds(project: Path) -> None:
    words = "call", "scores:length", "bags/[01].mcap", "--sweep", "gain=1,2", "--set", "name=x", "--seeds", "1,2"
    done = batch(project, *words)
    assert (done.returncode, done.stderr) == (0, "")
    rows = rows_of(project)
    assert [(row["metrics"]["gain"], row["seed"]) for row in rows[:4]] == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert {row["metrics"]["name"] for row in rows} == {"x"}
    chances = [row["metrics"]["chance"] for row in rows]
    assert len(rows) == 8
    assert len(set(chances)) == 2  # one a seed
    assert rows[0]["metrics"]["length"] == pytest.approx(0.301, abs=0.01)
    judged = batch(project, "call", "scores:is_short", "bags/[05].mcap")
    assert judged.returncode == 1
    assert [row["passed"] for row in rows_of(project)] == [True, False]


def test_a_function_that_raises_or_hangs_is_a_failure_in_bounded_time(project: Path) -> None:
    assert batch(project, "call", "scores:raises", "bags/0.mcap").returncode == 1
    (raised,) = rows_of(project)
    assert raised["reason"] == "scores:raises raised ValueError: there is no way"
    assert "Traceback" in (project / "out" / raised["log"]).read_text()
    mark = str(uuid.uuid4())
    with marked(project, mark, "call", "scores:hangs", "bags/0.mcap", "--limit", "3") as running:
        assert running.wait(60) == 1
    (hung,) = rows_of(project)
    assert (hung["reason"], hung["attempts"]) == ("it was not done within 3 s", 1)
    assert "it begins" in (project / "out" / hung["log"]).read_text()
    assert all_of(mark) == []


def test_a_run_whose_process_dies_is_begun_anew(project: Path) -> None:
    done = batch(project, "call", "scores:dies_once", "bags/[01].mcap")
    assert done.returncode == 0
    assert done.stderr.count("begun anew: ") == 2
    assert "its process was ended by SIGKILL" in done.stderr
    assert [(row["passed"], row["attempts"]) for row in rows_of(project)] == [(True, 2), (True, 2)]
    assert batch(project, "replay", "bags/0.mcap", "--node", "birds:Dies", "--attempts", "2").returncode == 1
    (row,) = rows_of(project)
    assert (row["reason"], row["attempts"]) == ("its process was ended by SIGABRT, in each of 2 attempts", 2)
    assert "goodbye" in (project / "out" / row["log"]).read_text()


def test_each_run_has_a_network_of_its_own(project: Path) -> None:
    done = batch(project, "call", "scores:robot", "--sweep", "number=1,2", "--workers", "2")
    assert done.returncode == 0, done.stderr
    rows = rows_of(project)
    assert {row["metrics"]["nodes"] for row in rows} == {"/r1/parrot /r1/relay"}
    assert len({row["metrics"]["at"] for row in rows}) == 2


PLAN = """\
run: command
command: [python, evaluate.py, "${recording}", "${gain}"]
recordings: [bags/0.mcap, bags/1.mcap]
points: [{gain: 1}, {gain: 2}]
"""
EVALUATE = """\
import json, sys
print("about", sys.argv[1])
print(json.dumps({"gain": float(sys.argv[2]), "name": sys.argv[1]}))
sys.exit(3 if sys.argv[1:] == ["bags/1.mcap", "2"] else 0)
"""


def test_a_plan_is_run_where_it_stands(project: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    (project / "batch.yaml").write_text(PLAN)
    (project / "evaluate.py").write_text(EVALUATE)
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    plan, out = os.path.relpath(project / "batch.yaml", elsewhere), str(project / "out")
    words = "batch", "run", plan, "-o", out, "--engine", "local"
    listed = run_robo(*words, "--dry-run", cwd=str(elsewhere))
    assert [line.split("  ")[1] for line in listed.stdout.splitlines()] == [
        "bags/0.mcap gain=1", "bags/0.mcap gain=2", "bags/1.mcap gain=1", "bags/1.mcap gain=2",
    ]  # fmt: skip
    assert not Path(out).exists()
    done = run_robo(*words, cwd=str(elsewhere))
    assert done.returncode == 1
    rows = rows_of(project)
    assert [(row["passed"], row["metrics"]["gain"]) for row in rows] == [
        (True, 1.0), (True, 2.0), (True, 1.0), (False, 2.0),
    ]  # fmt: skip
    assert rows[3]["reason"] == "python ended with exit code 3"
    assert "about bags/1.mcap" in (project / "out" / rows[3]["log"]).read_text()


def test_all_mistakes_are_told_before_anything_starts(project: Path) -> None:
    text = (
        "run: replay\n"
        "recordings: [bags/*.mcap, none/*.mcap, nothing.mcap]\n"
        "nodes: [birds:Ticks]\n"
        "parameters: {ticks.rte: 1, other.x: 2}\n"
        "sweep:\n"
        "  ticks.rate: [1, fast, 20]\n"
        "score: scores:lenth\n"
    )
    (project / "batch.yaml").write_text(text)
    done = batch(project, "run", "batch.yaml")
    assert done.returncode == 2
    told = [line for line in done.stderr.splitlines() if "batch.yaml:" in line]
    assert told == [
        "error: batch.yaml:2:27: there is no recording none/*.mcap",
        "batch.yaml:2:40: there is no recording nothing.mcap",
        "batch.yaml:4:25: ticks has no parameter rte; did you mean rate?",
        "batch.yaml:4:37: other.x is a parameter of none of these nodes: they are ticks",
        "batch.yaml:6:19: ticks: rate = 'fast': expected float, got str",
        "batch.yaml:7:1: scores:lenth: scores has no function lenth; did you mean length?",
    ]
    assert done.stderr.splitlines()[-1] == "6 mistakes; nothing is started"
    assert "sweep:" not in done.stdout
    assert not (project / "out").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("replay", "bags/*.mcap"), "say which node"),
        (("replay", "none.mcap", "--node", "parrot", "--manifest", "birds.yaml"), "there is no recording none.mcap"),
        (("replay", "bags/*.mcap", "--node", "parot", "--manifest", "birds.yaml"), "did you mean parrot?"),
        (("replay", "bags/*.mcap", "--node", "parrot", "--manifest", "no.yaml"), "there is no manifest 'no.yaml'"),
        (("replay", "bags/*.mcap", "--node", "birds:Parot"), "has no node class 'Parot'"),
        (("replay", "bags/*.mcap", "--node", "birds:Ticks", "--sweep", "ticks.rate=a"), "expected float"),
        (("replay", "bags/*.mcap", "--node", "birds:Ticks", "--sweep", "rate=1"), "rate is a parameter of none"),
        (("replay-test", "bags/*.mcap", "--node", "birds:Parrot", "--tolerances", "no.yaml"), "no.yaml"),
        (("call", "scores", "bags/*.mcap"), "write package.module:function"),
        (("call", "scors:length", "bags/*.mcap"), "scors cannot be imported"),
        (("call", "scores:length", "bags/*.mcap", "--address", "127.0.0.1:1"), "--engine local is this machine"),
        (("call", "scores:length", "--sweep", "a=1", "--set", "a=2"), "--set or --sweep"),
        (("run", "no.yaml"), "no.yaml: No such file"),
    ],
)
def test_mistakes_are_sentences(project: Path, words: tuple[str, ...], told: str) -> None:
    done = batch(project, *words)
    assert done.returncode == 2, done.stdout + done.stderr
    assert told in done.stderr
    assert "Traceback" not in done.stderr


# -- what is killed ----------------------------------------------------------------------------------------------------

START = 240.0
"""How long Ray and the first runs may take to begin on a machine that is busy with other things, s."""
MARK = "TEST_OF_A_BATCH"
"""Stands in the environment of all that a command of a test starts."""


def all_of(mark: str) -> list[psutil.Process]:
    """The processes that a command has started, wherever they are."""
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):  # it is just ending, or somebody else's
            if process.environ().get(MARK) == mark and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


@contextmanager
def marked(
    project: Path, mark: str, *words: str, engine: str = "local", more: Mapping[str, str] = {}
) -> Iterator[Running]:
    """Run a command in a terminal; nothing that it has started survives the test."""
    command = [sys.executable, "-m", "robo", "batch", *words, "-o", "out", "--engine", engine]
    environment = plain_environment() | {MARK: mark, "TMPDIR": str(project / "tmp"), **more}
    (project / "tmp").mkdir(exist_ok=True)
    running = Running(command, cwd=str(project), env=environment, terminal=True)
    try:
        yield running
    finally:
        left = [] if sys.exc_info()[0] is None else all_of(mark)  # which would hold the terminal
        for process in left:
            with suppress(psutil.Error):
                process.kill()
        running.close()


def results(project: Path) -> list[str]:
    return sorted(path.name for path in (project / "out" / "results").glob("*.json"))


ENGINES = [pytest.param("local"), pytest.param("ray", marks=needs_ray)]
WAITS = ("call", "scores:waits", "bags/*.mcap", "--workers", "2")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_command_that_is_killed_goes_on_where_it_was(project: Path, engine: str) -> None:
    mark = str(uuid.uuid4())
    with marked(project, mark, *WAITS, engine=engine) as running:
        eventually(lambda: len(results(project)) == 2 and begun(project).total() == 4, "two are done, two begun", START)
        first = results(project)
        running.process.kill()
        running.wait()
        eventually(lambda: all_of(mark) == [], "all that it had started has ended", 60)
    (project / "go").touch()
    done = run_robo("batch", *WAITS, "-o", "out", "--engine", engine, cwd=str(project), timeout=START)
    assert done.returncode == 0, done.stderr
    assert done.stderr == "2 results there already, 4 to run\n"
    rows = rows_of(project)
    assert [row["metrics"]["name"] for row in rows] == list("012345")
    assert set(first) < set(results(project))
    assert len(results(project)) == 6
    assert {name: count for name, count in begun(project).items() if count > 1} == {"2.mcap": 2, "3.mcap": 2}
    assert not list((project / "out").rglob(".*.part"))


@pytest.mark.parametrize("engine", ENGINES)
def test_ctrl_c_keeps_what_is_done_and_leaves_no_process(project: Path, engine: str) -> None:
    mark = str(uuid.uuid4())
    with marked(project, mark, *WAITS, engine=engine) as running:
        eventually(lambda: len(results(project)) == 2 and begun(project).total() == 4, "two are done, two begun", START)
        running.interrupt()
        assert running.wait(60) == 130, running.output
        assert "Traceback" not in running.output
        eventually(lambda: all_of(mark) == [], "all that it had started has ended", 10)
    assert len(results(project)) == 2
    assert list((project / "tmp").iterdir()) == []


@needs_ray
def test_a_worker_of_ray_that_is_killed_costs_an_attempt(project: Path) -> None:
    mark = str(uuid.uuid4())
    words = "call", "scores:kills_its_worker", "bags/[01].mcap", "--workers", "2"
    with marked(project, mark, *words, engine="ray") as running:
        assert running.wait(START) == 1, running.output
    first, second = rows_of(project)
    assert (first["passed"], first["attempts"]) == (True, 2)
    assert (second["passed"], second["attempts"]) == (False, 3)
    assert second["reason"].startswith("its worker died: ")
    assert second["reason"].endswith(", in each of 3 attempts")
    assert begun(project) == {"0.mcap": 2, "1.mcap": 3}
    eventually(lambda: all_of(mark) == [], "all that it had started has ended", 10)


@needs_ray
def test_ray_is_on_loopback_and_tells_nobody(project: Path) -> None:
    mark = str(uuid.uuid4())
    with marked(project, mark, *WAITS, engine="ray") as running:
        eventually(lambda: begun(project).total() == 4, "four have begun", START)
        everybody = all_of(mark)
        listening = [
            one.laddr.ip for process in everybody for one in process.net_connections("tcp") if one.status == "LISTEN"
        ]
        assert len(listening) > 2
        assert {address.removeprefix("::ffff:") for address in listening} == {"127.0.0.1"}
        rays = [one for one in everybody if "ray" in one.name() or "gcs_server" in one.name()]
        assert {one.environ()["RAY_USAGE_STATS_ENABLED"] for one in rays} == {"0"}
        assert len({one.environ()["RAY_AUTH_TOKEN"] for one in rays}) == 1
        pages = [one.cmdline() for one in everybody if "dashboard/dashboard.py" in " ".join(one.cmdline())]
        assert all("--disable-frontend" in words for words in pages), "what remains of it serves nothing"
        running.process.send_signal(signal.SIGTERM)
        assert running.wait(60) == 130, running.output


CLUSTER = """
import sys, ray
about = ray.init(address="local", num_cpus=2, include_dashboard=False, _node_ip_address="127.0.0.1",
                 object_store_memory=100_000_000, log_to_driver=False)
print("cluster", about.address_info["gcs_address"], flush=True)
sys.stdin.read()
"""


@needs_ray
def test_a_cluster_runs_it_and_stays(project: Path) -> None:
    mark = str(uuid.uuid4())
    token = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": uuid.uuid4().hex}
    environment = plain_environment() | token | {"RAY_USAGE_STATS_ENABLED": "0", MARK: mark}
    cluster = Running([sys.executable, "-c", CLUSTER], env=environment, terminal=True)
    try:
        address = cluster.wait_for("cluster ", START).split()[-1]
        words = "call", "scores:length", "bags/*.mcap", "--address", address
        with marked(project, "another", *words, engine="ray", more=token) as running:
            assert running.wait(START) == 0, running.output
        assert len(rows_of(project)) == 6
        assert cluster.process.poll() is None
    finally:
        cluster.close()
        eventually(lambda: all_of(mark) == [], "the cluster has ended", 30)
    with marked(project, "another", *words, "--again", engine="ray") as running:
        assert running.wait(START) == 1
        assert f"error: no cluster of Ray's answers at {address}: " in running.output
        assert "Traceback" not in running.output
