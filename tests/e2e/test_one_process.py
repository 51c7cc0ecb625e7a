"""Several nodes in one process, with real ones."""

import json
import re
import signal
import time
from pathlib import Path

import psutil
import pytest

from robo.testing import Launch, Robot
from robo_messages import String
from tests.support import eventually, run_robo

pytestmark = pytest.mark.timeout(120)

TEAM = """\
import asyncio, threading, time
import robo
from robo import Node, Publisher, subscribe, timer
from robo_messages import JointState, String

class Talker(Node):
    out = Publisher(JointState, "joints")

    @timer(rate=50.0)
    def tick(self) -> None:
        self.out.publish(JointState(name=["a"], position=[1.0]))

class Waiter(Node):
    @timer(rate=20.0)
    async def look(self) -> None:
        await asyncio.sleep(0.001)

    @subscribe("~/do")
    async def do(self, _: String) -> None:
        raise SystemExit(5)

class Member(Node):
    class Parameters(robo.Parameters):
        color: str = "red"

    parameters: Parameters
    said = Publisher(String, "~/said")

    def on_start(self) -> None:
        self.logger.debug("my parameter is %s", self.parameters.color)

    @subscribe("joints")
    def take(self, message: JointState) -> None:
        message.position.append(2.0)
        self.said.publish(String(f"{message.position} {self.parameters.color}"))

    @subscribe("~/do")
    def do(self, message: String) -> None:
        match message.data:
            case "raise":
                raise ValueError("a mistake")
            case "print":
                print("a bare line")
                self.logger.warning("a line of its own")
            case "die":
                threading.Thread(target=lambda: 1 / 0, name="worker").start()
            case "exit":
                raise SystemExit(3)
            case "stay":
                threading.Thread(target=time.sleep, args=(600,), name="sleeper", daemon=True).start()
            case "burn":
                end = time.monotonic() + 20.0
                while time.monotonic() < end:
                    time.sleep(0.0001)
            case "hang":
                while True:
                    pass
"""

MANIFEST = """
groups:
  g:
    namespace: r1
    process: team
    restart: {policy: on-failure, delay: 0.2}
    nodes:
      talker: {service: "team:Talker"}
      a: {service: "team:Member", needs: {talker: ready}, params: {color: blue}, log: debug}
      b: {service: "team:Member", needs: {talker: ready}}
      alone: {service: "team:Member", process: ""}
"""


def prints(robot: Robot, who: str, text: str) -> None:
    """Wait until a node or a process prints something."""
    line = re.compile(rf" {who} +\| {text}")
    eventually(lambda: line.search(robot.output) is not None, f"a line of {who} with {text}")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "team.py").write_text(TEAM)
    (tmp_path / "m.yaml").write_text(MANIFEST)
    return tmp_path


def test_nodes_share_a_process_and_each_keeps_what_is_its_own(launch: Launch, folder: Path) -> None:
    robot = launch("m.yaml", folder=folder, may_die=["a"])
    pid = robot.process("talker").pid
    assert [robot.process(name).pid for name in ("a", "b")] == [pid, pid]
    assert robot.process("alone").pid != pid
    assert psutil.Process(pid).cmdline()[-3:] == ["-m", "robo.process.shared", "/r1/team"]
    for name, color in (("a", "blue"), ("b", "red")):
        assert robot.wait_for(f"{name}/said").data == f"[1.0, 2.0] {color}"
    prints(robot, "a", "DEBUG my parameter is blue")
    assert not re.search(r" b +\| DEBUG", robot.output)
    robot.set("b", color="green")
    robot.wait_for("b/said", lambda said: said.data.endswith("green"))
    assert robot.get("a", "color") == "blue"
    robot.send("a/do", String("raise"))
    prints(robot, "a", "ERROR do raised")
    robot.send("b/do", String("print"))
    prints(robot, "team", "a bare line")
    prints(robot, "b", "WARN  a line of its own")
    assert [robot.process(name).restarts for name in ("talker", "a", "b")] == [0, 0, 0]
    told = run_robo("ps", "--connect", robot.endpoint).stdout
    assert re.search(rf"r1 +- +/r1/team: +- +{pid} .*\d+M.* a process of several nodes\n", told)
    assert re.search(rf"r1 +g +  /r1/talker +ready +{pid} ", told)
    logs = run_robo("logs", "team", "--connect", robot.endpoint).stdout
    assert "a bare line" in logs
    assert "a line of its own" in logs


