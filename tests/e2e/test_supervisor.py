"""What the supervisor promises: nothing dies unseen, nothing survives unwanted."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from robo.testing import Launch
from tests.conftest import free_port
from tests.support import PATIENCE, Command, eventually, robo, run_robo

pytestmark = pytest.mark.timeout(120)


def write(folder: Path, text: str) -> str:
    path = folder / "m.yaml"
    path.write_text(text)
    return str(path)


def processes(endpoint: str) -> dict[str, dict[str, Any]]:
    """What `robo ps` tells, by node."""
    result = run_robo("ps", "--json", "--connect", endpoint)
    assert result.returncode == 0, result.stderr
    found = [json.loads(line) for line in result.stdout.splitlines()]
    return {status["node"]: status for status in found}


def tell(endpoint: str, *words: str) -> str:
    result = run_robo(*words, "--connect", endpoint)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_a_killed_node_comes_back_and_its_peers_hear_it_again(launch: Launch, tmp_path: Path) -> None:
    file = write(
        tmp_path,
        """
groups:
  g:
    namespace: r1
    nodes:
      base: {service: robo_services.diff_drive_sim, restart: {policy: on-failure, delay: 0.3}}
      tracker: {service: robo_services.position_tracker}
""",
    )
    robot = launch(file)
    robot.wait_for_line("r1 is ready: 2 nodes")
    robot.wait_for_count("current_position", 3)
    robot.kill("base")
    robot.wait_for_line("base was killed by SIGKILL; starting it again in 0.")
    robot.wait_for_line("base is ready again")
    robot.clear()
    robot.wait_for_count("current_position", 3)  # the tracker hears the new base
    found = processes(robot.endpoint)
    assert (found["/r1/base"]["state"], found["/r1/base"]["restarts"]) == ("ready", 1)
    assert psutil.Process(found["/r1/base"]["pid"]).cmdline()[-1] == "/r1/base"
    assert {"robot", "group", "node", "state", "pid", "restarts", "uptime", "cpu", "memory"} <= set(
        found["/r1/tracker"]
    )
    assert (found["/r1/tracker"]["robot"], found["/r1/tracker"]["group"]) == ("r1", "g")
    told = tell(robot.endpoint, "why", "base")
    assert "/r1/base is ready" in told
    assert "killed by SIGKILL, after" in told


def test_a_template_that_is_told_to_stop_while_it_imports_says_nothing() -> None:
    script = (
        "import os, signal; from robo.process import lean, template\n"
        "lean.import_msgspec = lambda: os.kill(os.getpid(), signal.SIGINT)\n"
        "template.main()"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert (result.returncode, result.stdout, result.stderr) == (-signal.SIGINT, "", "")


def test_nodes_outlive_the_template_that_they_were_forked_from(endpoint: str, tmp_path: Path) -> None:
    file = write(
        tmp_path,
        """
groups:
  g:
    restart: {policy: on-failure, delay: 0.1}
    nodes:
      tracker: {service: robo_services.position_tracker}
      monitor: {service: robo_services.safety_monitor}
""",
    )
    with robo("up", file, "--listen", endpoint) as launch:
        launch.wait_for("is ready: 2 nodes")
        monitor = launch.child("/monitor").pid
        launch.child("robo.process.template").kill()
        launch.child("/tracker").kill()
        launch.wait_for("tracker was killed by SIGKILL")
        launch.wait_for("tracker is ready again")
        assert launch.child("/monitor").pid == monitor
        launch.interrupt()
        assert launch.wait() == 130


def test_a_crash_loop_ends_in_degraded_and_hurts_nobody(launch: Launch, tmp_path: Path) -> None:
    file = write(
        tmp_path,
        """
groups:
  g:
    nodes:
      base: {service: robo_services.diff_drive_sim}
      loop:
        run: [python, -c, "raise ValueError('no such port')"]
        restart: {policy: on-failure, delay: 0.1, max: 2, max_delay: 0.5, jitter: 0}
