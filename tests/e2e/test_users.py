"""Between users of one machine: what is another's may be looked at, and obeys nobody but its own user."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import intruder
from tests.secured import AS_NOBODY, NOBODY
from tests.support import Desk, Running, eventually, run_robo

pytestmark = [
    pytest.mark.timeout(300),
    pytest.mark.skipif(os.geteuid() != 0, reason="another user is played by root, who may be anybody"),
    pytest.mark.skipif(shutil.which("setpriv") is None, reason="another user is played with setpriv"),
]

READ_ONLY = "the robot r1 belongs to user root; it is read-only for others until root starts it with --share"


class Stranger:
    """Another user at a desk, with a folder of his own.

    Args:
        desk: where the robot is.
        folder: his.
    """

    def __init__(self, desk: Desk, folder: Path) -> None:
        self._desk = desk
        self._folder = folder
        shutil.copy(Path(intruder.__file__), folder / "intruder.py")
        for place in (folder, folder / "intruder.py"):
            os.chown(place, NOBODY, NOBODY)

    def start(self, words: str, more: str = "") -> Running:
        """Have him run a Python module or file, with more in its environment."""
        places = " ".join(f"{name}={self._folder}" for name in ("HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR"))
        return self._desk.start(
            f"cd {self._folder} && {places} ROBO_MEETING={self._folder}/meeting {more} "
            f"exec {' '.join(AS_NOBODY)} {sys.executable} {words}"
        )

    def robo(self, words: str) -> tuple[int, str]:
        """Have him type a `robo` command that ends."""
        run = self.start(f"-m robo {words}")
        return run.wait(60.0), run.output


@pytest.fixture
def stranger(desk: Desk) -> Iterator[Stranger]:
    """Another user, who can run robo."""
    tried = [*AS_NOBODY, sys.executable, "-c", "import robo"]
    if (done := subprocess.run(tried, capture_output=True, text=True, check=False)).returncode != 0:
        pytest.skip(f"another user cannot run this Python with robo: {done.stderr.strip()[-200:]}")
    with tempfile.TemporaryDirectory(prefix="robo-stranger-") as folder:
        yield Stranger(desk, Path(folder))


def up(desk: Desk, words: str = "", robot: str = "r1") -> Running:
    """A robot at a desk, once it is ready."""
    running = desk.start(f"robo up --robot-name {robot} {words}")
    running.wait_for(f"{robot} is ready")
    return running


def processes(desk: Desk, robot: str = "r1") -> dict[str, tuple[int, int, str]]:
    """Process id, restarts and state of each node."""
    code, output = desk.run(f"robo ps --json --robot-name {robot}")
    assert code == 0, output
    told = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
    return {one["node"]: (one["pid"], one["restarts"], one["state"]) for one in told}


def said(run: Running) -> dict[str, object]:
    """What an intruder says it has come to, once it does."""
    found: dict[str, object] = json.loads(run.wait_for("{", 90.0))
    return found


def ended(run: Running) -> dict[str, object]:
    """What an intruder says last; Zenoh may print a panic of its own as a program ends."""
    found: dict[str, object] = json.loads([line for line in run.output.splitlines() if line.startswith("{")][-1])
    return found


def interrupt(run: Running) -> None:
    """Press Ctrl-C, and wait for the end."""
    run.interrupt()
    run.wait(30.0)


@pytest.mark.parametrize("mode", ["client", "peer", "router"])
def test_another_user_looks_and_does_nothing_whatever_his_program_is(desk: Desk, stranger: Stranger, mode: str) -> None:
    up(desk)
    before = processes(desk)
    assert {state for _, _, state in before.values()} == {"ready"}
    echo = desk.start("robo topic echo r1/cmd_vel_key")
    eventually(lambda: "r1/cmd_vel_key" in desk.run("robo topic list")[1], "the topic is there")
    run = stranger.start(f"intruder.py {mode}")
    tried = said(run)
    looks = {what for what in tried if what.startswith("looks")}
    assert {what for what in tried if tried[what]} == looks, tried
    # While he is there with his token and his queryable.
    assert "/r1/evil" not in desk.run("robo node list")[1]
    code, answer = desk.run("robo service call r1/reset_distance")
    assert code == 0, answer
    code, speed = desk.run("robo param get /r1/waypoint_follower speed")
    assert (code, speed.strip()) == (0, "0.5")
    interrupt(run)
    assert ended(run) == {"asked": 0}
    # What the owner says comes after all that he has said.
    code, told = desk.run("robo topic pub r1/cmd_vel_key geometry/Twist '{linear: {x: 0.125}}' --times 1")
    assert code == 0, told
    echo.wait_for("0.125")
    assert "9.0" not in echo.output
    assert processes(desk) == before, "the robot drives on"


def test_what_an_endpoint_says_is_open_by_choice(desk: Desk, stranger: Stranger) -> None:
    up(desk, "--listen tcp/127.0.0.1:7447")
    run = stranger.start("intruder.py peer")
    tried = said(run)
    assert {what for what in tried if not tried[what]} <= {"sets by wildcard", "calls with wildcards", "reads settings"}
    assert tried["stops a node"]
    assert tried["is linked by nodes"], "gossip leads nodes to him, so it has to be kept from them where he only looks"
    interrupt(run)


def test_every_refusal_says_so_and_whose_the_robot_is(desk: Desk, stranger: Stranger) -> None:
    up(desk)
    before = processes(desk)
    for words in (
        "stop safety_monitor --robot-name r1",
        "restart safety_monitor",
        "down --robot-name r1",
        "down",
        "down --all --everyone",
        "param set /r1/waypoint_follower speed 0.1",
        "service call r1/emergency_stop",
        "topic pub r1/cmd_vel_key geometry/Twist '{linear: {x: 1.0}}' --times 1",
    ):
        code, output = stranger.robo(words)
        assert (code, READ_ONLY in output, "Traceback" in output) == (1, True, False), (words, output)
    for mode in ("router", "client", "peer"):
        tracker = "-m robo_services.position_tracker --robot-name r9 --connect tcp/127.0.0.1:7447"
        node = stranger.start(tracker, f"ROBO_MODE={mode}")
        assert node.wait() == 1
        assert "what runs there belongs to user root; it is read-only for others" in node.output, mode
    code, output = stranger.robo("ps")
    assert code == 0
    assert "no robot of yours runs here; looking at what user root runs" not in output, "root may do all here anyway"
    assert "/r1/safety_monitor" in output
    for words in ("topic list", "topic echo r1/odom --once", "param list /r1/waypoint_follower", "why", "net"):
        code, output = stranger.robo(words)
        assert code == 0, (words, output)
    assert processes(desk) == before


def test_connections_on_which_nothing_is_said_keep_the_owner_from_nothing(desk: Desk, stranger: Stranger) -> None:
    up(desk)
    run = stranger.start("intruder.py idle")
    run.wait_for("there")
    before = processes(desk)
    assert {state for _, _, state in before.values()} == {"ready"}
    code, output = desk.run("robo service call r1/emergency_stop")
    assert code == 0, output
    interrupt(run)


def test_who_shares_lets_others_do_all_with_that_robot_and_no_other(desk: Desk, stranger: Stranger) -> None:
    shared = up(desk, "--share")
    assert "shared with others at tcp/127.0.0.1:7447" in shared.output
    second = up(desk, "--share", robot="r2")
    assert "by the door of what runs here already, which does not share r2" in second.output
    code, output = stranger.robo("stop waypoint_follower --robot-name r1")
    assert (code, "stopped /r1/waypoint_follower" in output) == (0, True), output
    code, output = stranger.robo("service call r1/reset_distance")
    assert code == 0, output
    code, output = stranger.robo("stop waypoint_follower --robot-name r2")
    assert (code, "the robot r2 belongs to user root" in output) == (1, True), output
    assert {state for _, _, state in processes(desk, "r2").values()} == {"ready"}


def test_a_stranger_who_has_the_port_first_is_named_hears_nothing_and_is_not_obeyed(
    desk: Desk, stranger: Stranger
) -> None:
    first = stranger.start("intruder.py first")
    first.wait_for("there")
    robot = up(desk)
    name = "of user nobody"
    assert "port 7447 on 127.0.0.1 is held by process" in robot.output
    assert f"{name}: r1 does not dial it" in robot.output
    before = processes(desk)
    assert {state for _, _, state in before.values()} == {"ready"}
    for words in ("doctor", "net"):
        assert f"{name}: your robots do not dial it" in desk.run(f"robo {words}")[1]
    interrupt(first)
    assert ended(first) == {"obeyed": 0, "links": 0, "told": False}
    assert processes(desk) == before
    code, output = desk.run("robo down")
    assert (code, "r1 is down" in output) == (0, True)


def test_a_tool_that_finds_another_users_robots_for_want_of_its_own_says_whose(desk: Desk, stranger: Stranger) -> None:
    first = stranger.start("intruder.py first")
    first.wait_for("there")
    _, output = desk.run("robo node list")
    assert "no robot of yours runs here; looking at what user nobody runs at tcp/127.0.0.1:7447" in output
    interrupt(first)


def test_robots_of_one_user_meet_and_the_place_is_handed_over(desk: Desk) -> None:
    first = up(desk, robot="r1")
    up(desk, robot="r2")
    code, output = desk.run("robo ps")
    assert (code, "/r1/safety_monitor" in output, "/r2/safety_monitor" in output) == (0, True, True), output
    echo = desk.start("robo topic echo r2/odom --field pose.pose.position.x")
    echo.wait_for("r2/odom")
    first.interrupt()
    first.wait()
    eventually(lambda: "/r1/" not in desk.run("robo ps")[1], "the first one has gone")
    assert "/r2/safety_monitor" in desk.run("robo ps")[1]
    assert desk.run("robo topic echo r2/odom --once")[0] == 0
    up(desk, robot="r3")
    eventually(lambda: all(f"/{r}/" in desk.run("robo ps")[1] for r in ("r2", "r3")), "the third one meets the second")


def test_a_meeting_place_of_somebody_elses_is_not_entered(tmp_path: Path) -> None:
    place = tmp_path / "meeting"
    place.mkdir()
    os.chown(place, NOBODY, NOBODY)
    for words in (("up", "--robot-name", "r1"), ("ps",), ("router",)):
        done = run_robo(*words, env={"ROBO_MEETING": str(place)})
        assert done.returncode == 1, words
        assert f"{place}, where robots of this user meet, belongs to user nobody" in done.stderr, words
        assert "Traceback" not in done.stderr
    link = tmp_path / "link"
    link.symlink_to(tmp_path)
    done = run_robo("up", "--robot-name", "r1", env={"ROBO_MEETING": str(link)})
    assert (done.returncode, f"{link}, where robots of this user meet, is a link" in done.stderr) == (1, True)