def test_a_node_ends_alone_and_starts_again_in_the_same_process(launch: Launch, folder: Path) -> None:
    robot = launch("m.yaml", folder=folder, may_die=["a"])
    pid = robot.process("talker").pid
    robot.send("a/do", String("exit"))
    robot.wait_for_line("a ended with exit code 3; starting it again in 0.")
    robot.wait_for_line("a is ready again")
    robot.send("a/do", String("die"))
    prints(robot, "a", "ERROR the thread worker died; the node ends")
    robot.wait_until("a", lambda one: one.restarts == 2 and one.state == "ready")
    assert run_robo("stop", "b", "--connect", robot.endpoint).returncode == 0
    assert [robot.process(name).pid for name in ("talker", "a", "b")] == [pid, pid, None]
    assert run_robo("start", "b", "--connect", robot.endpoint).returncode == 0
    robot.wait_until("b", lambda one: one.state == "ready")
    assert [robot.process(name).pid for name in ("talker", "a", "b")] == [pid, pid, pid]
    robot.clear()
    robot.wait_for_count("b/said", 3)
    assert run_robo("restart", "team", "--connect", robot.endpoint).returncode == 0
    eventually(lambda: robot.process("b").state == "ready", "all of it again")
    renewed = {robot.process(name).pid for name in ("talker", "a", "b")}
    assert len(renewed) == 1
    assert pid not in renewed, "changed code comes with a new process"


def test_a_process_that_is_killed_comes_back_with_all_its_nodes(launch: Launch, folder: Path) -> None:
    members = "\n".join(f"      m{n}: {{service: 'team:Member'}}" for n in range(9))
    (folder / "m.yaml").write_text(re.sub(r"      a:.*", members, MANIFEST, flags=re.DOTALL))
    names = ["talker", *(f"m{n}" for n in range(9))]
    robot = launch("m.yaml", folder=folder, may_die=names)
    pid = robot.process("talker").pid
    assert pid is not None
    psutil.Process(pid).send_signal(signal.SIGKILL)
    for name in names:
        robot.wait_for_line(f"{name} was killed by SIGKILL")
    for name in names:
        robot.wait_until(name, lambda one: one.state == "ready" and one.restarts == 1)
    assert len({robot.process(name).pid for name in names}) == 1
    robot.clear()
    robot.wait_for_count("m8/said", 3)


def test_nodes_that_share_a_process_outlive_the_template_of_it(launch: Launch, folder: Path) -> None:
    robot = launch("m.yaml", folder=folder)
    pid = robot.process("talker").pid
    assert pid is not None
    template = psutil.Process(pid).parent()
    assert template is not None
    assert "robo.process.template" in template.cmdline()
    template.kill()
    eventually(lambda: psutil.Process(pid).ppid() != template.pid, "the supervisor has adopted it")
    robot.clear()
    robot.wait_for_count("joints", 100)  # two seconds of them: it looks once a second
    assert [(robot.process(name).pid, robot.process(name).restarts) for name in ("talker", "a")] == [(pid, 0)] * 2


def test_a_node_whose_start_fails_leaves_no_thread_behind(launch: Launch, folder: Path) -> None:
    late = """

class Late(Node):
    def on_start(self) -> None:
        threading.Thread(target=time.sleep, args=(600,), name="reader", daemon=True).start()
        raise OSError("no such device")
"""
    (folder / "team.py").write_text(TEAM + late)
    (folder / "m.yaml").write_text(MANIFEST + '      late: {service: "team:Late", restart: never}\n')
    robot = launch("m.yaml", folder=folder, may_die=["late", "talker", "a", "b"])
    prints(robot, "late", "FATAL reader of it goes on, so that the process ends with it")
    robot.wait_for_line("talker is ready again")
    assert robot.process("late").state == "failed"