""",
    )
    robot = launch(file, may_die=["loop"])
    robot.wait_for_line("loop is degraded: ended with exit code 1, more than 2 times in 60 s; next try in 0.5 s")
    waits = [line for line in robot.output.splitlines() if "starting it again in" in line]
    assert [line.partition("again in ")[2] for line in waits] == ["0.1 s", "0.2 s"]
    robot.wait_until("loop", lambda loop: loop.restarts >= 5)
    robot.wait_until("base", lambda base: base.published.get("odom") == pytest.approx(50, rel=0.2))
    told = tell(robot.endpoint, "why", "loop")
    assert "ValueError: no such port" in told


HANGING = """\
import time
from robo import Node, subscribe, timer
from robo_messages import Odometry

class Hanging(Node):
    @timer(rate=10.0)
    def work(self) -> None:
        time.sleep(600)
"""


HANGING_INPUT = """\
    @subscribe("odom")
    def on_odometry(self, odometry: Odometry) -> None:
        pass

"""


def test_a_stopped_node_is_found_hung_and_replaced(launch: Launch, tmp_path: Path) -> None:
    file = write(
        tmp_path,
        """
groups:
  g:
    nodes:
      tracker: {service: robo_services.position_tracker, watchdog: 1.0, restart: {policy: on-failure, delay: 0.1}}
      monitor: {service: robo_services.safety_monitor, watchdog: 1.0}
""",
    )
    robot = launch(file)
    tracker, monitor = robot.process("tracker").pid, robot.process("monitor").pid
    robot.wait_until("monitor", lambda monitor: monitor.published != {})  # beats come
    robot.pause("tracker")
    robot.wait_for_line("tracker is degraded: hangs: no sign of life for 1.")
    robot.wait_for_line("tracker is ready again")
    assert robot.process("tracker").pid not in (tracker, None)
    robot.pause("monitor")  # its policy is never: it is shown, and left alone
    robot.wait_for_line("monitor is degraded: hangs: no sign of life for 1.")
    robot.resume("monitor")
    robot.wait_until("monitor", lambda monitor: monitor.state == "ready")  # it is forgiven
    assert robot.process("monitor").pid == monitor


@pytest.fixture
def ice() -> Iterator[Path]:
    """A control group whose processes get no turn while it is frozen, and do not go either when they are killed."""
    group = Path(f"/sys/fs/cgroup/freezer/robo-test-{os.getpid()}")
    try:
        group.mkdir()
    except OSError as error:
        pytest.skip(f"no freezer of control groups of version 1: {error}")
    yield group
    (group / "freezer.state").write_text("THAWED")
    eventually(lambda: not (group / "cgroup.procs").read_text(), "the group is empty")
    group.rmdir()


def test_a_killed_node_that_takes_long_to_go_does_not_hang(launch: Launch, tmp_path: Path, ice: Path) -> None:
    service = "{service: robo_services.position_tracker, watchdog: 1.0, restart: {policy: on-failure, delay: 0.1}}"
    robot = launch(write(tmp_path, f"groups: {{g: {{nodes: {{tracker: {service}}}}}}}"), may_die=["tracker"])
    robot.wait_until("tracker", lambda tracker: tracker.published != {})  # beats come
    pid = robot.process("tracker").pid
    assert pid is not None
    (ice / "cgroup.procs").write_text(str(pid))
    (ice / "freezer.state").write_text("FROZEN")
    os.kill(pid, signal.SIGKILL)
    robot.wait_for_line("tracker is degraded: is ending, or was killed, and its process is not gone yet")
    (ice / "freezer.state").write_text("THAWED")
    robot.wait_for_line("tracker was killed by SIGKILL")
    robot.wait_for_line("tracker is ready again")
    assert "hangs" not in robot.output


def test_a_callback_that_does_not_return_is_asked_where_it_is(endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "hanging.py").write_text(HANGING)
    file = write(
        tmp_path,
        """
groups:
  g:
    nodes:
      hanging:
        service: hanging
        watchdog: 1.0
        required: true
