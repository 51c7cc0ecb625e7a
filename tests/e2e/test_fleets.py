"""Three robots of runs of their own, at one site's router: seen, tuned and started again as a fleet."""

import json
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import free_port
from tests.support import PATIENCE, Command, eventually, robo, run_robo

pytestmark = pytest.mark.timeout(300)

NODES = '''
from pathlib import Path
from typing import Annotated

import msgspec
import robo
from robo import Health, Node, check


class Worker(Node):
    """Does well, unless there is a file of the name of its robot when it starts."""

    class Parameters(robo.Parameters):
        speed: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.1

    parameters: Parameters

    def on_start(self) -> None:
        self.ill = Path(self.namespace.strip("/")).exists()

    @check("gear")
    def gear(self) -> Health:
        return Health.error("it is stuck") if self.ill else Health.ok()


class Slow(Worker):
    class Parameters(robo.Parameters):
        speed: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)] = 0.1

    parameters: Parameters
'''
MANIFEST = """
args:
  kind: {default: Worker}
groups:
  bot:
    namespace: ${robot_name}
    nodes:
      worker: {service: "workers:${kind}"}
      sleeper: {run: [sleep, "1000"]}
"""


class Fleet:
    """A site's router and three robots that have dialled it; r2 is a slow one."""

    def __init__(self, stack: ExitStack, folder: Path, site: str) -> None:
        self.folder, self.site = folder, site
        (folder / "workers.py").write_text(NODES)
        (folder / "bot.yaml").write_text(MANIFEST)
        self.router = self._begin(stack, "router", "--listen", site)
        self.router.wait_for("router at")
        self.robots = {name: self.up(stack, name) for name in ("r1", "r2", "r3")}
        eventually(lambda: self.states() == dict.fromkeys(self.robots, "ready"), "all are ready")

    def up(self, stack: ExitStack, name: str) -> Command:
        kind = "Slow" if name == "r2" else "Worker"
        place = f"tcp/127.0.0.1:{free_port()}"
        words = ("--robot-name", name, "--listen", place, "--connect", self.site, f"kind:={kind}")
        return self._begin(stack, "up", "bot.yaml", *words)

    def router_again(self, stack: ExitStack) -> None:
        self.router = self._begin(stack, "router", "--listen", self.site)

    def _begin(self, stack: ExitStack, *words: str) -> Command:
        return stack.enter_context(robo(*words, cwd=str(self.folder)))

    def ask(self, *words: str, code: int = 0) -> str:
        done = run_robo(*words, "--connect", self.site, cwd=str(self.folder), timeout=PATIENCE)
        assert done.returncode == code, done.stdout + done.stderr
        assert "Traceback" not in done.stderr
        return done.stdout if done.stdout else done.stderr

    def rows(self, *words: str) -> dict[str, dict[str, Any]]:
        return {row["robot"]: row for row in map(json.loads, self.ask("ps", "--fleet", "--json", *words).splitlines())}

    def states(self) -> dict[str, str]:
        done = run_robo("ps", "--fleet", "--json", "--connect", self.site)
        rows = map(json.loads, done.stdout.splitlines())
        return {row["robot"]: row["state"] for row in rows if row["health"] is not None}

    def pids(self) -> dict[str, int]:
        return {row["node"]: row["pid"] for row in map(json.loads, self.ask("ps", "--json").splitlines())}


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def fleet(stack: ExitStack, tmp_path: Path, endpoint: str) -> Fleet:
    return Fleet(stack, tmp_path, endpoint)


