"""Nodes that no supervisor runs, as those of containers and of Kubernetes: `robo ps`, `robo logs`, the page."""

import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import yaml

from robo.dashboard.state import Line, Picture, State
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.support import PATIENCE, Command, Running, eventually, plain_environment, robo, run_robo

pytestmark = pytest.mark.timeout(180)

TALKER = """\
import robo
from robo_messages import Log

class Talker(robo.Node):
    said = robo.Publisher(Log, "said")

    @robo.timer(rate=20.0)
    def tick(self) -> None:
        self.said.publish(Log(msg="x"))

    @robo.timer(rate=2.0)
    def talk(self) -> None:
        self.counted = getattr(self, "counted", 0) + 1
        self.logger.info("line %d", self.counted, fields={"of": self.name})
        if self.counted == 2:
            try:
                raise OSError("no such device")
            except OSError as error:
                self.logger.error("it fails", exception=error)
"""


POD = """\
args:
  robot_name: {default: r1}
groups:
  all:
    namespace: ${robot_name}
    nodes:
      first: {service: talker:Talker}
      second: {service: talker:Talker}
"""


@pytest.fixture
def nodes(endpoint: str, tmp_path: Path) -> Iterator[list[Command]]:
    (tmp_path / "talker.py").write_text(TALKER)
    with ExitStack() as undo:
        undo.enter_context(robo("router", "--listen", endpoint)).wait_for("router at")
        started = []
        for name in ("first", "second"):
            words = ("run", "talker", "--name", name, "--robot-name", "r1", "--connect", endpoint)
            started.append(undo.enter_context(robo(*words, cwd=str(tmp_path))))
        for one in started:
            one.wait_for("line 3")
        yield started


def rows(endpoint: str, *words: str) -> dict[str, dict[str, Any]]:
    done = run_robo("ps", "--json", "--connect", endpoint, *words)
    assert done.returncode == 0, done.stderr
    return {row["node"]: row for row in map(json.loads, done.stdout.splitlines())}


def test_ps_lists_them_with_what_they_say_of_themselves(endpoint: str, nodes: list[Command]) -> None:
    found = rows(endpoint)
    assert list(found) == ["/r1/first", "/r1/second"]
    for row, node in zip(found.values(), nodes, strict=True):
        assert (row["state"], row["run"], row["pid"]) == ("ready", "", node.process.pid)
        assert 5e6 < row["memory"] < 5e8
        assert row["cpu"] > 0.0
        assert row["published"]["r1/said"] > 0.0
    head, *table = run_robo("ps", "--connect", endpoint, "--robot-name", "r1").stdout.splitlines()
    assert head.split()[:3] == ["ROBOT", "GROUP", "NODE"]
    assert [line.split()[:3] for line in table] == [["r1", "-", "/r1/first"], ["r1", "-", "/r1/second"]]
    nobody = run_robo("ps", "--connect", endpoint, "--robot-name", "r2")
    assert (nobody.returncode, nobody.stderr) == (1, "error: no supervisor runs a robot r2; there is none\n")


@pytest.mark.usefixtures("nodes")
def test_logs_come_from_the_nodes_in_order_with_levels_and_tracebacks(endpoint: str) -> None:
    done = run_robo("logs", "--connect", endpoint, "--json")
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert [one["time"] for one in found] == sorted(one["time"] for one in found)
    for name in ("first", "second"):
        own = [(one["level"], one["message"]) for one in found if one["node"] == f"r1/{name}"]
        talked = [said for said in own if said[1].startswith("line ")]
        assert talked[:2] == [("INFO", f"line 1 of={name}"), ("INFO", f"line 2 of={name}")]
        at = own.index(("ERROR", "it fails"))
        assert own[at + 1] == (None, "Traceback (most recent call last):")
        assert (None, "OSError: no such device") in own
    errors = run_robo("logs", "second", "--level", "error", "--robot-name", "r1", "--connect", endpoint).stdout
    assert "second | ERROR it fails" in errors
    assert "INFO" not in errors
    assert "first" not in errors
    unknown = run_robo("logs", "nobody", "--connect", endpoint)
    assert unknown.returncode == 1
    assert unknown.stderr.startswith("error: there is no node or group nobody")


