"""Manifests as users run them: what is shown, what is refused, and how processes are run."""

import json
import os
import re
from pathlib import Path
from typing import Any

import pytest

from robo.testing import Launch
from tests.support import robo, run_robo

pytestmark = pytest.mark.timeout(120)

BROKEN = """\
groups:
  g:
    nodes:
      tracker: {servce: robo_services.position_tracker}
      other: {service: robo_services.position_tracker, params: {log_rate: -1}}
"""


def write(folder: Path, text: str) -> str:
    path = folder / "m.yaml"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("words", [("up",), ("up", "--dry-run"), ("check",)])
def test_every_mistake_is_shown_with_its_line(words: tuple[str, ...], tmp_path: Path) -> None:
    result = run_robo(*words, write(tmp_path, BROKEN))
    assert result.returncode == 1
    shown = result.stdout + result.stderr
    assert "m.yaml:4:17: unknown key 'servce' in node 'tracker'; did you mean service?" in shown
    assert "    4 |       tracker: {servce: robo_services.position_tracker}\n      |                 ^" in shown
    assert "m.yaml:5:75: position_tracker: log_rate = -1: expected float >= 0.001" in shown
    assert "Traceback" not in shown


def test_mistakes_as_data(tmp_path: Path) -> None:
    file = write(tmp_path, BROKEN)
    for words in (("up", "--dry-run", "--json"), ("check", "--json")):
        result = run_robo(*words, file)
        assert result.returncode == 1
        faults = json.loads(result.stdout)["faults"]
        assert [(f["line"], f["column"]) for f in faults] == [(4, 17), (5, 75)]
        assert faults[0]["file"].endswith("m.yaml")
        assert faults[0]["message"].startswith("unknown key 'servce'")


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("up", "robt.yaml"), 2),
        (("up", "robot.yaml", "worl:=x"), 2),
        (("up", "robot.yaml", "contrl", "--dry-run", "--json"), 2),
        (("up", "no_such_package:robot.yaml"), 2),
        (("check", "robt.yaml"), 2),
        (("check", "robot.yaml", "worl:=x"), 2),
        (("export", "compose", "robt.yaml"), 2),
        (("export", "compose", "robot.yaml", "worl:=x"), 2),
    ],
)
def test_words_that_make_no_sense_are_told_by_the_exit_code(words: tuple[str, ...], code: int) -> None:
    result = run_robo(*words)
    assert (result.returncode, "Traceback" in result.stderr) == (code, False), result.stderr


def test_a_check_notes_programs_that_are_not_here(tmp_path: Path) -> None:
    file = write(
        tmp_path, "groups: {g: {nodes: {camera: {run: camera-driver, publishes: {}, subscribes: {a: std/Bool}}}}}"
    )
    result = run_robo("check", file)
    assert "m.yaml:1:22: note: /camera: there is no program 'camera-driver'" in result.stdout
    assert run_robo("up", file).returncode == 1


def test_a_manifest_of_a_package_is_started_checked_and_exported(tmp_path: Path) -> None:
    (tmp_path / "batt" / "launch").mkdir(parents=True)
    (tmp_path / "batt" / "__init__.py").write_text("")
    (tmp_path / "batt" / "launch" / "robot.yaml").write_text(
        "args: {speed: 1.0}\ngroups: {g: {nodes: {a: {run: 'echo ${speed}'}}}}\n"
    )
    folder = str(tmp_path)
    plan = json.loads(run_robo("up", "batt:robot.yaml", "speed:=2.5", "--dry-run", "--json", cwd=folder).stdout)
    assert plan["processes"][0]["command"] == ["echo", "2.5"]
    assert run_robo("check", "batt:robot.yaml", cwd=folder).stdout == "batt:robot.yaml: fine\n"
    assert "command: [echo, '1.0']" in run_robo("export", "compose", "batt:robot.yaml", cwd=folder).stdout
    shown = run_robo("up", "batt:robot.yaml", "--show-args", cwd=folder).stdout
    assert shown.endswith("Give them as robo up batt:robot.yaml name:=value\n")
    shown = run_robo("up", f"{folder}/batt/launch/robot.yaml", "--show-args").stdout
    assert shown.endswith(f"Give them as robo up {folder}/batt/launch/robot.yaml name:=value\n")


