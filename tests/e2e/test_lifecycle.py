"""Managed nodes of a robot: brought up and down by the supervisor, taken from state to state by `robo lifecycle`."""

import json
from pathlib import Path

import pytest

from robo.testing import Launch, Robot
from robo_messages import GetState
from tests.support import run_robo

pytestmark = pytest.mark.timeout(300)

NODES = '''
from robo import LifecycleNode, Node, Publisher, TransitionCallbackReturn, subscribe, timer
from robo_messages import String


class Camera(LifecycleNode):
    """Tell each step."""

    class Parameters(LifecycleNode.Parameters):
        wrong: str = ""

    parameters: Parameters

    picture = Publisher(String, "picture")

    def _step(self, hook: str) -> None:
        self.logger.info("step %s", hook)
        if self.parameters.wrong == hook and self.memory.recall(hook) is None:
            self.memory.keep(hook, True)
            raise OSError("no device")

    def on_configure(self) -> None:
        self._step("configure")

    def on_activate(self) -> None:
        self._step("activate")

    def on_deactivate(self) -> None:
        self._step("deactivate")

    def on_cleanup(self) -> None:
        self._step("cleanup")

    def on_shutdown(self) -> None:
        self._step("shutdown")

    @timer(rate=20.0)
    def look(self) -> None:
        self.picture.publish(String("a wall"))


class Viewer(Node):
    @subscribe("picture")
    def on_picture(self, picture: String) -> None: ...

    def on_stop(self) -> None:
        self.logger.info("the viewer stops")
'''

MANIFEST = """
groups:
  vision:
    namespace: ${robot_name}
    nodes:
      camera: {service: "eyes:Camera", restart: {policy: on-failure, delay: 0.1}}
      spare: {service: "eyes:Camera", autostart: false, restart: {policy: on-failure, delay: 0.1}}
      viewer: {service: "eyes:Viewer", needs: {camera: ready}}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "eyes.py").write_text(NODES)
    (tmp_path / "eyes.yaml").write_text(MANIFEST)
    return tmp_path


def asked(robot: Robot, *words: str) -> str:
    done = run_robo("lifecycle", *words, "--connect", robot.endpoint)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_robot_with_managed_nodes_from_its_start_to_its_end(launch: Launch, folder: Path) -> None:
    robot = launch("eyes.yaml", folder=folder)
    spare = robot.process("spare")
    assert (spare.state, spare.reason) == ("standby", "unconfigured")
    assert robot.process("camera").state == "ready"
    robot.wait_for("picture")

    # Somebody takes the camera back: what needs it goes on, what is started later waits for it.
    assert asked(robot, "set", "camera", "deactivate").endswith("camera is inactive\n")
    assert robot.process("camera").reason == "inactive"
    robot.clear()
    run_robo("restart", "viewer", "--connect", robot.endpoint)
    robot.wait_until("viewer", lambda viewer: viewer.state == "starting" and "camera ready" in viewer.reason)
    assert robot.messages("picture") == []
    assert asked(robot, "set", "camera", "3").endswith("camera is active\n")
    robot.wait_until_ready()
    assert robot.process("camera").restarts == 0
    robot.wait_for("picture", new=True)

    # The spare one, which waits as its manifest wants it, can be set while it waits.
    robot.set("spare", wrong="")
    assert "inactive" in asked(robot, "set", "spare", "configure")
    assert robot.call("~/get_state".replace("~", "spare"), GetState.Request()).current_state.label == "inactive"
    told = [json.loads(line) for line in asked(robot, "get", "--json").splitlines()]
    assert [(one["node"].rpartition("/")[2], one["state"], one["id"]) for one in told] == [
        ("camera", "active", 3),
        ("spare", "inactive", 2),
    ]
    assert "active" in asked(robot, "set", "spare", "activate")
    robot.wait_until("spare", lambda spare: spare.state == "ready")

    refused = run_robo("lifecycle", "set", "spare", "configure", "--connect", robot.endpoint)
    assert refused.returncode == 1
    assert "is active and cannot configure; it can deactivate or shutdown" in refused.stderr

    # A restart brings it to active again; one that waits waits again.
    robot.kill("camera")
    robot.wait_until("camera", lambda camera: camera.state == "ready" and camera.restarts == 1)
    robot.kill("spare")
    robot.wait_until("spare", lambda spare: spare.reason == "unconfigured" and spare.restarts == 1)

    run_robo("down", "--connect", robot.endpoint)
    assert robot.wait_until_over() == 0
    steps = [line.partition("step ")[2] for line in robot.output.splitlines() if "camera" in line and "step " in line]
    assert steps[-3:] == ["deactivate", "cleanup", "shutdown"]
    assert robot.output.index("the viewer stops") < robot.output.rindex("step deactivate")


def test_who_does_not_come_to_active_is_tried_again_by_its_policy(launch: Launch, folder: Path) -> None:
    robot = launch("eyes.yaml", folder=folder, options=["-p", "camera.wrong:=activate"], may_die=["camera"])
    camera = robot.process("camera")
    assert (camera.state, camera.restarts) == ("ready", 1)
    said = robot.wait_for_line("does not come to active")
    assert "on_activate raised OSError: no device; it is finalized, and ends" in said


def test_an_error_in_a_transition_finalizes_a_node_and_its_policy_starts_it_again(launch: Launch, folder: Path) -> None:
    robot = launch("eyes.yaml", folder=folder, options=["-p", "spare.wrong:=configure"], may_die=["spare"])
    done = run_robo("lifecycle", "set", "spare", "configure", "--connect", robot.endpoint)
    assert done.returncode == 1
    assert "its hook for configure did not succeed; robo logs" in done.stderr
    robot.wait_until("spare", lambda spare: spare.restarts == 1 and spare.reason == "unconfigured")


def test_a_plain_node_cannot_be_told_to_wait(folder: Path) -> None:
    (folder / "eyes.yaml").write_text(MANIFEST.replace('Viewer",', 'Viewer", autostart: false,'))
    checked = run_robo("check", "eyes.yaml", cwd=str(folder))
    assert checked.returncode == 1
    assert "viewer says autostart: false, but eyes:Viewer is a plain node" in checked.stdout + checked.stderr
