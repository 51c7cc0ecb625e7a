"""`robo` in a terminal: what it prints, how it fails."""

import json
import re
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
import zenoh

import robo as runtime
from robo import Publisher, timer
from robo.tools import net
from robo_messages import LaserScan, String
from tests.support import robo, run_robo


class Beacon(runtime.Node):
    """Publishes at a known rate."""

    words = Publisher(String, "words")
    scan = Publisher(LaserScan, "scan")

    @timer(rate=20.0)
    def tick(self) -> None:
        self.words.publish(String("hello"))
        self.scan.publish(LaserScan(ranges=[1.0, float("inf"), float("nan")]))


def test_topics_are_listed(session: zenoh.Session, endpoint: str) -> None:
    with Beacon(namespace="r1", session=session):
        table = run_robo("topic", "list", "--connect", endpoint)
        assert table.returncode == 0
        assert [line.split() for line in table.stdout.splitlines() if "words" in line] == [
            ["r1/words", "std/String", "1", "0", "-"]
        ]
        verbose = run_robo("topic", "list", "-v", "--robot-name", "r1", "--connect", endpoint)
        assert "r1/words  std/String  -\n  publishers   /r1/beacon\n  subscribers  none\n" in verbose.stdout
        found = [
            json.loads(line) for line in run_robo("topic", "list", "--json", "--connect", endpoint).stdout.splitlines()
        ]
        words = {
            "key": "r1/words",
            "type": "std/String",
            "types": ["std/String"],
            "publishers": ["/r1/beacon"],
            "subscribers": [],
        }
        assert {**words, "rate": None} in found


def test_clocks_that_differ_are_told_beside_delays(session: zenoh.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    with Beacon(namespace="r1", session=session):
        assert net.clocks_off(session, {"/r1/beacon"}, 5.0) == {}
        ahead = SimpleNamespace(monotonic=time.monotonic, time=lambda: time.time() + 5)
        monkeypatch.setattr(net, "time", ahead)
        told = net.clocks_off(session, {"/r1/beacon"}, 5.0)["/r1/beacon"]
        assert re.search(r"the clock of /r1/beacon on \S+ is -[45]\.\d+ s off", told)


def test_echo_prints_messages(session: zenoh.Session, endpoint: str) -> None:
    with Beacon(namespace="r1", session=session):
        once = run_robo("topic", "echo", "/r1/words", "--once", "--connect", endpoint)
        assert (once.returncode, once.stderr) == (0, "")
        assert once.stdout == "# r1/words  std/String\n{data: hello}\n---\n"
        line = run_robo("topic", "echo", "r1/scan", "--once", "--json", "--connect", endpoint).stdout
        found = json.loads(line)
        assert (found["key"], found["type"]) == ("r1/scan", "sensor/LaserScan")
        assert found["message"]["ranges"] == [1.0, "inf", "nan"]
        assert found["sequence_number"] > 0
        assert found["time"] > 10**18


def test_hz_measures_and_ends(session: zenoh.Session, endpoint: str) -> None:
    with Beacon(namespace="r1", session=session):
        result = run_robo("topic", "hz", "r1/words", "--json", "--duration", "1.5", "--connect", endpoint)
        windows = [json.loads(line) for line in result.stdout.splitlines()]
        assert windows
        assert all({"key", "rate", "count", "min", "max", "std"} <= set(window) for window in windows)
        assert 2 < windows[0]["rate"] < 100


def test_a_reader_that_leaves_is_no_error(session: zenoh.Session, endpoint: str) -> None:
    with Beacon(namespace="r1", session=session):
        command = f"{sys.executable} -m robo topic echo r1/words --json --connect {endpoint} | head -n 1"
        result = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60, check=False)
        assert json.loads(result.stdout)["message"] == {"data": "hello"}
        assert result.stderr == ""