def test_the_plan_as_data_and_as_text() -> None:
    words = (
        "up",
        "robot.yaml",
        "demo:=arc",
        "control",
        "--robot-name",
        "r1",
        "-p",
        "velocity_controller.linear_velocity:=0.3",
    )
    plan: dict[str, Any] = json.loads(run_robo(*words, "--dry-run", "--json").stdout)
    _mux, _smoother, monitor, controller = plan["processes"]
    assert monitor["service"] == "robo_services.safety_monitor"
    assert controller["command"][1:] == [
        "-m", "robo.process.node", "robo_services.velocity_controller", "/r1/velocity_controller",
    ]  # fmt: skip
    velocity = controller["parameters"]["linear_velocity"]
    assert (velocity["value"], velocity["source"]) == (0.3, "command line")
    assert velocity["over"][0]["value"] == 0.5
    assert "params.yaml:4:5" in velocity["over"][0]["source"]
    chain = ("/r1/safety_monitor", "/r1/velocity_smoother", "/r1/twist_mux")
    assert controller["needs"] == dict.fromkeys(chain, "ready")
    text = run_robo(*words, "--dry-run").stdout
    needs = "needs /r1/safety_monitor ready, /r1/velocity_smoother ready, /r1/twist_mux ready"
    assert f"/r1/velocity_controller  (control; {needs})" in text
    assert "linear_velocity  = 0.3  # command line" in text


def test_arguments_are_listed() -> None:
    text = run_robo("up", "simulation.yaml", "--show-args").stdout
    viewers = "none, position, rates, rerun, mujoco"
    assert re.search(rf"^  viewer +choice, default none, one of {viewers}$", text, re.MULTILINE)
    listed = json.loads(run_robo("up", "replay.yaml", "--show-args", "--json").stdout)
    log = next(arg for arg in listed if arg["name"] == "log")
    assert (log["type"], log["required"], log["default"]) == ("path", False, "../logs/room.log.gz")


def test_check_draws_and_tells_faults_from_bad_words(tmp_path: Path) -> None:
    result = run_robo("check", "robot.yaml", "--graph", "mermaid")
    assert result.returncode == 0
    assert result.stdout.startswith("flowchart LR")
    assert "robot.yaml: fine, 2 notes" in result.stderr
    feedless = run_robo("check", "robot.yaml", "use_sim:=false")
    assert feedless.returncode == 1
    assert "nothing publishes my_robot/scan, which /my_robot/safety_monitor subscribes" in feedless.stdout
    none = str(tmp_path / "none.yaml")
    for words in (("robot.yml.txt",), ("robot.yaml", "--graph", "svg"), (none,), ()):
        result = run_robo("check", *words)
        assert result.returncode == 2
        assert "Traceback" not in result.stderr


def test_the_schema_is_published() -> None:
    schema = json.loads(run_robo("schema", "manifest").stdout)
    assert "service" in schema["$defs"]["node"]["properties"]
    assert "Twist" in run_robo("schema", "geometry/Twist").stdout
    refused = run_robo("schema", "geometry/Twits")
    assert refused.returncode == 2
    assert "did you mean geometry/Twist?" in refused.stderr


TALKER = """\
import robo
from robo import Node, Publisher, timer
from robo_messages import String

class Talker(Node):
    class Parameters(robo.Parameters):
        text: str = "nothing"

    out = Publisher(String, "chatter")

    @timer(rate=20.0)
    def speak(self) -> None:
        self.out.publish(String(self.parameters.text))

robo.run(Talker)
"""