""",
    )
    with robo("up", file, "--listen", endpoint, cwd=str(tmp_path)) as launch:
        assert launch.wait(60) == 1
        assert re.search(r"hanging failed: hangs: no sign of life for 1\.\d s; work does not return", launch.output)
        assert 'hanging.py", line 8 in work' in launch.output


HANGING_OTHERWISE = {
    "a turn of its own": HANGING.replace("(rate=10.0)", "(rate=10.0, turn='work')"),
    "async": HANGING.replace("    def work", "    async def work"),
}


@pytest.mark.parametrize("how", HANGING_OTHERWISE)
def test_a_callback_that_does_not_return_is_named_whatever_it_is(endpoint: str, tmp_path: Path, how: str) -> None:
    (tmp_path / "hanging.py").write_text(HANGING_OTHERWISE[how])
    file = write(tmp_path, "groups: {g: {nodes: {hanging: {service: hanging, watchdog: 1.0, required: true}}}}")
    with robo("up", file, "--listen", endpoint, cwd=str(tmp_path)) as launch:
        assert launch.wait(60) == 1
        assert re.search(r"hanging failed: hangs: no sign of life for 1\.\d s; work does not return", launch.output)


def test_tools_name_the_callback_that_holds_up_a_node(launch: Launch, tmp_path: Path) -> None:
    (tmp_path / "hanging.py").write_text(HANGING.replace("    @timer", HANGING_INPUT + "    @timer"))
    write(
        tmp_path,
        """
groups:
  g:
    nodes:
      base: {service: robo_services.diff_drive_sim}
      hanging: {service: hanging, watchdog: 600, stop: {timeout: 0.5}}
""",
    )
    robot = launch("m.yaml", folder=tmp_path)
    robot.wait_until("hanging", lambda hanging: hanging.running == "work")  # its heart names the callback
    why = tell(robot.endpoint, "why", "hanging")
    assert re.search(r"its callback work has been running for \d+\.\ds; all others of its turn wait", why)
    assert "received nothing" not in why
    assert re.search(r"/hanging .* work has been running for", tell(robot.endpoint, "ps"))
    info = tell(robot.endpoint, "node", "info", "hanging")
    assert re.search(
        r"callback +work has been running for \d+\.\ds; all others of its turn wait\n  load +100\.0%", info
    )
    seen = json.loads(tell(robot.endpoint, "top", "--once", "--json"))
    assert [(node["node"], node["running"]) for node in seen["nodes"]] == [("/base", ""), ("/hanging", "work")]
    assert "ready, in work for" in tell(robot.endpoint, "top", "--once")


QUIET = """\
from robo import Node, Publisher, timer
from robo_messages import String

class Quiet(Node):
    out = Publisher(String, "data")

    def on_start(self) -> None:
        self.left = 30

    @timer(rate=20.0)
    def speak(self) -> None:
        self.left -= 1
        if self.left > 0:
            self.out.publish(String("x"))
"""


def test_a_node_that_keeps_silent_against_its_promise_is_replaced(launch: Launch, tmp_path: Path) -> None:
    (tmp_path / "quiet.py").write_text(QUIET)
    write(
        tmp_path,
        """
groups:
  g:
    namespace: r1
    topics: {data: {max_age: 0.5}}
    nodes:
      quiet: {service: quiet, watchdog: 2.0, restart: {policy: on-failure, delay: 0.1}}
      patient: {service: quiet, remap: {data: other}, watchdog: 2.0}
""",
    )
    robot = launch("m.yaml", folder=tmp_path, may_die=["quiet"])
    robot.wait_for_line("quiet is degraded: nothing on r1/data for ")
    robot.wait_for_line("quiet hangs: nothing on r1/data for 2.")
    robot.wait_for_line("quiet is ready again")
    assert "patient is degraded" not in robot.output  # nobody promised anything of its topic


def test_a_required_node_ends_the_run_and_its_last_words_are_repeated(endpoint: str, tmp_path: Path) -> None:
    file = write(
        tmp_path,
        """
groups:
  g:
    nodes:
      tracker: {service: robo_services.position_tracker}
      brain:
        run: [python, -c, "raise RuntimeError('the brain is empty')"]
        needs: {tracker: ready}
        required: true
""",
    )
    with robo("up", file, "--listen", endpoint) as launch:
        assert launch.wait() == 1
        end = launch.output[launch.output.index("brain failed: exit code 1") :]
        assert "RuntimeError: the brain is empty" in end


def test_what_needs_a_process_is_started_again_with_it(launch: Launch, tmp_path: Path) -> None:
    file = write(
        tmp_path,
        """