def test_ctrl_c_is_quiet(session: zenoh.Session, endpoint: str) -> None:
    with Beacon(namespace="r1", session=session), robo("topic", "echo", "r1/words", "--connect", endpoint) as echo:
        echo.wait_for("hello")
        echo.interrupt()
        assert echo.wait() == 130
        assert "Traceback" not in echo.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("topic", "list"), "`robo up` starts a robot"),
        (("topic", "info", "a"), "nobody listens there"),
        (("topic", "echo", "a", "--field", "b..c"), "write names and indexes"),
        (("topic", "echo", "a", "--filter", "x >"), "something is missing"),
        (("topic", "echo", "a", "--filter", "(" * 100_000), "an expression of 100,000 characters"),
        (("topic", "echo", "a", "--json", "--csv"), "choose one of"),
        (("topic", "pub", "a"), "say which type"),
        (("topic", "pub", "a/*", "std/Bool", "{}"), "publish on one"),
        (("router", "--listen", "nonsense"), "an endpoint looks like tcp/127.0.0.1:7447"),
        (("router", "--network-config", "nowhere.yaml"), "nowhere.yaml cannot be read: No such file"),
        (("router", "--network-config", "README.md"), "README.md"),
        (("router", "--network-config", "/dev/zero"), "/dev/zero cannot be read: it is a device, not a file"),
        (("up", "--network-config", "launch/fleet.yaml"), "description: "),
        (("up", "--host", "arm"), "there is no host 'arm' in it"),
        (("export", "compose", "nowhere.yaml"), "there is no manifest 'nowhere.yaml'"),
        (("graph", "--format", "png"), "use one of text, mermaid, dot, json"),
        (("net", "one"), "name two nodes"),
        (("interface", "show", "nav/Odometri"), "did you mean nav/Odometry?"),
        (("node", "show", "robo_services.position_traker"), "did you mean robo_services.position_tracker?"),
        (("topic", "echo", "r1//odom"), "has an empty part"),
        (("up", "nowhere.yaml"), "there is no manifest 'nowhere.yaml'"),
        (("up", "replay.yaml", "log:=run.log"), "command line: argument log: there is no file "),
        (("up", "robot.yaml", "wrold:=x"), "did you mean world?"),
        (("up", "robot.yaml", "contrl"), "has no group 'contrl'; did you mean control?"),
        (("up", "robot"), "robot.yaml has no group 'robot'; did you mean robot.yaml?"),
        (("up", "fleet.launch.py"), "robot.yaml has no group 'fleet.launch.py'; did you mean fleet.yaml?"),
        (("up", "--robot-name", "r-1"), "command line: robot name 'r-1' is not valid"),
        (("up", "-d", "--wait", "--robot-name", ""), "robot name '' is empty"),
        (("up", "--log-level", "loud"), "use debug, info, warn"),
        (("up", "--dry-run", "params_file:=nowhere.yaml"), "nowhere.yaml does not exist"),
        (("run", "robo_services.position_traker"), "did you mean robo_services.position_tracker?"),
        (
            ("run", "robo_services.position_tracker", "-p", "log_rate:=0"),
            "log_rate = 0: expected float >= 0.001 (reports per second, Hz",
        ),
        (("run", "robo_services.position_tracker", "-r", "odom=x"), "write from:=to"),
        (("run", "robo_services.position_tracker", "--robot-name", "r-1"), "namespace 'r-1' is not valid"),
    ],
)
def test_mistakes_are_told_and_never_a_traceback(words: tuple[str, ...], message: str, endpoint: str) -> None:
    more = ("--connect", endpoint) if words[0] in ("topic", "graph", "net") else ()
    result = run_robo(*words, *more)
    assert result.returncode in (1, 2)
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize(
    "words",
    [
        (),
        *((verb,) for verb in ("up", "router", "run", "graph", "top", "net", "topic", "node", "interface")),
        *(("topic", verb) for verb in ("list", "info", "type", "find", "echo", "pub", "hz", "plot")),
        *(("topic", verb) for verb in ("bw", "delay", "loss")),
        *(("node", verb) for verb in ("list", "info", "show")),
        *(("interface", verb) for verb in ("list", "show", "import")),
        ("export", "compose"),
    ],
)
def test_help(words: tuple[str, ...]) -> None:
    result = run_robo(*words, "--help")
    assert result.returncode == 0
    assert "Usage: robo" in result.stdout
    if words not in ((), ("topic",), ("node",), ("interface",)):
        assert "Examples:" in result.stdout


def test_a_nodes_help_shows_its_contract() -> None:
    for command in (["-m", "robo", "run", "robo_services.safety_monitor"], ["-m", "robo_services.safety_monitor"]):
        result = subprocess.run([sys.executable, *command, "--help"], capture_output=True, text=True, check=True)
        assert "robo run robo_services.safety_monitor" in result.stdout
        for word in ("cmd_vel_raw", "sensor/LaserScan", "min_distance", "0.3"):
            assert word in result.stdout


def test_a_dry_run_prints_the_plan_and_starts_nothing() -> None:
    text = run_robo("up", "--dry-run", "--robot-name", "r7")
    assert text.returncode == 0
    assert "/r7/safety_monitor" in text.stdout
    plan = json.loads(run_robo("up", "--dry-run", "--json", "--robot-name", "r7").stdout)
    assert plan["robot"] == "r7"
    assert plan["processes"][0]["name"] == "diff_drive_sim"
