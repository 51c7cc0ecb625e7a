"""A game pad drives while its button is held, and nobody drives when it is silent."""

import math

import pytest

from robo import MessageInfo, Node, subscribe
from robo.testing import Clock, NodeUnderTest, RunNode
from robo_messages import Joy, Time, Twist, Vector3
from robo_services.teleop_joy import TeleopJoy

PERIOD = 0.05


def joy(*pressed: int, x: float = 0.0, yaw: float = 0.0) -> Joy:
    return Joy(axes=[yaw, x], buttons=[int(number in pressed) for number in range(6)])


def repeat(node: NodeUnderTest[TeleopJoy], clock: Clock, said: Joy, seconds: float, *, age: float = 0.0) -> None:
    """Say the same over and over, as the node joy does."""
    for _ in range(round(seconds / PERIOD)):
        node.send("joy", said, age=age)
        clock.advance(PERIOD)


def said(node: NodeUnderTest[TeleopJoy]) -> list[tuple[float, float]]:
    return [(twist.linear.x, twist.angular.z) for twist in node.published(TeleopJoy.command)]


@pytest.fixture
def teleop(run_node: RunNode) -> NodeUnderTest[TeleopJoy]:
    """With a pad whose buttons nobody has pressed so far."""
    node = run_node(TeleopJoy)
    node.send("joy", joy())
    return node


def test_it_drives_while_a_button_is_held_and_says_0_once(teleop: NodeUnderTest[TeleopJoy], clock: Clock) -> None:
    repeat(teleop, clock, joy(x=1.0), 0.5)
    assert said(teleop) == [], "an axis alone says nothing"
    repeat(teleop, clock, joy(4, x=1.0, yaw=-0.5), 0.2)
    repeat(teleop, clock, joy(5, x=1.0, yaw=-0.5), 0.1)
    repeat(teleop, clock, joy(x=1.0), 1.0)
    assert said(teleop) == [*4 * [(0.5, -0.5)], *2 * [(1.0, -0.75)], (0.0, 0.0)]


def test_a_pad_that_is_silent_is_let_go_and_has_to_be(
    teleop: NodeUnderTest[TeleopJoy], clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    repeat(teleop, clock, joy(4, x=1.0), 0.2)
    teleop.clear()
    clock.advance(0.2)
    assert said(teleop) == []
    clock.advance(0.15)
    assert said(teleop) == [(0.0, 0.0)]
    assert caplog.messages == ["nothing on joy for 0.3 s: the robot stands; let the button go to drive on"]
    clock.advance(5.0)
    repeat(teleop, clock, joy(4, x=1.0), 1.0)
    assert said(teleop) == [(0.0, 0.0)], "it came back with its button held"
    repeat(teleop, clock, joy(), 0.1)
    repeat(teleop, clock, joy(4, x=1.0), 0.1)
    assert said(teleop)[1:] == 2 * [(0.5, 0.0)]


def test_a_pad_that_nobody_touches_may_be_let_go(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    """One without wire that is out of reach: the system repeats the last that it has said."""
    node = run_node(TeleopJoy, still_timeout=2.0)
    node.send("joy", joy())
    for second in range(1, 5):
        moved = joy(4, x=1.0)
        moved.header.stamp = Time(sec=second)
        repeat(node, clock, moved, 1.0)
    assert (0.0, 0.0) not in said(node)
    node.clear()
    repeat(node, clock, moved, 3.0)
    assert said(node)[-1] == (0.0, 0.0)
    assert len(said(node)) == pytest.approx(1.0 / PERIOD, abs=2.0)
    assert caplog.messages[0] == "nothing of the pad has moved for 2 s: the robot stands; let the button go to drive on"
    node.clear()
    repeat(node, clock, joy(), 0.1)
    repeat(node, clock, joy(4, x=1.0), 0.1)
    assert said(node) == 2 * [(0.5, 0.0)]


def test_a_button_that_is_held_from_the_start_does_not_count(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    node = run_node(TeleopJoy)
    repeat(node, clock, joy(4, x=1.0), 1.0)
    assert said(node) == []
    assert caplog.messages == ["its button is held down from the start: let it go to drive"]


class Base(Node):
    """Remembers how old commands are."""

    @subscribe("cmd_vel")
    def on_command(self, _twist: Twist, info: MessageInfo) -> None:
        vars(self).setdefault("ages", []).append(info.age)


def test_what_is_passed_on_is_as_old_as_what_the_pad_said(
    teleop: NodeUnderTest[TeleopJoy], run_node: RunNode, clock: Clock
) -> None:
    base = run_node(Base)
    repeat(teleop, clock, joy(4, x=1.0), 0.5, age=0.2)
    assert vars(base.node)["ages"] == pytest.approx(10 * [0.2], abs=1e-3)
    teleop.clear()
    repeat(teleop, clock, joy(4, x=1.0), 0.5, age=0.31)
    assert said(teleop) == [(0.0, 0.0)], "it is too old, and the last one that was not is so in the end"


def test_a_pad_that_says_no_number_stops_it(
    teleop: NodeUnderTest[TeleopJoy], clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    repeat(teleop, clock, joy(4, x=1.0), 0.1)
    repeat(teleop, clock, joy(4, x=math.nan), 0.2)
    repeat(teleop, clock, joy(4, x=1.0), 0.2)
    assert said(teleop) == [(0.5, 0.0), (0.5, 0.0), (0.0, 0.0)]
    assert caplog.messages[0] == (
        "the pad says what is no number, axis 1 is nan: 1 times so far; let the button go to drive on"
    )


def test_a_pad_that_lacks_what_is_named_says_so(
    run_node: RunNode, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    node = run_node(TeleopJoy, parameters={"enable_button": 11, "axis_linear.x": 7})
    repeat(node, clock, joy(4), 0.5)
    assert caplog.messages == [
        "the pad on joy: enable_button is 11, and it has 6 buttons; axis_linear.x is 7, and it has 2 axes"
    ]


def test_without_a_button_it_drives_as_the_axes_say(run_node: RunNode, clock: Clock) -> None:
    node = run_node(TeleopJoy, require_enable_button=False)
    repeat(node, clock, joy(x=0.5), 0.1)
    clock.advance(1.0)
    repeat(node, clock, joy(x=0.5), 0.05)
    assert said(node) == [(0.25, 0.0), (0.25, 0.0), (0.0, 0.0), (0.25, 0.0)]


@pytest.mark.parametrize(("drives", "left"), [(True, [(0.5, 0.0), (0.0, 0.0)]), (False, [])])
def test_its_end_leaves_the_robot_standing_that_it_drove(
    teleop: NodeUnderTest[TeleopJoy], drives: bool, left: list[tuple[float, float]]
) -> None:
    if drives:
        teleop.send("joy", joy(4, x=1.0))
    teleop.close()
    assert said(teleop) == left


def test_a_strafing_base(run_node: RunNode, clock: Clock) -> None:
    node = run_node(TeleopJoy, parameters={"axis_linear.y": 0, "axis_angular.yaw": -1, "scale_linear.y": 0.3})
    node.send("joy", joy())
    node.send("joy", joy(4, x=-1.0, yaw=1.0))
    assert node.published(TeleopJoy.command) == [Twist(Vector3(-0.5, 0.3))]
    clock.advance(1.0)