groups:
  g:
    nodes:
      base: {service: robo_services.diff_drive_sim, restart: {policy: on-failure, delay: 0.1, propagate: true}}
      tracker: {service: robo_services.position_tracker, needs: {base: ready}}
      other: {service: robo_services.position_tracker, needs: {tracker: ready}}
      apart: {service: robo_services.position_tracker}
""",
    )
    robot = launch(file)
    before = {one.node: one.pid for one in robot.processes()}
    robot.kill("base")
    for name in ("base", "tracker", "other"):
        robot.wait_for_line(f"{name} is ready again")
    after = {one.node: one.pid for one in robot.processes()}
    assert [name for name in before if before[name] == after[name]] == ["/apart"]


READY = """
groups:
  g:
    namespace: r1
    topics: {{odom: {{rate: ">= 20"}}}}
    nodes:
      server: {{run: [python, -c, "{server}"], ready: {{port: {port}}}}}
      file: {{run: [python, -c, "{slow}"], ready: {{probe: [test, -e, {folder}/made]}}, needs: {{server: ready}}}}
      base: {{service: robo_services.diff_drive_sim, ready: {{topics: [odom]}}, needs: {{file: ready}}}}
      last: {{service: robo_services.position_tracker, needs: {{base: ready}}}}
      never: {{run: [sleep, "600"], ready: {{log: hello, timeout: 0.5}}, restart: never}}
      deaf: {{run: [sleep, "600"], ready: {{topics: [nothing], timeout: 0.5}}, restart: never}}