def test_commands_run_beside_services(endpoint: str, tmp_path: Path) -> None:
    """A script learns its name, parameters and remappings; needs, readiness and log files hold."""
    (tmp_path / "talker.py").write_text(TALKER)
    own = os.nice(0)  # a nice value is absolute, the program `nice` adds to that of who starts it
    priority = min(own + 3, 19)
    file = write(
        tmp_path,
        """
groups:
  g:
    namespace: r1
    nodes:
      prepare: {run: [python, -c, "print('prepared')"], log: both}
      talker:
        run: python talker.py
        cwd: .
        params: {text: "1"}
        remap: {chatter: words}
        needs: {prepare: completed}
        ready: node
        priority: PRIORITY
        cpus: 0
      listener:
        run: robo topic echo r1/words
        needs: talker
        ready: {log: "data: '1'"}
      last: {service: robo_services.position_tracker, needs: listener, prefix: nice -n 2}
""".replace("PRIORITY", str(priority)),
    )
    with robo("up", file, "--robot-name", "r1", "--listen", endpoint, cwd=str(tmp_path)) as launch:
        launch.wait_for("r1 is ready: 4 nodes")
        talker = launch.child("talker.py")
        assert talker.nice() == priority
        if hasattr(talker, "cpu_affinity"):
            assert talker.cpu_affinity() == [0]
        assert launch.child("/r1/last").nice() == min(own + 2, 19)
        order = [launch.output.index(text) for text in ("prepared", "data: '1'", "r1 is ready")]
        assert order == sorted(order)
        launch.interrupt()
        assert launch.wait() == 130
    run = [json.loads(line)["run"] for line in run_robo("logs", "--list", "--json").stdout.splitlines()][-1]
    kept = [json.loads(line) for line in run_robo("logs", "prepare", "--run", run, "--json").stdout.splitlines()]
    assert [(line["node"], line["stream"], line["message"]) for line in kept] == [("prepare", "stdout", "prepared")]


def test_a_process_that_dies_is_started_again_and_a_storm_is_slowed_down(launch: Launch, tmp_path: Path) -> None:
    file = write(
        tmp_path,
        """
groups:
  g:
    restart: {policy: on-failure, delay: 0.05, max: 2}
    nodes:
      tracker: {service: robo_services.position_tracker}
      crashing: {run: [python, -c, "import sys; sys.exit('boom')"]}
""",
    )
    robot = launch(file, may_die=["crashing"])
    robot.wait_for_line("crashing is degraded: ended with exit code 1, more than 2 times in 60 s; next try in ")
    assert robot.output.partition("crashing is degraded")[0].count("| boom") == 3
    tracker = robot.process("tracker").pid
    robot.kill("tracker")
    robot.wait_for_line("tracker was killed by SIGKILL; starting it again in 0.0")
    robot.wait_until("tracker", lambda tracker_: tracker_.state == "ready" and tracker_.pid not in (tracker, None))


def test_a_program_or_file_that_is_not_there_is_said_before_anything_runs(endpoint: str, tmp_path: Path) -> None:
    file = write(tmp_path, "groups: {g: {nodes: {a: {run: no-such-program-here}}}}\n")
    result = run_robo("up", file, "--listen", endpoint)
    assert result.returncode == 1
    assert "m.yaml:1:22: /a: there is no program 'no-such-program-here'" in result.stderr
    assert run_robo("up", file, "--dry-run").returncode == 0
    file = write(
        tmp_path,
        """
args:
  log: {type: path, default: run.log}
  unused: {type: path, default: nothing}
  bag: {type: path, exists: false, default: new.bag}
groups: {g: {nodes: {a: {run: ["true", "--in=${log}", "${bag}"]}}}}
""",
    )
    result = run_robo("up", file, "--listen", endpoint)
    assert result.returncode == 1
    assert f"m.yaml:3:30: argument log: there is no file {tmp_path}/run.log" in result.stderr
    assert result.stderr.count("there is no file") == 1
    outer = write(tmp_path, "include: {file: replay.yaml, args: {log: away.log}}\n")
    result = run_robo("up", outer, "--listen", endpoint)
    assert f"m.yaml:1:37: argument log: there is no file {tmp_path}/away.log" in result.stderr
    file = write(tmp_path, "groups: {g: {nodes: {a: {run: 'true', cwd: nowhere, required: true}}}}\n")
    result = run_robo("up", file, "--listen", endpoint)
    assert result.returncode == 1
    assert "a cannot be started in" in result.stdout
    assert "Traceback" not in result.stdout + result.stderr


STUBBORN = """\
import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: sys.exit(print("on TERM")))
print("up", flush=True)
time.sleep(60)
"""


def test_a_process_is_stopped_as_it_asks(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "stubborn.py").write_text(STUBBORN)
    stop = "ready: {log: up}, stop: {signal: TERM, timeout: 5}"
    file = write(tmp_path, f"groups: {{g: {{nodes: {{a: {{run: python stubborn.py, cwd: ., {stop}}}}}}}}}\n")
    with robo("up", file, "--listen", endpoint) as launch:
        launch.wait_for("is ready: 1 node")
        launch.interrupt()
        assert launch.wait() == 130
        assert "on TERM" in launch.output
