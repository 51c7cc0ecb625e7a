"""No two nodes of one name: who comes second is refused before anything of it starts."""

from pathlib import Path

import pytest

from robo.testing import Launch
from robo.wire.keys import NodeToken
from tests.support import Command, eventually, lines_of_its_own, robo, run_robo

pytestmark = pytest.mark.timeout(120)

OWN = """\
groups:
  g:
    namespace: r1
    nodes:
      position_tracker: {service: robo_services.position_tracker}
"""


@pytest.mark.parametrize("words", [("fleet.yaml", "robots:=2"), ("own.yaml",), ("--robot-name", "r1")])
def test_a_second_run_of_a_name_is_refused_before_anything_starts(
    words: tuple[str, ...], endpoint: str, tmp_path: Path
) -> None:
    (tmp_path / "own.yaml").write_text(OWN)
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as first:
        first.wait_for("r1 is ready")
        with robo("up", *words, "--listen", endpoint, cwd=str(tmp_path)) as second:
            assert second.wait(60) == 1
            assert "already (process " in second.output
            assert "stop it with `robo down` or choose another --robot-name" in second.output
            assert len(lines_of_its_own(second.output)) == 1  # nothing of it has even begun
        logged = run_robo("logs", "--robot-name", "r1").stdout
        assert "is ready: 6 nodes" in logged  # the run that lives is the one whose logs are shown
        assert first.process.poll() is None


def test_of_two_that_start_at_once_one_comes_up(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(OWN)
    for words in [("--robot-name", "r1"), ("own.yaml",)]:
        with (
            robo("up", "--robot-name", "r1", "--listen", endpoint) as one,
            robo("up", *words, "--listen", endpoint, cwd=str(tmp_path)) as other,
        ):
            loser, winner = _first_to_end(one, other)
            assert loser.wait() == 1
            assert "already (process " in loser.output
            assert len(lines_of_its_own(loser.output)) == 1
            winner.wait_for("is ready")
            assert "already" not in winner.output


def _first_to_end(one: Command, other: Command) -> tuple[Command, Command]:
    eventually(lambda: one.process.poll() is not None or other.process.poll() is not None, "one gives way", 60)
    return (one, other) if one.process.poll() is not None else (other, one)


def test_a_node_alone_and_a_run_respect_each_other(endpoint: str) -> None:
    alone = ("run", "robo_services.position_tracker", "--robot-name", "r1", "--listen", endpoint)
    with robo("up", "--robot-name", "r1", "--listen", endpoint) as robot:
        robot.wait_for("r1 is ready")
        refused = run_robo(*alone)
        assert refused.returncode == 1
        assert "/r1/position_tracker runs already (process " in refused.stderr
        assert "robot r1); stop it, or choose another --robot-name or --name" in refused.stderr
        with robo(*alone, "--name", "second_tracker"):
            eventually(lambda: "second_tracker" in run_robo("node", "list", "--connect", endpoint).stdout, "it runs")
    with robo(*alone):
        eventually(lambda: "/r1/position_tracker" in run_robo("node", "list", "--connect", endpoint).stdout, "it runs")
        with robo("up", "--robot-name", "r1", "--listen", endpoint) as refused_up:
            assert refused_up.wait(60) == 1
            assert "/r1/position_tracker runs already" in refused_up.output


def test_twins_are_shown(launch: Launch) -> None:
    robot = launch("robot.yaml", demo="arc")
    twin = NodeToken("r1", "safety_monitor", "mine:Monitor", 17, "elsewhere")
    token = robot.session.liveliness().declare_token(twin.key())
    robot.wait_for_line("another /r1/safety_monitor has come up (process 17 on elsewhere)")
    said = "/r1/safety_monitor runs twice: "
    listed = run_robo("node", "list", "--connect", robot.endpoint)
    assert said in listed.stderr
    assert listed.stdout.count("/r1/safety_monitor") == 2
    shown = run_robo("ps", "--connect", robot.endpoint).stdout
    (line,) = [line for line in shown.splitlines() if "_monitor" in line]
    assert "runs twice: process " in line
    assert "process 17 on elsewhere" in line
    assert said in run_robo("doctor", "--connect", robot.endpoint).stdout
    token.undeclare()