"""


def test_readiness_by_port_probe_and_data_and_its_limit(launch: Launch, tmp_path: Path) -> None:
    port = free_port()
    file = write(
        tmp_path,
        READY.format(
            port=port,
            folder=tmp_path,
            server="import socket, time; time.sleep(.3); "
            f"s = socket.create_server(('127.0.0.1', {port})); time.sleep(600)",
            slow=f"import time; time.sleep(.3); open('{tmp_path}/made', 'w'); time.sleep(600)",
        ),
    )
    robot = launch(file, may_die=["never", "deaf"])
    robot.wait_for_line("never not ready within 0.5 s: no line of its output holds 'hello'")
    robot.wait_for_line("deaf not ready within 0.5 s: r1/nothing does not come as promised")
    assert robot.process("last").state == "ready"  # the chain is ready
    lines = tell(robot.endpoint, "events", "--json", "--no-follow").splitlines()
    ready = [e["node"] for e in map(json.loads, lines) if e["event"] == "ready"]
    assert ready == ["/r1/server", "/r1/file", "/r1/base", "/r1/last"]


@pytest.fixture
def background(endpoint: str) -> Iterator[str]:
    """Where robots may run in the background: none of them survives its test, however that ends."""
    yield endpoint
    run_robo("down", "--all", "--connect", endpoint)


def test_commands_from_another_terminal(background: str) -> None:
    endpoint = background
    words = ("--robot-name", "r1", "--listen", endpoint)
    started = run_robo("up", "robot.yaml", "demo:=arc", "tracking", "control", "-d", "--wait", *words)
    assert started.returncode == 0, started.stderr
    assert "r1 is ready" in started.stdout
    control = ("twist_mux", "velocity_smoother", "safety_monitor", "velocity_controller")
    assert tell(endpoint, "stop", "control").splitlines() == [f"stopped /r1/{node}" for node in control]
    found = processes(endpoint)
    assert {status["state"] for status in found.values()} == {"ready", "stopped"}
    said = tell(endpoint, "logs", "robo", "control", "--json").splitlines()
    nodes = {json.loads(line)["node"] for line in said}
    assert {"robo"} < nodes <= {"robo", *control}
    assert tell(endpoint, "start", "control").count("started /r1/") == 4
    before = processes(endpoint)["/r1/position_tracker"]["pid"]
    assert tell(endpoint, "restart", "/r1/position_tracker") == "restarted /r1/position_tracker\n"
    assert processes(endpoint)["/r1/position_tracker"]["pid"] != before
    refused = run_robo("stop", "nobody", "--connect", endpoint)
    assert refused.returncode == 1
    assert "robot r1 has no node or group 'nobody'; it has position_tracker" in refused.stderr
    with robo("up", "robot.yaml", "tracking", "--robot-name", "r2", "--listen", endpoint) as second:
        second.wait_for("r2 is ready")
        eventually(lambda: len(processes(endpoint)) == 6, "both robots are seen")
        refused = run_robo("stop", "tracking", "--connect", endpoint)
        assert refused.returncode == 2
        assert "several robots run: r1, r2; say --robot-name" in refused.stderr
        assert tell(endpoint, "stop", "/r2/position_tracker") == "stopped /r2/position_tracker\n"
        assert "r2 is down" in tell(endpoint, "down", "--robot-name", "r2")
        assert second.wait() == 0
    assert tell(endpoint, "down") == "r1 is down\n"
    assert run_robo("ps", "--connect", endpoint).returncode == 1
    kept = run_robo("logs", "--robot-name", "r1", "robo", "-n", "1").stdout
    assert "stopping, as robo down asks" in kept
    of_group = run_robo("logs", "--robot-name", "r1", "control", "--json").stdout
    assert {json.loads(line)["node"] for line in of_group.splitlines()} <= set(control)
    assert of_group
    nobody = run_robo("logs", "--robot-name", "r1", "position_traker")
    assert nobody.returncode == 1
    assert "there is no node or group position_traker; did you mean position_tracker?" in nobody.stderr


def test_a_robot_of_a_fleet_can_be_asked_and_told_by_its_own_name(endpoint: str) -> None:
    started = run_robo("up", "fleet.yaml", "robots:=2", "-d", "--wait", "--listen", endpoint)
    assert started.returncode == 0, started.stderr
    try:
        own = ("--robot-name", "r2")
        assert {line.split()[2] for line in tell(endpoint, "ps", *own).splitlines()[1:]} == {
            *("/r2/diff_drive_sim", "/r2/position_tracker"),
            *("/r2/twist_mux", "/r2/velocity_smoother", "/r2/safety_monitor", "/r2/waypoint_follower"),
        }
        assert tell(endpoint, "restart", "position_tracker", *own) == "restarted /r2/position_tracker\n"
        assert tell(endpoint, "stop", "/r2/position_tracker") == "stopped /r2/position_tracker\n"
        assert "/r2/position_tracker is stopped" in tell(endpoint, "why", *own)
        assert "/r1/" not in tell(endpoint, "why", *own)
        events = tell(endpoint, "events", "--no-follow", *own)
        assert "/r2/position_tracker stopped" in events
        assert "/r1/" not in events
        assert "r2/position_tracker" in tell(endpoint, "logs", *own)
        assert "r1/" not in tell(endpoint, "logs", *own)
        assert "r1/" not in run_robo("logs", *own).stdout  # from files
        nobody = run_robo("restart", "nobody", *own, "--connect", endpoint)
        assert "robot r2 has no node or group nobody" in nobody.stderr
        down = run_robo("down", *own, "--connect", endpoint)
        assert down.stdout == "r2 is stopped; it is part of the run my_robot, which goes on\n"
        assert "`robo start r2` starts it; `robo down --robot-name my_robot` ends the run" in down.stderr
        states = {name: status["state"] for name, status in processes(endpoint).items()}
        assert {name for name, state in states.items() if state == "ready"} == {n for n in states if "/r1/" in n}
        assert len(tell(endpoint, "start", "r2").splitlines()) == 6
        wrong = run_robo("ps", "--robot-name", "r7", "--connect", endpoint)
        assert "no supervisor runs a robot r7; there is my_robot, r1, r2" in wrong.stderr
    finally:
        tell(endpoint, "down")


def test_a_run_in_the_background_that_fails_says_why(endpoint: str, tmp_path: Path) -> None:
    file = write(
        tmp_path,
        "groups:\n  g:\n    nodes:\n      ok: {run: [sleep, '600']}\n"
        "      bad: {run: [python, -c, 'exit(3)'], ready: {log: never}}\n",
    )
    failed = run_robo("up", file, "-d", "--wait", "--listen", endpoint)
    try:
        assert failed.returncode == 1
        assert "my_robot is not all ready: bad ended with exit code 3" in failed.stderr
        assert "it runs on" in failed.stderr
    finally:
        tell(endpoint, "down")
    wrong = run_robo("up", str(tmp_path / "none.yaml"), "-d")
    assert wrong.returncode == 2
    assert "there is no manifest" in wrong.stderr


def test_a_run_in_the_background_that_ends_with_its_failure_is_over_when_that_is_told(
    endpoint: str, tmp_path: Path
) -> None:
    bad = write(tmp_path, "groups: {g: {nodes: {bad: {run: [python, -c, 'exit(3)'], ready: {log: never}}}}}\n")
    for _ in range(3):
        failed = run_robo("up", bad, "-d", "--wait", "--listen", endpoint)
        assert failed.returncode == 1
        assert "my_robot is not all ready: bad ended with exit code 3" in failed.stderr
        assert "it has ended with that; `robo why` tells more" in failed.stderr
    good = write(tmp_path, "groups: {g: {nodes: {ok: {run: [sleep, '600']}}}}\n")
    again = run_robo("up", good, "-d", "--wait", "--listen", endpoint)
    try:
        assert again.returncode == 0, again.stderr
    finally:
        tell(endpoint, "down")


TROUBLE = {
    "stubborn": "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); "
    "signal.signal(signal.SIGINT, signal.SIG_IGN); time.sleep(600)",
    "parent": "import os, time\nfor _ in range(10):\n    if os.fork() == 0: time.sleep(600)\ntime.sleep(600)",
    "flood": "import os\nwhile True: os.write(1, b'x' * 99 + b'\\n' * 1)",
    "binary": "import os, time\nos.write(1, bytes(range(256)) * 10)\n"
    "os.write(2, b'\\xff\\xfe no end')\ntime.sleep(600)",
    "closed": "import os, time\nos.close(1); os.close(2); time.sleep(600)",
}
CLOCK = """\
import time
import robo
from robo import Node, timer

