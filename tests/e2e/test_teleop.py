"""Somebody sits at a terminal and drives the simulated robot by keys; whatever ends it, the robot stands."""

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from robo.testing import Launch, Robot
from robo_messages import Odometry, Trigger
from tests.support import PATIENCE, eventually, plain_environment, run_robo
from tests.typist import Typist

pytestmark = pytest.mark.timeout(180)

KEY_TIMEOUT, FIRST_KEY_TIMEOUT = 0.25, 0.7
"""Of teleop_keyboard, s."""
SPEED = 0.5
"""m/s."""
DROPPED = 4.0
"""A key that has come to nothing for so long was dropped, s: any that was not is no longer held."""
HITS = 10
BRAKING = SPEED / 5.0
"""With the base's deceleration, s."""
SLACK = 1.5
"""Steps of all nodes on the way, and a machine that is busy with other things, s. On an idle one it takes 0.05 s."""

MANIFEST = """\
groups:
  base:
    namespace: r1
    nodes:
      diff_drive_sim:
        service: robo_services.diff_drive_sim
        params: {command_source: safety_monitor, rays: 90}
      safety_monitor:
        service: robo_services.safety_monitor
        remap: {cmd_vel_raw: cmd_vel_key}
"""

LOUD = """\
import robo
from robo_messages import Odometry
from robo_services.teleop_keyboard import TeleopKeyboard

class Loud(TeleopKeyboard):
    def _draw(self, *what: object) -> None:
        super()._draw(*what)
        if self._said.angular.z:
            self.logger.warning("it turns", throttle=60.0)
        if self._said.linear.x < 0:
            raise ValueError("it backs up")
"""

ALONE = plain_environment() | {"ROBO_MODE": "client"}
"""As a router, which a node is by itself, it would meet the robots of other tests at robo's usual port."""