def test_a_line_a_robot_and_who_has_gone_is_offline_until_it_is_back(fleet: Fleet, stack: ExitStack) -> None:
    rows = fleet.rows()
    assert list(rows) == ["r1", "r2", "r3"]
    for row in rows.values():
        assert (row["ready"], row["nodes"], row["health"], row["trouble"]) == (2, 2, "ok", "")
        assert (row["version"], row["manifest"]) == (rows["r1"]["version"], "bot.yaml")
        assert row["version"]
        assert row["digest"] == rows["r1"]["digest"] != ""
    assert fleet.rows("--robot-name", "r3").keys() == {"r3"}
    assert "there is no robot r9; there is r1, r2, r3" in fleet.ask("ps", "--fleet", "--robot-name", "r9", code=1)

    table = fleet.ask("ps", "--fleet")
    assert table.splitlines()[0].split()[:3] == ["ROBOT", "STATE", "NODES"]
    assert "not the same everywhere" not in table

    watch = stack.enter_context(
        robo("ps", "--fleet", "--watch", "--json", "--interval", "0.3", "--connect", fleet.site)
    )
    watch.wait_for('"robot":"r2","state":"ready"')
    fleet.robots["r2"].process.kill()
    gone: list[dict[str, Any]] = []

    def has_gone() -> bool:
        lines = watch.output.rpartition("\n")[0].splitlines()[1:]
        gone[:] = (row for row in map(json.loads, lines) if row["state"] == "offline")
        return bool(gone)

    eventually(has_gone, "it is offline")
    fleet.robots["r2"].wait()
    assert {row["robot"] for row in gone} == {"r2"}
    assert len({row["last_seen"] for row in gone}) == 1  # since when it is
    seen = len(watch.output)
    fleet.up(stack, "r2")
    eventually(lambda: '"robot":"r2","state":"ready"' in watch.output[seen:], "it is shown again")


def test_a_site_that_is_lost_and_comes_back_is_found_by_all(fleet: Fleet, stack: ExitStack) -> None:
    before = fleet.pids()
    fleet.router.process.kill()
    fleet.router.wait()
    fleet.router_again(stack)
    eventually(lambda: fleet.states() == dict.fromkeys(fleet.robots, "ready"), "all are seen again")
    assert fleet.pids() == before  # nothing was started again for that


def test_a_robot_whose_supervisor_hangs_is_silent(fleet: Fleet) -> None:
    hung = fleet.robots["r3"].process
    hung.send_signal(signal.SIGSTOP)
    try:
        rows = fleet.rows("--timeout", "1")
        assert rows["r3"]["state"] == "silent"
        assert rows["r3"]["trouble"] == "its supervisor does not answer"
        assert [rows[name]["state"] for name in ("r1", "r2")] == ["ready", "ready"]
    finally:
        hung.send_signal(signal.SIGCONT)


def test_manifests_that_differ_are_told(fleet: Fleet, stack: ExitStack) -> None:
    fleet.robots["r3"].interrupt()
    fleet.robots["r3"].wait()
    (fleet.folder / "bot.yaml").write_text(MANIFEST + "# another one\n")
    fleet.up(stack, "r3")
    eventually(lambda: fleet.states() == dict.fromkeys(fleet.robots, "ready"), "all are ready")
    told = next(line for line in fleet.ask("ps", "--fleet").splitlines() if "not the same everywhere" in line)
    assert "bot.yaml is not the same everywhere: " in told
    assert "(r1, r2)" in told
    assert "(r3)" in told
    findings = {
        row["check"]: row
        for row in map(json.loads, run_robo("doctor", "--json", "--connect", fleet.site).stdout.splitlines())
    }
    assert findings["versions"]["verdict"] == "note"
    assert "bot.yaml is not the same everywhere" in findings["versions"]["message"]


def test_parameters_of_many_and_one_that_refuses(fleet: Fleet) -> None:
    assert fleet.ask("param", "set", "r*/worker", "speed", "0.7", "--dry-run").split() == [
        "/r1/worker", "/r2/worker", "/r3/worker",
    ]  # fmt: skip
    assert "speed = 0.4" in fleet.ask("param", "set", "r*/worker", "speed", "0.4")

    answers = {
        one["node"]: one for one in json.loads(fleet.ask("param", "set", "r*/worker", "speed", "0.7", "--json", code=1))
    }
    assert {node: one["answer"] for node, one in answers.items()} == {
        "/r1/worker": "ok", "/r2/worker": "refused", "/r3/worker": "ok",
    }  # fmt: skip
    assert "speed = 0.7: expected float <= 0.5" in answers["/r2/worker"]["reason"]
    table = fleet.ask("param", "get", "**/worker", "speed").splitlines()
    assert [line.split() for line in table] == [
        ["NODE", "ANSWER", "SAYS"],
        *([f"/{robot}/worker", "ok", "speed", "=", value] for robot, value in
          (("r1", "0.7"), ("r2", "0.4"), ("r3", "0.7"))),
    ]  # fmt: skip
    told = fleet.ask("param", "set", "r*/worker", "speed", "0.8", code=1)
    assert next(line for line in told.splitlines() if "/r2/worker" in line).split()[1] == "refused"

    assert "did you mean '**/wor*'?" in fleet.ask("param", "set", "wor*", "speed", "0.1", code=1)
    assert "makes no sense" in fleet.ask("param", "set", "r**/worker", "speed", "0.1", code=2)
    assert json.loads(fleet.ask("param", "list", "r1/w*", "--json"))["/r1/worker"]["speed"] == 0.8
    assert fleet.ask("param", "describe", "r*/worker", "speed").count("range       0.0 to ") == 3