class Ticking(Node):
    def on_start(self) -> None:
        self.late: list[float] = []
        self.due = time.monotonic() + 0.01

    @timer(rate=100.0)
    def tick(self) -> None:
        now = time.monotonic()
        self.late.append(abs(now - self.due))
        self.due = now + 0.01
        if len(self.late) == 300:
            print("p99", sorted(self.late)[297], flush=True)
            self.late.clear()

robo.run(Ticking, [])
"""


def test_troublemakers_are_handled_and_do_not_slow_the_others(endpoint: str, tmp_path: Path) -> None:
    for name, code in TROUBLE.items():
        (tmp_path / f"{name}.py").write_text(code)
    (tmp_path / "clock.py").write_text(CLOCK)
    nodes = "".join(
        f"      {name}: {{run: [python, {tmp_path}/{name}.py], stop: {{timeout: 0.3}}}}\n" for name in TROUBLE
    )
    file = write(
        tmp_path,
        f"groups:\n  g:\n    nodes:\n{nodes}      clock: {{run: [python, {tmp_path}/clock.py], ready: node}}\n",
    )
    with robo("up", file, "--listen", endpoint) as launch:
        launch.wait_for("is ready: 6 nodes")
        launch.wait_for("no end")
        launch.wait_for("left out: it prints too much")
        # How late they are is measured in benchmarks; here they have to tick at all.
        launch.wait_for("p99")
        assert processes(endpoint)["/closed"]["state"] == "ready"
        everything = launch.children()
        launch.interrupt()
        assert launch.wait() == 130
        gone(everything)


def gone(processes: list[psutil.Process], timeout: float = 40.0) -> None:
    _, alive = psutil.wait_procs(processes, timeout=timeout)
    assert not [p for p in alive if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]


@pytest.mark.parametrize("delay", [0.0, 0.15, 0.3, 0.45, 0.6, 1.0])
def test_a_killed_supervisor_leaves_nothing_in_any_phase(delay: float, endpoint: str, tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(
        "import os, time\nfor _ in range(3):\n    if os.fork() == 0:\n        os.setsid()\n"
        "        if os.fork(): os._exit(0)\n        time.sleep(600)\ntime.sleep(600)"
    )
    file = write(
        tmp_path,
        f"groups:\n  g:\n    nodes:\n      parent: {{run: [python, {tmp_path}/parent.py]}}\n"
        "      tracker: {service: robo_services.position_tracker}\n",
    )
    launch = Command("up", file, "--listen", endpoint)
    time.sleep(delay)
    launch.process.kill()
    launch.wait()
    mark = str(tmp_path)

    def living() -> list[psutil.Process]:
        return [p for p in psutil.process_iter() if _names(p, mark, endpoint)]

    eventually(lambda: not living(), "nothing of it is left")
    launch.close()


def _names(process: psutil.Process, *marks: str) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE and any(
            mark in word for word in process.cmdline() for mark in marks
        )
    except psutil.Error:
        return False


def test_a_supervisor_at_rest_does_not_grow(endpoint: str, tmp_path: Path) -> None:
    """A short one; `benchmarks.soak` takes an hour, and measures processor time too."""
    file = write(
        tmp_path,
        """
