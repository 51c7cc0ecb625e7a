"""serial_base and the board that is played for it, on a pseudo-terminal and in real time."""

import math
import os
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robo import Node, Publisher, timer
from robo.errors import RunError
from robo.testing.heard import Heard
from robo_messages import BatteryState, JointState, Odometry, Trigger, Twist, Vector3
from robo_services.emulated_board import EmulatedBoard
from robo_services.serial_base import SerialBase
from robo_services.serial_port import SerialPort
from robo_services.waiting import is_readable
from tests.support import PATIENCE, eventually

ERROR = 2


class Driver(Node):
    """Commands a base."""

    command = Publisher(Twist, "cmd_vel")

    def on_start(self) -> None:
        self.twist: Twist | None = None

    @timer(rate=20.0)
    def drive(self) -> None:
        if self.twist is not None:
            self.command.publish(self.twist)


class Robot:
    """A base, its board and who drives it."""

    def __init__(self, session: zenoh.Session, folder: Path, base: dict[str, Any], board: dict[str, Any]) -> None:
        self.link = folder / "board"
        self.board = EmulatedBoard(session=session, parameters={"link": str(self.link), **board})
        self.base = SerialBase(session=session, parameters={"port": str(self.link), **base})
        self.driver = Driver(session=session)
        self.heard = Heard(session, "**")

    def drive(self, linear: float, angular: float = 0.0) -> None:
        self.driver.twist = Twist(Vector3(linear), Vector3(z=angular))

    def wait_for_odometry(self, wanted: Any, *, anew: bool = False) -> Odometry:
        found: Odometry = self.heard.wait_for("odom", wanted, PATIENCE, anew=anew)
        return found

    def drives(self) -> None:
        """Wait until odometry says that it does."""
        self.wait_for_odometry(lambda odom: odom.twist.twist.linear.x > 0.3, anew=True)

    def is_asked_anew(self) -> None:
        """Wait until the base has heard what the board counts from now on."""
        for _ in range(2):  # the first may be on its way
            self.wait_for_odometry(lambda _: True, anew=True)

    def call(self, method: Any) -> None:
        method(Trigger.Request())

    @property
    def state(self) -> tuple[int, str]:
        health = self.base.board_answers()
        return health.level, health.message

    @property
    def error(self) -> float:
        """Between where odometry has it and where it is, m; where it stands."""
        x, y, _ = self.base._track.track.pose
        return math.hypot(x - self.board._board.pose.x, y - self.board._board.pose.y)


@contextmanager
def robot(session: zenoh.Session, folder: Path, base: dict[str, Any], board: dict[str, Any]) -> Iterator[Robot]:
    made = Robot(session, folder, base, board)
    with ExitStack() as undo:
        undo.callback(made.heard.close)
        for node in (made.board, made.base, made.driver):
            undo.enter_context(node)
        yield made


def test_it_drives_and_says_where_it_is(robo_session: zenoh.Session, tmp_path: Path) -> None:
    with robot(robo_session, tmp_path, {"joint_states": True, "battery_pin": 0}, {"garbled": 0.01}) as r:
        r.drive(0.5, 0.2)
        odometry = r.wait_for_odometry(lambda odom: odom.pose.pose.position.x > 0.5)
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
        assert odometry.pose.covariance[0] > 1e-6
        moved = r.heard.wait_for("tf", lambda tf: tf.transforms[0].transform.translation.x > 0.5, PATIENCE)
        assert moved.transforms[0].child_frame_id == "base_link"
        joints: JointState = r.heard.wait_for("joint_states", lambda state: state.position[0] > 1.0, PATIENCE)
        assert joints.name == ["left_wheel_joint", "right_wheel_joint"]
        battery: BatteryState = r.heard.wait_for("battery", lambda _: True, PATIENCE)
        assert battery.voltage == pytest.approx(791 / 1023 * 5.0, abs=1e-3)
        r.drive(0.0)
        eventually(lambda: r.board._board.rates.left == 0.0, "it stands")
        r.wait_for_odometry(lambda odom: odom.twist.twist.linear.x == 0.0, anew=True)
        eventually(lambda: r.error < 0.01, "and knows where")
        assert r.state[0] == 0