def test_a_node_that_hangs_does_not_answer_and_the_others_do(fleet: Fleet) -> None:
    pid = fleet.pids()["/r1/worker"]
    hung = next(child for child in fleet.robots["r1"].children() if child.pid == pid)
    hung.suspend()
    try:
        words = ("param", "set", "r*/worker", "speed", "0.3", "--json", "--timeout", "1")
        answers = {one["node"]: one["answer"] for one in json.loads(fleet.ask(*words, code=1))}
        assert answers == {"/r1/worker": "silent", "/r2/worker": "ok", "/r3/worker": "ok"}
    finally:
        hung.resume()


def test_robots_are_started_again_one_after_another(fleet: Fleet) -> None:
    before = fleet.pids()
    assert fleet.ask("restart", "--rolling", "--dry-run").splitlines() == [
        "r1: /r1/worker, /r1/sleeper", "r2: /r2/worker, /r2/sleeper", "r3: /r3/worker, /r3/sleeper",
    ]  # fmt: skip
    assert fleet.pids() == before
    lines = fleet.ask("restart", "--rolling", "--settle", "0.5", "--json").splitlines()
    *changes, last = map(json.loads, lines)
    stages = [(one["name"], one["stage"]) for one in changes]
    for first, second in (("r1", "r2"), ("r2", "r3")):
        assert stages.index((first, "done")) < stages.index((second, "restarting"))
    assert last["outcome"] == {
        "outcome": "done", "done": ["r1", "r2", "r3"], "failed": {}, "under_way": [], "untouched": [],
    }  # fmt: skip
    after = fleet.pids()
    assert all(after[node] != pid for node, pid in before.items())

    assert "all of them are started again" in fleet.ask("restart", "--rolling", "r*/sleeper", "--settle", "0")
    assert {node for node, pid in fleet.pids().items() if pid != after[node]} == {f"/r{n}/sleeper" for n in (1, 2, 3)}


def test_it_stops_at_the_first_that_does_not_become_healthy(fleet: Fleet) -> None:
    (fleet.folder / "r2").touch()  # from its next start on
    before = fleet.pids()
    told = fleet.ask("restart", "--rolling", "--settle", "0.5", "--timeout", "8", code=1)
    assert "r1 is done" in told
    assert "stopped at r2: it did not become healthy within 8 s: /r2/worker: gear: it is stuck" in told
    assert "  ERROR gear: it is stuck" in told  # as `robo why` says it
    assert told.splitlines()[-2:] == ["done:      r1", "untouched: r3"]
    after = fleet.pids()
    assert [after[f"/{robot}/worker"] == before[f"/{robot}/worker"] for robot in ("r1", "r2", "r3")] == [
        False, False, True,
    ]  # fmt: skip

    last = json.loads(
        fleet.ask("restart", "--rolling", "r2", "r3", "--settle", "0.5", "--timeout", "8", "--json", code=1)
        .splitlines()[-1]
    )  # fmt: skip
    assert (last["outcome"]["outcome"], last["outcome"]["untouched"]) == ("stopped", ["r3"])
    assert [one["process"]["node"] for one in last["why"]] == ["/r2/worker"]


def test_an_interrupted_one_leaves_a_clear_account(fleet: Fleet) -> None:
    with robo("restart", "--rolling", "--settle", "60", "--connect", fleet.site) as rolling:
        rolling.wait_for("r1 is healthy; it has to stay so for 60 s")
        rolling.interrupt()
        assert rolling.wait() == 130
        assert rolling.output.splitlines()[-4:] == [
            "interrupted",
            "done:      none",
            "under way: r1 (told to start again; not known to be healthy)",
            "untouched: r2, r3",
        ]


def test_words_that_make_no_sense_are_told(endpoint: str) -> None:
    for words, said in ((("--dry-run", "x"), "--dry-run go with --rolling"), ((), "name nodes or groups, or say")):
        done = run_robo("restart", *words, "--connect", endpoint)
        assert done.returncode == 2
        assert said in done.stderr