def test_why_tells_a_node_beside_a_robot_from_one_that_is_not_there(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "talker.py").write_text(TALKER)
    (tmp_path / "pod.yaml").write_text(POD)
    with robo("up", "pod.yaml", "--listen", endpoint, cwd=str(tmp_path)) as up:
        up.wait_for("r1 is ready")
        words = ("run", "talker", "--name", "third", "--robot-name", "r1", "--connect", endpoint)
        with robo(*words, cwd=str(tmp_path)) as third:
            third.wait_for("line 3")
            for name in ("third", "/r1/third"):
                done = run_robo("why", name, "--connect", endpoint)
                assert done.returncode == 1
                assert f"no supervisor runs /r1/third (process {third.process.pid} on " in done.stderr
                assert "`robo node info /r1/third` tells of it" in done.stderr
        done = run_robo("why", "fourth", "--connect", endpoint)
        assert (done.returncode, "robot r1 has no node or group 'fourth'" in done.stderr) == (1, True), done.stderr


def test_logs_are_followed_each_line_once(endpoint: str, nodes: list[Command]) -> None:
    with robo("logs", "-f", "--json", "--connect", endpoint) as follower:
        follower.wait_for("line 1 of=first")
        said = int(nodes[0].output.rpartition("line ")[2].split()[0])
        follower.wait_for(f"line {said + 4} of=first")
        follower.interrupt()
        assert follower.wait() == 130
    lines = [json.loads(line)["message"] for line in follower.output.splitlines() if line.startswith("{")]
    for name in ("first", "second"):
        own = [int(line.split()[1]) for line in lines if line.startswith("line ") and line.endswith(f"of={name}")]
        assert own == list(range(1, len(own) + 1))


@pytest.mark.usefixtures("nodes")
def test_the_page_has_their_lines(endpoint: str) -> None:
    """What the dashboard's server is told; the page draws it as it draws those of runs."""
    session = open_session(Network(mode="client", connect=(endpoint,), listen=()))
    lines: list[Line] = []
    pictures: list[Picture] = []
    state = State(session, pictures.append, lines.extend, lambda _: None)
    try:
        state.attend(True)
        eventually(lambda: any(one.message == "line 1 of=first" for one in lines), "its past is there", PATIENCE)
        assert {(one.robot, one.node) for one in lines} == {("r1", "first"), ("r1", "second")}
        assert pictures[0].robots == ["r1"]
    finally:
        state.close()
        close_session(session)


def test_a_pod_of_kubernetes_is_looked_into_through_its_router(endpoint: str, tmp_path: Path) -> None:
    """The containers of an exported pod, by their words and environments, as processes of this machine."""
    (tmp_path / "talker.py").write_text(TALKER)
    (tmp_path / "pod.yaml").write_text(POD)
    (tmp_path / "run").mkdir()
    text = run_robo("export", "kubernetes", "pod.yaml", "--robot-name", "r1", cwd=str(tmp_path)).stdout
    (pod,) = (one["spec"]["template"]["spec"] for one in yaml.safe_load_all(text) if one["kind"] == "StatefulSet")

    def here(word: str) -> str:
        """A word of a container as it is where its folders and its port are these."""
        return word.replace("/run/robo", str(tmp_path / "run")).replace("tcp/0.0.0.0:7447", endpoint)

    with ExitStack() as undo:
        for container in (*pod["initContainers"], *pod["containers"]):
            words = [sys.executable, "-m", "robo", *map(here, container["args"])]
            said = {one["name"]: here(one["value"]) for one in container["env"]}
            said["ROBO_MEMORY"] = str(tmp_path)
            process = Running(words, cwd=str(tmp_path), env=plain_environment() | said)
            undo.callback(process.close)
            process.wait_for("Ctrl-C stops" if container["name"] == "router" else "line 3")
        found = rows(endpoint)
        assert list(found) == ["/r1/first", "/r1/second"]
        assert all(row["state"] == "ready" and row["memory"] > 5e6 for row in found.values())
        done = run_robo("logs", "--connect", endpoint, "--json")
        told = [json.loads(line) for line in done.stdout.splitlines()]
        for name in ("first", "second"):
            own = [one["message"] for one in told if one["node"] == f"r1/{name}"]
            assert next(line for line in own if line.startswith("line ")) == f"line 1 of={name}"
        undo.pop_all().close()
        gone = run_robo("ps", "--connect", endpoint, "--timeout", "2")
        assert gone.returncode == 1
        assert gone.stderr.startswith("error: ")