groups:
  g:
    nodes:
      node: {service: robo_services.position_tracker, replicas: 10}
""",
    )
    with robo("up", file, "--listen", endpoint) as launch:
        launch.wait_for("is ready: 10 nodes")
        for _ in range(3):
            processes(endpoint)
        supervisor = psutil.Process(launch.process.pid)
        before = supervisor.memory_info().rss
        for _ in range(12):
            assert len(processes(endpoint)) == 10
        assert supervisor.memory_info().rss - before < 2e6


IN_A_TERMINAL = """\
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "robo", "up", "--listen", sys.argv[1]])
"""


def test_a_closed_terminal_ends_the_run(endpoint: str) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", IN_A_TERMINAL, endpoint]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True) as launch:
        os.close(theirs)
        shown = b""
        while b"is ready" not in shown:
            shown += os.read(ours, 4096)
        children = psutil.Process(launch.pid).children(recursive=True)
        os.close(ours)
        assert launch.wait(40) == 0
    gone(children)


WITHOUT_GROUPS = """\
import os, signal, subprocess, sys
from pathlib import Path
from robo.machine import guard
from robo.machine.cgroup import ControlGroup

ControlGroup.make = classmethod(lambda cls, run: None)
folder = Path(sys.argv[1])
dog = guard.Watchdog("no-such-run", folder / "sockets")
quiet = subprocess.DEVNULL
sleepers = [subprocess.Popen(["env", "-i", "sleep", "600"], stdout=quiet, start_new_session=True) for _ in range(2)]
dog.note(sleepers[0].pid, True)
dog.note(sleepers[1].pid, True)
dog.note(sleepers[1].pid, False)
print(sleepers[0].pid, sleepers[1].pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_process_without_its_environment_is_ended_where_there_are_no_control_groups(tmp_path: Path) -> None:
    killed = subprocess.run(
        [sys.executable, "-c", WITHOUT_GROUPS, str(tmp_path)], stdout=subprocess.PIPE, text=True, check=False
    )
    assert killed.returncode == -signal.SIGKILL
    noted, ended = (psutil.Process(int(pid)) for pid in killed.stdout.split())
    try:
        gone([noted])
        assert ended.is_running()  # the one that was noted as ended is somebody else's by now
    finally:
        ended.kill()


NOTHING_FOUND = """\
import os, signal, subprocess, sys
from pathlib import Path
from robo.machine import guard
from robo.wire.run_id import new_run_id

def fails(*words, **more):
    raise OSError("a machine on which nothing can be read")

guard.sweep = fails
dog = guard.Watchdog(new_run_id(), Path(sys.argv[1]) / "sockets")
if dog._group is None:
    sys.exit("no group")
sleeper = subprocess.Popen(["sleep", "600"], stdout=subprocess.DEVNULL, start_new_session=True)
print(sleeper.pid, dog._group.folder, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_control_group_is_ended_also_where_looking_for_processes_fails(tmp_path: Path) -> None:
    killed = subprocess.run(
        [sys.executable, "-c", NOTHING_FOUND, str(tmp_path)], capture_output=True, text=True, check=False
    )
    if "no group" in killed.stderr:
        pytest.skip("this user may make no control group")
    assert killed.returncode == -signal.SIGKILL
    sleeper, folder = killed.stdout.split()
    with suppress(psutil.NoSuchProcess):  # which it may be by now
        gone([psutil.Process(int(sleeper))])
    eventually(lambda: not Path(folder).exists(), "the group is removed")


def test_a_later_run_ends_what_an_earlier_one_has_left(endpoint: str) -> None:
    """Supervisor and watchdog killed at once; only the id in the environment tells."""
    with robo("up", "robot.yaml", "tracking", "--robot-name", "r1", "--listen", endpoint) as first:
        first.wait_for("r1 is ready")
        sleeper = subprocess.Popen(
            [sys.executable, "-c", "import time; time.sleep(600)"],
            env={"ROBO_RUN": first.child("/r1/position_tracker").environ()["ROBO_RUN"]},
        )
        first.interrupt()
        first.wait()
    sleeper.poll()
    try:
        if sleeper.returncode is None:  # the first run may have found it at its end
            with robo("up", "robot.yaml", "tracking", "--robot-name", "r2", "--listen", endpoint) as second:
                second.wait_for("that an earlier run had left behind")
        sleeper.wait(40)
    finally:
        sleeper.kill()
        sleeper.wait(40)


SOURCE = """\
from robo import Node, timer

class Watched(Node):
    @timer(rate=20.0)
    def speak(self) -> None:
        self.logger.info("version {}", throttle=60)
"""


def test_changed_files_restart_what_they_touch(launch: Launch, tmp_path: Path) -> None:
    (tmp_path / "watched.py").write_text(SOURCE.replace("{}", "one"))
    (tmp_path / "params.yaml").write_text("tracker: {log_rate: 1.0}\n")
    text = (
        "groups:\n  g:\n    params: params.yaml\n    nodes:\n"
        "      watched: {service: watched}\n      tracker: {service: robo_services.position_tracker}\n"
    )
    write(tmp_path, text)
    robot = launch("m.yaml", folder=tmp_path, options=["--watch"], may_die=["watched"])
    robot.wait_for_line("version one")
    robot.wait_until("watched", lambda watched: watched.published != {})  # beats come
    tracker = robot.process("tracker").pid
    (tmp_path / "watched.py").write_text(SOURCE.replace("{}", "two"))
    robot.wait_for_line("version two")
    assert robot.process("tracker").pid == tracker
    watched = robot.process("watched").pid
    (tmp_path / "params.yaml").write_text("tracker: {log_rate: 2.0}\n")
    robot.wait_for_line("tracker is ready again")
    assert robot.process("watched").pid == watched
    (tmp_path / "watched.py").write_text("def broken(:\n")
    robot.wait_for_line("watched ended with exit code 1")
    (tmp_path / "watched.py").write_text(SOURCE.replace("{}", "three"))
    robot.wait_for_line("version three")  # what has failed is tried again once it is mended
    watched = robot.process("watched").pid
    write(tmp_path, text + "      third: {servce: x}\n")
    robot.wait_for_line("unknown key 'servce'")
    write(tmp_path, text + "      third: {service: robo_services.safety_monitor}\n")
    robot.wait_for_line("third is ready")
    write(tmp_path, text)
    robot.wait_for_line("third is stopped")
    assert robot.process("watched").pid == watched


def test_the_doctor_examines_and_proves_the_promise(endpoint: str) -> None:
    result = run_robo("doctor", "--kill-test", "--json", "--connect", endpoint)
    found = {one["check"]: one for one in map(json.loads, result.stdout.splitlines())}
    faults = {check for check, one in found.items() if one["verdict"] == "fault"}
    # Beside this test another one may just have killed a supervisor.
    assert faults <= {"leftovers"}, [found[check] for check in faults]
    assert result.returncode == bool(faults)
    assert {"python", "packages", "port", "multicast", "router", "clock", "files", "leftovers"} <= set(found)
    assert found["kill test"]["verdict"] == "ok"
    assert "Traceback" not in result.stderr