def test_a_node_that_hangs_is_the_one_that_is_named(launch: Launch, folder: Path) -> None:
    (folder / "m.yaml").write_text(MANIFEST.replace("color: blue}", "color: blue}, watchdog: 1.5"))
    robot = launch("m.yaml", folder=folder, may_die=["talker", "a", "b"])
    robot.wait_until("a", lambda one: one.published != {})  # beats come
    robot.send("a/do", String("hang"))
    robot.wait_for_line("a hangs: no sign of life for 1.")
    prints(robot, "b", "WARN  the process /r1/team is ended, as a hangs")
    for name in ("talker", "a", "b"):
        robot.wait_until(name, lambda one: one.state == "ready" and one.restarts == 1)
    assert "b hangs" not in robot.output
    assert "talker hangs" not in robot.output
    assert re.search(r" team +\| Fatal Python error: Aborted", robot.output)
    why = run_robo("why", "a", "--connect", robot.endpoint).stdout
    assert re.search(r"hangs: no sign of life for 1\.\d s; do does not return", why)
    assert re.search(r'File ".*team.py", line \d+, in do', why)


def test_a_thread_that_goes_on_ends_the_process_with_its_node(launch: Launch, folder: Path) -> None:
    robot = launch("m.yaml", folder=folder, may_die=["talker", "a", "b"])
    robot.send("a/do", String("stay"))
    robot.send("a/do", String("exit"))
    prints(robot, "a", "FATAL sleeper of it goes on, so that the process ends with it")
    for name in ("talker", "a", "b"):
        robot.wait_until(name, lambda one: one.state == "ready" and one.restarts == 1)


def test_processor_time_is_told_for_each_node(launch: Launch, folder: Path) -> None:
    robot = launch("m.yaml", folder=folder)
    robot.send("a/do", String("burn"))
    robot.wait_until("a", lambda one: one.running == "do")
    robot.wait_until("b", lambda one: one.cpu is not None and one.process_cpu is not None and one.process_cpu > 1)
    statuses = [json.loads(line) for line in run_robo("ps", "--json", "--connect", robot.endpoint).stdout.splitlines()]
    shared = [one for one in statuses if one["process"] == "/r1/team"]
    assert len({(one["pid"], one["memory"] // 4_000_000) for one in shared}) == 1
    assert all(one["process_cpu"] >= one["cpu"] or one["cpu"] < 20 for one in shared)


def test_a_run_that_ends_leaves_nothing_of_it(launch: Launch, folder: Path) -> None:
    robot = launch("m.yaml", folder=folder)
    pid = robot.process("a").pid
    begin = time.monotonic()
    assert run_robo("down", "--connect", robot.endpoint).returncode == 0
    assert robot.wait_until_over() == 0
    assert time.monotonic() - begin < 30
    assert pid is not None
    eventually(lambda: not psutil.pid_exists(pid), "the process is gone")
    assert "left behind" not in robot.output


def test_the_loop_that_async_nodes_share_outlives_the_one_that_came_first(launch: Launch, folder: Path) -> None:
    needs = {"w1": "talker", "w2": "w1"}
    waiters = "".join(f"      {name}: {{service: 'team:Waiter', needs: [{need}]}}\n" for name, need in needs.items())
    (folder / "m.yaml").write_text(MANIFEST + waiters)
    robot = launch("m.yaml", folder=folder, may_die=["w1"])
    pid = robot.process("w2").pid
    robot.send("w1/do", String("go"))
    robot.wait_for_line("w1 ended with exit code 5")
    robot.wait_for_line("w1 is ready again")
    assert [robot.process(name).pid for name in ("w1", "w2", "a")] == [pid] * 3
    assert robot.process("w2").restarts == 0
