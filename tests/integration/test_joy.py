"""What the node joy tells of a pad that is fed by the test; and that it waits for one that is not there."""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from robo.errors import RunError
from robo.testing.heard import Heard
from robo_messages import Joy as JoyMessage
from robo_services.joy import Joy
from robo_services.teleop_joy import TeleopJoy
from tests.support import PATIENCE, eventually

BUTTON, AXIS, INIT = 0x01, 0x02, 0x80


class PlayedPad:
    """A pipe in the place of /dev/input/js0."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._fd: int | None = None

    def plug_in(self) -> None:
        """It is there, and says at once what it is at, as the kernel does."""
        os.mkfifo(self.path)
        self._fd = os.open(self.path, os.O_RDWR | os.O_NONBLOCK)
        self.say(*((BUTTON | INIT, number, 0) for number in range(6)), (AXIS | INIT, 0, 0), (AXIS | INIT, 1, 0))

    def say(self, *events: tuple[int, int, int]) -> None:
        assert self._fd is not None
        os.write(self._fd, b"".join(struct.pack("=IhBB", 0, value, kind, number) for kind, number, value in events))

    def unplug(self) -> None:
        if self._fd is not None:
            self.path.unlink()
            os.close(self._fd)
            self._fd = None


@pytest.fixture
def pad(tmp_path: Path) -> Iterator[PlayedPad]:
    played = PlayedPad(tmp_path / "js0")
    yield played
    played.unplug()


@pytest.fixture
def heard(robo_session: zenoh.Session) -> Iterator[Heard]:
    found = Heard(robo_session, "**")
    yield found
    found.close()


def joy(session: zenoh.Session, pad: PlayedPad, **parameters: Any) -> Joy:
    return Joy(session=session, parameters={"device": str(pad.path), **parameters})


def wait_for(heard: Heard, axes: list[float], *pressed: int, anew: bool = False) -> JoyMessage:
    buttons = [int(number in pressed) for number in range(6)]

    def is_it(said: JoyMessage) -> bool:
        return said.axes == pytest.approx(axes, abs=1e-4) and said.buttons == buttons

    found: JoyMessage = heard.wait_for("joy", is_it, PATIENCE, anew=anew)
    return found


def test_it_tells_what_a_pad_says(robo_session: zenoh.Session, pad: PlayedPad, heard: Heard) -> None:
    pad.plug_in()
    with joy(robo_session, pad, deadzone=0.1):
        wait_for(heard, [0.0, 0.0])
        pad.say((BUTTON, 4, 1))
        wait_for(heard, [0.0, 0.0], 4)
        pad.say((AXIS, 1, -32767), (AXIS, 0, 3000))
        moved = wait_for(heard, [0.0, 1.0], 4)
        again = wait_for(heard, [0.0, 1.0], 4, anew=True)
        assert again.header.stamp == moved.header.stamp, "stamped with when something moved"
        pad.say((BUTTON, 4, 0))
        wait_for(heard, [0.0, 1.0])


@pytest.mark.parametrize(("rate", "count"), [(100.0, 20), (0.0, 1)])
def test_it_says_it_again_while_nothing_changes(
    robo_session: zenoh.Session, pad: PlayedPad, heard: Heard, rate: float, count: int
) -> None:
    pad.plug_in()
    with joy(robo_session, pad, autorepeat_rate=rate) as node:
        heard.wait_for_count("joy", count, PATIENCE)
        if not rate:
            pad.say((BUTTON, 0, 1))
            wait_for(heard, [0.0, 0.0], 0)
            assert node.status.published["joy"] == 2


def test_axes_that_move_together_are_one_message(robo_session: zenoh.Session, pad: PlayedPad, heard: Heard) -> None:
    pad.plug_in()
    with joy(robo_session, pad, autorepeat_rate=0.0, coalesce_interval_ms=300) as node:
        heard.wait_for_count("joy", 1, PATIENCE)
        for value in range(0, -32767, -3276):
            pad.say((AXIS, 1, value))
        wait_for(heard, [0.0, 0.9998])
        assert node.status.published["joy"] == 2
        pad.say((AXIS, 1, 0))
        pad.say((BUTTON, 2, 1))
        wait_for(heard, [0.0, 0.0], 2)
        assert node.status.published["joy"] == 3, "a button waits for nothing"


def test_a_pad_that_is_not_there_is_waited_for(
    robo_session: zenoh.Session,
    pad: PlayedPad,
    heard: Heard,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("robo_services.joy.RETRY", 0.05)
    caplog.set_level("INFO", "robo.node")
    with joy(robo_session, pad), TeleopJoy(session=robo_session):
        eventually(lambda: "no pad: No such file or directory; it is waited for" in caplog.messages, "it says so")
        pad.plug_in()
        wait_for(heard, [0.0, 0.0])
        pad.say((BUTTON, 4, 1), (AXIS, 1, -32767))
        heard.wait_for("cmd_vel", lambda twist: twist.linear.x == 0.5, PATIENCE)
        heard.clear()
        pad.unplug()
        eventually(lambda: "the pad is gone: it says nothing any more; it is waited for" in caplog.messages, "so again")
        heard.wait_for("cmd_vel", lambda twist: twist.linear.x == 0.0, PATIENCE)
        heard.clear()
        pad.plug_in()
        pad.say((BUTTON, 4, 1), (AXIS, 1, -32767))
        wait_for(heard, [0.0, 1.0], 4)
        assert not any(twist.linear.x for twist in heard.messages("cmd_vel")), "its button was held down"
    assert sum(message.startswith("no pad") for message in caplog.messages) <= 2, "once each time"


def test_it_ends_at_once_with_a_pad_and_without(robo_session: zenoh.Session, pad: PlayedPad) -> None:
    for plugged_in in (False, True):
        if plugged_in:
            pad.plug_in()
        with joy(robo_session, pad, autorepeat_rate=0.0):
            pass


def test_evdev_that_is_not_installed_is_said_at_the_start(
    robo_session: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "evdev", None)
    node = Joy(session=robo_session, parameters={"interface": "evdev"})
    with pytest.raises(RunError, match="robo-zenoh"):
        node.start()
