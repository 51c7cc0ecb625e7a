"""What the node says while keys are held, in a terminal that the test types into."""

import os
import termios
from collections.abc import Iterator

import pytest
import zenoh

from robo import MessageInfo, Node, subscribe
from robo.testing.heard import Heard
from robo_messages import Twist
from robo_services.teleop_keyboard import TeleopKeyboard
from tests.support import PATIENCE, eventually


class Base(Node):
    """Remembers what it was commanded, and how old that was."""

    def on_start(self) -> None:
        self.commands: list[tuple[Twist, float]] = []

    @subscribe("cmd_vel", depth=100)
    def on_command(self, twist: Twist, info: MessageInfo) -> None:
        self.commands.append((twist, info.age))


class Keys:
    """A terminal's other end."""

    def __init__(self) -> None:
        self.leader, self._follower = os.openpty()
        self.path = os.ttyname(self._follower)
        self.mode = termios.tcgetattr(self._follower)

    def type(self, keys: bytes) -> None:
        os.write(self.leader, keys)

    def has_its_mode_back(self) -> bool:
        return termios.tcgetattr(self._follower) == self.mode

    def close(self) -> None:
        os.close(self.leader)
        os.close(self._follower)


@pytest.fixture
def keys() -> Iterator[Keys]:
    made = Keys()
    yield made
    made.close()


@pytest.fixture
def base(robo_session: zenoh.Session) -> Iterator[Base]:
    with Base(session=robo_session) as node:
        yield node


def teleop(session: zenoh.Session, keys: Keys, **parameters: object) -> TeleopKeyboard:
    return TeleopKeyboard(session=session, parameters={"terminal": keys.path, **parameters})


def stood(base: Base) -> bool:
    return bool(base.commands) and base.commands[-1][0] == Twist()


@pytest.mark.parametrize("use_sim_time", [False, True])
def test_a_key_that_is_hit_is_said_at_its_rate_and_one_0_after_it(
    robo_session: zenoh.Session, keys: Keys, base: Base, use_sim_time: bool
) -> None:
    timing = {"first_key_timeout": 0.5, "repeat_rate": 50.0, "use_sim_time": use_sim_time}
    with teleop(robo_session, keys, **timing) as node:
        eventually(lambda: not keys.has_its_mode_back(), "it reads keys")
        keys.type(b"w")
        eventually(lambda: stood(base), "the key is let go")
        speeds = [twist.linear.x for twist, _ in base.commands]
        assert speeds == [*(len(speeds) - 1) * [0.5], 0.0]
        assert 1 < len(speeds) <= 28
        assert node.status.callback_errors == 0
    assert speeds == [twist.linear.x for twist, _ in base.commands], "nothing more is said at its end"
    assert keys.has_its_mode_back()


def test_what_repeats_grows_old(robo_session: zenoh.Session, keys: Keys, base: Base) -> None:
    with teleop(robo_session, keys, key_timeout=1.0, first_key_timeout=1.0):
        eventually(lambda: not keys.has_its_mode_back(), "it reads keys")
        keys.type(b"ww")
        eventually(lambda: stood(base), "the key is let go")
    ages = [age for twist, age in base.commands if twist != Twist()]
    assert ages == sorted(ages)
    assert 0.2 < ages[-1] < 1.1, "a machine that is busy may let it go sooner"
    assert base.commands[-1][1] < 0.5


def test_keys_set_parameters_and_parameters_show(robo_session: zenoh.Session, keys: Keys, base: Base) -> None:
    with teleop(robo_session, keys, first_key_timeout=2.0) as node:
        events = Heard(robo_session, "parameter_events")
        eventually(lambda: not keys.has_its_mode_back(), "it reads keys")
        keys.type(b"u")
        eventually(lambda: bool(base.commands), "it drives")
        keys.type(b"-")
        eventually(lambda: base.commands[-1][0].linear.x == pytest.approx(0.45), "slower, while the key is held")
        assert [node.parameters.speed, node.parameters.turn] == pytest.approx([0.45, 0.9])
        events.wait_for("parameter_events", lambda event: len(event.changed_parameters) == 2, PATIENCE)
        node.set_parameters(speed_limit=0.2)
        eventually(lambda: base.commands[-1][0].linear.x == pytest.approx(0.2), "no faster than its limit")
        events.close()
    eventually(lambda: stood(base), "the end of the node is that of the key")


def test_it_may_start_again(robo_session: zenoh.Session, keys: Keys, base: Base) -> None:
    node = teleop(robo_session, keys)
    for count in (1, 2):
        with node:
            eventually(lambda: not keys.has_its_mode_back(), "it reads keys")
            keys.type(b" ")
            eventually(lambda: bool(base.commands), f"start {count}: a stop is said")
        base.commands.clear()
        assert keys.has_its_mode_back()


def test_it_ends_by_a_key(robo_session: zenoh.Session, keys: Keys) -> None:
    with teleop(robo_session, keys) as node:
        eventually(lambda: not keys.has_its_mode_back(), "it reads keys")
        keys.type(b"q")
        assert node.wait(PATIENCE)
        assert node.exit_code == 0