def test_when_commands_end_it_stands(robo_session: zenoh.Session, tmp_path: Path) -> None:
    with robot(robo_session, tmp_path, {"cmd_vel_timeout": 0.3}, {"watchdog": 60.0}) as r:
        r.drive(0.5)
        r.drives()
        r.driver.twist = None
        eventually(lambda: r.board._board.rates.left == 0.0, "the base itself says so, not the board's watchdog")
        r.drive(0.5)
        r.drives()


def test_with_a_command_that_is_not_finite_it_stands_at_once(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with robot(robo_session, tmp_path, {"cmd_vel_timeout": 10.0}, {"watchdog": 60.0}) as r:
        r.drive(0.5)
        r.drives()
        r.drive(math.nan)
        eventually(lambda: r.board._board.rates.left == 0.0, "long before the command is too old")
        assert "the wheels stand: a command holds NaN" in caplog.text
        assert "the wheels stand: no command" not in caplog.text
        r.drive(0.5)
        r.drives()


def test_where_simulated_time_stands_still_it_stands_when_commands_end(
    robo_session: zenoh.Session, tmp_path: Path
) -> None:
    """Nobody says /clock."""
    with robot(robo_session, tmp_path, {"cmd_vel_timeout": 0.3, "use_sim_time": True}, {"watchdog": 60.0}) as r:
        r.drive(0.5)
        r.drives()
        r.driver.twist = None
        eventually(lambda: r.board._board.rates.left == 0.0, "the wheels are real")


def test_when_the_node_ends_it_stands(robo_session: zenoh.Session, tmp_path: Path) -> None:
    with robot(robo_session, tmp_path, {}, {"watchdog": 60.0}) as r:
        r.drive(0.5)
        r.drives()
        r.base.close()
        eventually(lambda: r.board._board.rates.left == 0.0, "it was told so")


def test_a_wheel_that_does_not_count_is_told_of_and_stands(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with robot(robo_session, tmp_path, {}, {}) as r:
        r.drive(0.5)
        r.drives()
        r.board.set_parameters({"dead_encoder": "left"})
        text = "the wheels stand: the left wheel does not count: encoder, wires, motor or its power"
        eventually(lambda: r.state == (ERROR, text), "the state says so")
        eventually(lambda: r.board._board.rates.left == r.board._board.rates.right == 0.0, "both stand")
        eventually(lambda: text in caplog.text, "the log says so")
        r.board.set_parameters({"dead_encoder": "none"})
        r.drive(0.0)
        eventually(lambda: r.state == (0, ""), "told to stand it begins anew")
        r.drive(0.5)
        r.drives()


def test_unplugged_it_stands_and_plugged_in_it_goes_on(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with robot(robo_session, tmp_path, {}, {"power_by_usb": False}) as r:
        r.drive(0.5)
        r.drives()
        r.call(r.board.unplug)
        eventually(lambda: r.board._board.stood < math.inf, "by its own watchdog")
        assert r.board._board.stood - r.board._board.commanded < 0.3, "s of its own time"
        eventually(lambda: "No such file or directory; it is waited for" in r.state[1], "the state says why")
        assert r.state[0] == ERROR
        eventually(lambda: "stands by its own watchdog" in caplog.text, "the log says so")
        stood = r.base._track.track.pose
        r.call(r.board.replug)
        played = r.board._board.time
        eventually(lambda: r.board._board.stood == math.inf, "it drives")
        assert r.board._board.time - played < 1.0, "s of its own time, in which it does not count when it is held up"
        r.drives()
        assert r.state == (0, "")
        r.drive(0.0)
        eventually(lambda: r.board._board.rates.left == 0.0, "it stands")
        eventually(lambda: r.error < 0.01, "what it coasted unheard is counted too")
        assert r.base._track.track.pose.x > stood.x


def test_a_board_that_begins_anew_is_told_of_and_makes_no_jump(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with robot(robo_session, tmp_path, {}, {"starting": 0.2}) as r:
        r.drive(0.5)
        before = r.wait_for_odometry(lambda odom: odom.pose.pose.position.x > 0.7)
        r.call(r.board.reset_board)
        eventually(lambda: "the board has begun anew" in caplog.text, "it is told")
        after = r.wait_for_odometry(lambda _: True, anew=True)
        assert after.pose.pose.position.x >= before.pose.pose.position.x
        assert r.error < 0.2


def test_without_power_by_usb_nothing_is_counted_and_the_pose_stays(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with robot(robo_session, tmp_path, {}, {}) as r:
        r.drive(0.5)
        r.wait_for_odometry(lambda odom: odom.pose.pose.position.x > 0.3)
        r.drive(0.0)
        eventually(lambda: r.board._board.rates.left == 0.0, "it stands")
        r.is_asked_anew()
        assert r.error < 0.01, "and knows where"
        stood = r.base._track.track.pose
        r.call(r.board.unplug)
        eventually(lambda: r.state[0] == ERROR, "it is gone")
        r.call(r.board.replug)
        eventually(lambda: "the board has begun anew" in caplog.text, "it counts from 0, which is told")
        assert r.base._track.track.pose == stood
        r.drive(0.5)
        r.drives()
        assert r.base._track.track.pose.x > stood.x


def test_a_board_that_falls_silent_is_asked_anew_and_not_opened_anew(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To open it would have many a board begin anew, which takes it longer than the silence was."""
    opened: list[str] = []

    class Counted(SerialPort):
        def __init__(self, place: str, baud: int) -> None:
            opened.append(place)
            super().__init__(place, baud)

    monkeypatch.setattr("robo_services.serial_base.SerialPort", Counted)
    with robot(robo_session, tmp_path, {}, {"starting": 1.0}) as r:
        r.drive(0.5)
        r.drives()
        r.call(r.board.reset_board)
        eventually(lambda: "the board is gone: no answer for 0.5 s" in caplog.text, "it is told")
        r.drives()
        assert r.state == (0, "")
    assert len(opened) == 1


def test_what_a_line_does_not_carry_is_thrown_away(
    robo_session: zenoh.Session, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    with robot(robo_session, tmp_path, {}, {"watchdog": 60.0}) as r:
        r.drive(0.5)
        r.drives()
        with monkeypatch.context() as slow:
            slow.setattr(SerialPort, "unsent", lambda _: 33)  # a pseudo-terminal always says 0
            eventually(lambda: r.board._board.rates.left == 0.0, "the last that is said is to stand")
            eventually(lambda: "it takes too little, 33 bytes have not left" in caplog.text, "it is told")
        r.drives()


def test_what_is_no_board_is_refused_with_what_it_says(
    robo_session: zenoh.Session, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robo_services.serial_base.REFUSED", 0.05)
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    try:
        with SerialBase(session=robo_session, parameters={"port": os.ttyname(theirs), "start_timeout": 0.5}) as base:
            assert is_readable(ours, PATIENCE), "it is asked who it is"
            os.write(ours, b"$GPRMC,081836,A,3751.65,S,14507.36,E\r\n")
            eventually(lambda: "has no such board: it does not answer" in base.board_answers().message, "it says so")
            eventually(lambda: "GPRMC" in caplog.text, "so does the log")
            os.set_blocking(ours, False)
            assert b"m" not in os.read(ours, 4096), "it was told no speed"

            def says_what_it_said_last() -> bool:
                os.write(ours, b"$GPGGA\r\n")
                return base.board_answers().message.endswith("GPGGA\\r\\n'")

            eventually(says_what_it_said_last, "it says so too")
            assert caplog.text.count("has no such board: it does not answer") == 1, "the log says it once"
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_port_that_somebody_has_is_not_taken(robo_session: zenoh.Session, tmp_path: Path) -> None:
    with robot(robo_session, tmp_path, {}, {}) as r:
        eventually(lambda: r.state[0] == 0, "the first one drives")
        with SerialBase(name="second", session=robo_session, parameters={"port": str(r.link)}) as second:
            eventually(lambda: "another program has it open" in second.board_answers().message, "it says so")


def test_a_link_takes_no_place_of_something_else(robo_session: zenoh.Session, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("a file of somebody")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    for name in ("file", "link"):
        with pytest.raises(RunError, match="can be made: something else is there"):
            EmulatedBoard(session=robo_session, parameters={"link": str(tmp_path / name)}).start()
        assert (tmp_path / name).read_text() == "a file of somebody"


def test_a_cable_is_pulled_while_somebody_waits_for_it(robo_session: zenoh.Session, tmp_path: Path) -> None:
    with EmulatedBoard(session=robo_session, parameters={"link": str(tmp_path / "board")}) as board:
        for _ in range(20):
            assert board.unplug(Trigger.Request()).success
            assert not (tmp_path / "board").is_symlink()
            assert board.replug(Trigger.Request()).success
        assert board.exit_code == 0
        assert not board.stopping