@pytest.fixture(scope="module")
def robot(module_launch: Launch, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder = tmp_path_factory.mktemp("desk")
    (folder / "desk.yaml").write_text(MANIFEST)
    return module_launch("desk.yaml", folder=folder)


class Driver(Typist):
    """A node that runs in a terminal, and somebody who drives by its keys."""

    def __init__(self, robot: Robot, service: Sequence[str], cwd: Path | None, columns: int) -> None:
        words = ["-m", "robo", "run", *service, "--robot-name", "r1", "--connect", robot.endpoint]
        super().__init__([*words, "-r", "cmd_vel:=cmd_vel_key"], ALONE, columns, cwd)

    @property
    def screen(self) -> str:
        """What it has drawn last."""
        return re.sub("\x1b\\[[0-9;?]*[a-zA-Z]", "", self.output.rpartition("\x1b[H")[2])

    def sees(self, text: str) -> None:
        self.wait_until(lambda: text in self.screen)

    def hit(self, keys: bytes, text: str) -> None:
        """Hit keys until the screen shows what comes of them."""
        hit_until(lambda: self.comes_to(lambda: text in self.screen, DROPPED), lambda: self.type(keys))

    def hold(self, key: bytes, seconds: float, delay: float = 0.4, period: float = 0.033) -> float:
        """Hold a key down, as a terminal tells of it. Returns when it was heard last."""
        begin = last = self.type(key)
        time.sleep(delay)
        while time.time() < begin + seconds:
            last = self.type(key)
            time.sleep(period)
        return last


@contextmanager
def at_the_keys(
    robot: Robot,
    first_key_timeout: float = 2.0,
    service: Sequence[str] = (),
    cwd: Path | None = None,
    columns: int = 80,
) -> Iterator[Driver]:
    """The node in a terminal, ready for keys; the robot stands at its start.

    A key that is hit once does not end by itself while a test looks at what ends it.
    """
    robot.call("reset", Trigger.Request())
    words = [*(service or ("robo_services", "teleop_keyboard")), "-p", f"first_key_timeout:={first_key_timeout}"]
    typist = Driver(robot, words, cwd, columns)
    try:
        typist.sees("nearest   ")
        typist.sees("robot     0.00 m/s")
        yield typist
    finally:
        typist.close()


def speed_of(odometry: Odometry) -> float:
    speed: float = odometry.twist.twist.linear.x
    return speed


def comes_to_drive(robot: Robot, hit: Callable[[], float], speed: float = SPEED) -> float:
    """Hit a key until the robot drives. Returns when that was, s since the epoch.

    A node that was held up drops what was typed, as nobody knows how old that is; a busy machine holds up any.
    """

    def does(odometry: Odometry) -> bool:
        return speed_of(odometry) == pytest.approx(speed)

    def seen() -> bool:
        with suppress(AssertionError):
            robot.wait_for("odom", does, timeout=DROPPED, new=True)
            return True
        return False

    return hit_until(seen, hit)


def hit_until(seen: Callable[[], bool], hit: Callable[[], float]) -> float:
    """Hit keys until something is seen, each time for `DROPPED`. Returns when that was, s since the epoch."""
    for _ in range(HITS):
        moment = hit()
        if seen():
            return moment
    raise AssertionError(f"keys were hit {HITS} times and it was not seen")


def stands(robot: Robot) -> None:
    def does(odometry: Odometry) -> bool:
        return odometry.twist.twist.linear.x == odometry.twist.twist.angular.z == 0.0

    robot.wait_for("odom", does, timeout=PATIENCE, new=True)


def stopped_after(robot: Robot, moment: float) -> float:
    """How long after a moment the robot has come to a stand, s."""
    stands(robot)
    moved: list[float] = [
        one.header.stamp.to_nanoseconds() * 1e-9 for one in robot.messages("odom") if speed_of(one) != 0.0
    ]
    return moved[-1] + 0.02 - moment


def was_told_to_stand(robot: Robot) -> None:
    """The last command is 0: the robot stands by it, and not because the monitor heard no more."""
    assert [twist.linear.x for twist in robot.messages("cmd_vel_key")][-1:] == [0.0]


def stays(robot: Robot, messages: int = 50) -> None:
    """It does not move for a second."""
    begun = len(robot.messages("odom"))
    robot.wait_for_count("odom", begun + messages)
    assert {speed_of(one) for one in robot.messages("odom")[begun:]} == {0.0}


def test_a_key_that_is_held_drives_and_when_it_is_let_go_the_robot_stands(robot: Robot) -> None:
    with at_the_keys(robot, FIRST_KEY_TIMEOUT) as typist:
        robot.clear()
        last = typist.hold(b"\x1b[A", 1.5)
        typist.sees("forward 0.50 m/s")
        assert stopped_after(robot, last) < KEY_TIMEOUT + BRAKING + SLACK
        speeds = [speed_of(one) for one in robot.messages("odom")]
        begin = next(index for index, speed in enumerate(speeds) if speed)
        end = len(speeds) - next(index for index, speed in enumerate(reversed(speeds)) if speed)
        # A busy machine may hold up a process, which then takes the key as let go: not for long.
        assert speeds[begin:end].count(0.0) < 0.2 * (end - begin)
        commands = [twist.linear.x for twist in robot.messages("cmd_vel_key")]
        assert commands[-2:] == [SPEED, 0.0], "one 0, and nothing after it"
        typist.sees("stand, no key is held")


def test_a_key_that_is_hit_once_is_let_go(robot: Robot) -> None:
    with at_the_keys(robot, FIRST_KEY_TIMEOUT) as typist:
        robot.clear()
        hit = comes_to_drive(robot, lambda: typist.type(b"w"))
        assert stopped_after(robot, hit) < FIRST_KEY_TIMEOUT + BRAKING + SLACK


@pytest.mark.parametrize("key", [b" ", b"k", b"x", b"\x1b", b"\x13", b"\x1c"])
def test_any_other_key_stops(robot: Robot, key: bytes) -> None:
    with at_the_keys(robot) as typist:
        comes_to_drive(robot, lambda: typist.type(b"w"))
        robot.clear()
        assert stopped_after(robot, typist.type(key)) < 0.05 + BRAKING + SLACK
        stays(robot, 20)


def test_keys_change_how_fast_it_is(robot: Robot) -> None:
    with at_the_keys(robot) as typist:
        typist.hit(b"+rt", "0.61 m/s, 1.21 rad/s")
        comes_to_drive(robot, lambda: typist.type(b"u"), 0.605)
        typist.hit(b"-", "0.54 m/s, 1.09 rad/s")
        typist.hit(30 * b"+", "1.00 m/s, 2.00 rad/s")


def test_a_narrow_terminal(robot: Robot) -> None:
    with at_the_keys(robot, columns=40) as typist:
        typist.sees("w s a d, arrows  drive")
        assert max(map(len, typist.screen.splitlines())) <= 40


def interrupt(typist: Driver) -> None:
    typist.type(b"\x03")


def quit_it(typist: Driver) -> None:
    typist.type(b"q")


def terminate(typist: Driver) -> None:
    typist.program.terminate()


@pytest.mark.parametrize("end", [interrupt, quit_it, terminate])
def test_its_end_leaves_the_robot_standing_and_the_terminal_as_it_was(
    robot: Robot, end: Callable[[Typist], None]
) -> None:
    with at_the_keys(robot) as typist:
        comes_to_drive(robot, lambda: typist.type(b"w"))
        robot.clear()
        moment = time.time()
        end(typist)
        assert stopped_after(robot, moment) < 0.05 + BRAKING + SLACK
        assert typist.shell.wait(PATIENCE) == 0
        was_told_to_stand(robot)
        assert typist.has_its_mode_back()
        assert typist.output.rstrip().endswith("\x1b[?7h\x1b[?25h\x1b[?1049l")
        stays(robot)


def test_a_terminal_that_is_closed_leaves_the_robot_standing(robot: Robot) -> None:
    with at_the_keys(robot) as typist:
        comes_to_drive(robot, lambda: typist.type(b"w"))
        robot.clear()
        moment = time.time()
        typist.hang_up()
        assert stopped_after(robot, moment) < 0.05 + BRAKING + SLACK
        assert typist.shell.wait(PATIENCE) == 0
        was_told_to_stand(robot)
        stays(robot)


def test_ctrl_z_leaves_the_robot_standing_and_keys_typed_meanwhile_are_old(robot: Robot) -> None:
    with at_the_keys(robot) as typist:
        for _ in range(2):
            comes_to_drive(robot, lambda: typist.type(b"w"))
            robot.clear()
            moment = typist.type(b"\x1a")
            assert stopped_after(robot, moment) < 0.1 + BRAKING + SLACK
            eventually(lambda: typist.program.status() == psutil.STATUS_STOPPED, "it is suspended")
            was_told_to_stand(robot)
            assert typist.has_its_mode_back()
            typist.type(20 * b"w")
            typist.program.resume()
            eventually(lambda: not typist.has_its_mode_back(), "keys come at once again")
            stays(robot)
            typist.sees("stand, no key is held")
        comes_to_drive(robot, lambda: typist.type(b"w"))


def test_what_was_typed_while_it_stood_still_is_old(robot: Robot) -> None:
    with at_the_keys(robot) as typist:
        comes_to_drive(robot, lambda: typist.type(b"w"))
        typist.program.suspend()
        robot.clear()
        stands(robot)  # by the timeout of the monitor
        typist.type(20 * b"w")
        typist.program.resume()
        stays(robot)
        comes_to_drive(robot, lambda: typist.type(b"w"))


def test_lines_of_the_log_stand_below_and_an_exception_gives_the_terminal_back(robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "loud.py").write_text(LOUD)
    with at_the_keys(robot, service=["loud.py"], cwd=tmp_path) as typist:
        typist.hit(b"a", "it turns")
        typist.sees("commands r1/cmd_vel_key")
        hit_until(lambda: typist.has_ended(DROPPED), lambda: typist.type(b"s"))
        assert typist.shell.returncode == 1
        assert typist.has_its_mode_back()
        behind = typist.output.rpartition("\x1b[?1049l")[2]
        assert "it turns" in behind, "what was warned of is told again"
        assert "ValueError: it backs up" in behind
        stands(robot)


@pytest.mark.parametrize("words", [(), ("-p", "terminal:=/dev/null"), ("-p", "terminal:=/dev/nowhere")])
def test_without_a_terminal_it_says_what_it_needs(endpoint: str, words: Sequence[str]) -> None:
    done = run_robo("run", "robo_services", "teleop_keyboard", "--robot-name", "r1", "--listen", endpoint, *words)
    assert done.returncode == 1
    reason = {(): "its input is none", ("-p", "terminal:=/dev/null"): "/dev/null is none"}.get(
        tuple(words), "/dev/nowhere cannot be opened: No such file or directory"
    )
    advice = "run it in one: robo run robo_services teleop_keyboard --robot-name r1"
    assert done.stderr == f"error: /r1/teleop_keyboard needs a terminal: {reason}; {advice}\n"


def test_what_is_launched_has_no_terminal(endpoint: str, tmp_path: Path) -> None:
    nodes = "{teleop_keyboard: {service: robo_services.teleop_keyboard, required: true}}"
    (tmp_path / "one.yaml").write_text(f"groups: {{g: {{namespace: r1, nodes: {nodes}}}}}\n")
    done = run_robo("up", str(tmp_path / "one.yaml"), "--listen", endpoint, cwd=str(tmp_path))
    assert "/r1/teleop_keyboard needs a terminal, and what is launched has none; run it in one:" in done.stdout
    assert "Traceback" not in done.stdout


@pytest.mark.skipif(shutil.which("tmux") is None, reason="tmux is not installed")
def test_in_tmux(robot: Robot, tmp_path: Path) -> None:
    robot.call("reset", Trigger.Request())
    server = ["tmux", "-S", str(tmp_path / "tmux"), "-f", "/dev/null"]

    def tmux(*words: str) -> str:
        return subprocess.run(
            [*server, *words], capture_output=True, text=True, check=True, env=ALONE, timeout=PATIENCE
        ).stdout

    def w() -> float:
        tmux("send-keys", "w")
        return time.time()

    def sees(text: str) -> None:
        try:
            eventually(lambda: text in tmux("capture-pane", "-p"), text)
        except AssertionError as error:
            raise AssertionError(f"{error}, in\n{tmux('capture-pane', '-p')}") from None

    command = f"{sys.executable} -m robo run robo_services teleop_keyboard --robot-name r1 --connect {robot.endpoint}"
    try:
        tmux("new-session", "-d", "-x", "80", "-y", "24", "env", "PS1=desk$ ", "bash", "--norc", "--noprofile")
        sees("desk$")
        tmux("send-keys", f"{command} -r cmd_vel:=cmd_vel_key", "Enter")
        sees("robot     0.00 m/s")
        robot.clear()
        last, end = 0.0, time.monotonic() + 1.5
        while time.monotonic() < end:
            tmux("send-keys", "Up")
            last = time.time()
        sees("forward 0.50 m/s")
        assert stopped_after(robot, last) < KEY_TIMEOUT + BRAKING + SLACK
        comes_to_drive(robot, w)
        robot.clear()
        tmux("send-keys", "C-z")
        assert stopped_after(robot, time.time()) < 0.1 + BRAKING + SLACK
        sees("Stopped")
        tmux("send-keys", "fg", "Enter")
        sees("stand, no key is held")
        comes_to_drive(robot, w)
        robot.clear()
        tmux("send-keys", "C-c")
        assert stopped_after(robot, time.time()) < 0.05 + BRAKING + SLACK
        tmux("send-keys", "stty -a", "Enter")
        sees(" icanon ")
        stays(robot)
        # Without a shell nobody could let it go on: Ctrl-Z is a stop like any other key.
        tmux("new-window", f"{command} -p first_key_timeout:=2.0 -r cmd_vel:=cmd_vel_key")
        sees("robot     0.00 m/s")
        for _ in range(2):
            comes_to_drive(robot, w)
            robot.clear()
            tmux("send-keys", "C-z")
            assert stopped_after(robot, time.time()) < 0.1 + BRAKING + SLACK
    finally:
        subprocess.run([*server, "kill-server"], check=False, capture_output=True)
