"""How well the nodes of a running robot do, as one sees it on the command line."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robo.testing import Launch, Robot
from robo.wire.reports import ProcessStatus
from robo_messages import Bool, DiagnosticArray, DiagnosticStatus, String
from tests.support import PATIENCE, eventually, robo, run_robo

pytestmark = pytest.mark.timeout(300)

NODES = '''
import time

from robo import Health, Node, Publisher, check, subscribe
from robo_messages import Bool, String


class Pack(Node):
    """A battery."""

    def on_start(self) -> None:
        self.volts = 12.0

    @subscribe("volts")
    def on_volts(self, volts: String) -> None:
        self.volts = float(volts.data)

    @subscribe("hang")
    def on_hang(self, _: Bool) -> None:
        while not self.stopping:
            time.sleep(0.01)

    @check("battery")
    def battery(self) -> Health:
        if self.volts < 11.0:
            return Health.warn("charge it", volts=self.volts)
        return Health.ok(volts=self.volts)
'''

MANIFEST = """
groups:
  power:
    namespace: ${robot_name}
    nodes:
      pack: {service: "power:Pack", watchdog: 0}
      spare: {service: "power:Pack"}
      diagnostic_aggregator: {service: robo_services.diagnostic_aggregator, params: {timeout: 2.5}}
"""


@pytest.fixture
def robot(launch: Launch, tmp_path: Path) -> Robot:
    (tmp_path / "power.py").write_text(NODES)
    (tmp_path / "power.yaml").write_text(MANIFEST)
    return launch("power.yaml", folder=tmp_path, may_die=["pack"])


def ask(robot: Robot, *words: str) -> str:
    result = run_robo(*words, "--connect", robot.endpoint)
    assert result.returncode == 0, result.stderr
    return result.stdout


def seen(robot: Robot, node: str) -> dict[str, Any]:
    nodes = json.loads(ask(robot, "top", "--once", "--json", "--interval", "0.2"))["nodes"]
    found: dict[str, Any] = next(one for one in nodes if one["node"] == node)
    return found


def total(robot: Robot, level: int) -> str:
    said: DiagnosticStatus = robot.wait_for("diagnostics_toplevel_state", lambda one: one.level == level, PATIENCE)
    return said.message


def is_well(process: ProcessStatus) -> bool:
    return process.health == "ok"


def test_tools_show_what_a_node_says_of_itself(robot: Robot) -> None:
    robot.wait_until("pack", is_well, PATIENCE)
    assert not re.search("OK|WARN|ERROR|STALE", ask(robot, "why", "pack"))
    assert re.search(r"/r1/pack +ready +OK ", ask(robot, "top", "--once"))

    robot.send("volts", String("10.5"))
    robot.wait_until("pack", lambda one: one.health == "warn", PATIENCE)
    figures = seen(robot, "/r1/pack")
    assert (figures["health"], figures["trouble"]) == ("warn", "battery: charge it")
    shown = ask(robot, "top", "--once")
    assert re.search(r"/r1/pack +ready +WARN ", shown)
    assert "WARN /r1/pack  battery: charge it" in shown.splitlines()
    assert ask(robot, "why", "pack").splitlines()[2] == "  WARN battery: charge it"
    (why,) = [json.loads(line) for line in ask(robot, "why", "pack", "--json").splitlines()]
    assert why["checks"][2]["values"] == [{"key": "volts", "value": "10.5"}]
    assert (why["process"]["health"], why["process"]["trouble"]) == ("warn", "battery: charge it")
    assert "WARN battery: charge it" in ask(robot, "ps")
    assert re.search(r"battery +WARN +charge it +volts 10.5", ask(robot, "node", "info", "pack"))
    assert total(robot, DiagnosticStatus.WARN) in ("/r1/pack/battery: charge it", "/r1/spare/battery: charge it")


def test_a_callback_that_hangs_and_a_process_that_stands_are_told(robot: Robot) -> None:
    for node in ("pack", "spare"):
        robot.wait_until(node, is_well, PATIENCE)
    robot.pause("spare")
    stands = robot.wait_until("spare", lambda one: one.health == "stale", PATIENCE)
    assert stands.trouble.startswith("has said nothing for ")
    assert "  has said nothing for" in ask(robot, "why", "spare")
    assert total(robot, DiagnosticStatus.ERROR).startswith("/r1/spare: has said nothing for ")
    robot.resume("spare")
    robot.wait_until("spare", is_well, PATIENCE)

    robot.send("hang", Bool(True))
    hangs = robot.wait_until("pack", lambda one: one.health == "stale", PATIENCE)
    assert hangs.trouble.startswith("battery: not asked for ")
    told = ask(robot, "why", "pack")
    assert "its callback on_hang has been running for " in told
    assert "  STALE battery: not asked for " in told

    def named(report: DiagnosticArray) -> bool:
        return any(one.level == DiagnosticStatus.ERROR and "on_hang" in one.message for one in report.status)

    robot.wait_for("diagnostics", named, PATIENCE)


def test_a_node_that_no_supervisor_runs_is_asked_itself(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    del session  # the meeting point
    (tmp_path / "power.py").write_text(NODES)
    with robo("run", "power:Pack", "--robot-name", "r7", "--connect", endpoint, cwd=str(tmp_path)) as pack:
        pack.wait_for("runs as /r7/pack")

        def health() -> object:
            shown = run_robo("top", "--once", "--json", "--interval", "0.2", "--connect", endpoint)
            nodes = {one["node"]: one for one in json.loads(shown.stdout)["nodes"]}
            return nodes.get("/r7/pack", {}).get("health")

        eventually(lambda: health() == "ok", "it says that it is well")
