"""The turns of a node: its own, and those that callbacks name."""

import threading

import pytest

from robo import Node, QoS, service, subscribe, timer
from robo.errors import ContractError
from robo.node.contract_data import ServedData, SubscriptionData, TimerData
from robo.node.contract_text import contract_data, contract_text
from robo.node.endpoints import Endpoints
from robo.node.status import Status
from robo.node.turns import Turns
from robo.wire.reports import TurnStatus
from robo_messages import String, Trigger


class Base(Node):
    """Drives, and can be stopped."""

    @timer(rate=10.0)
    def plan(self) -> None:
        """Take long."""

    @timer(rate=5.0, turn="watch")
    def look(self) -> None:
        """Never wait for the plan."""

    @subscribe("halt", turn="stop")
    def on_halt(self, _: String) -> None:
        """Stop."""

    @service("emergency_stop", turn="stop")
    def stop(self, _: Trigger.Request) -> Trigger.Response:
        return Trigger.Response()


def test_the_contract_says_which_callbacks_have_a_turn_of_their_own() -> None:
    data = contract_data(Base)
    assert data.subscriptions == (SubscriptionData("halt", "std/String", QoS(), "stop"),)
    assert data.services == (ServedData("emergency_stop", "std/Trigger", "stop"),)
    assert data.timers == (TimerData("plan", 10.0), TimerData("look", 5.0, "watch"))
    text = contract_text(data)
    assert "  halt               std/String, turn stop\n" in text
    assert "  emergency_stop     std/Trigger, turn stop\n" in text
    assert "  plan               10 Hz\n  look               5 Hz, turn watch\n" in text


@pytest.mark.parametrize("name", ["stop it", "1st", "a/b", "*"])
def test_a_turn_has_a_plain_name(name: str) -> None:
    for declare in (lambda: subscribe("halt", turn=name), lambda: service("stop", turn=name)):
        with pytest.raises(ContractError, match="names no turn: use letters"):
            declare()
    with pytest.raises(ContractError, match="names no turn: use letters"):
        timer(rate=1.0, turn=name)


def test_callbacks_share_the_turn_that_they_name() -> None:
    turns = Turns()
    stop = turns.of("stop", "on_halt")
    assert turns.of("stop", "stop") is stop
    assert turns.of("stop", "stop") is stop
    assert turns.of("", "plan") is turns.own
    assert turns.of("watch", "look") not in (stop, turns.own)
    assert turns.callbacks == {"stop": ["on_halt", "stop"], "watch": ["look"]}


def test_turns_do_not_wait_for_each_other() -> None:
    turns = Turns()
    entered = threading.Event()

    def stop() -> None:
        with turns.of("stop", "stop"):
            entered.set()

    with turns.own:
        other = threading.Thread(target=stop)
        other.start()
        assert entered.wait(60)
    other.join()


def test_the_status_tells_of_each_turn_and_names_the_callback_that_runs_for_longest() -> None:
    turns, now = Turns(), [100.0]
    status = Status("/base", turns, lambda: now[0])
    stop, watch = turns.of("stop", "stop"), turns.of("watch", "look")
    turns.own.busy, stop.busy = 2.0, 1.0
    turns.own.running, turns.own.since = "plan", 99.0
    watch.running, watch.since = "look", 97.0
    told = status.of(Endpoints(), 0)
    assert told.turns == {
        "stop": TurnStatus(["stop"], 1.0, "", 0.0),
        "watch": TurnStatus(["look"], 3.0, "look", 3.0),
    }
    assert (told.running, told.running_for, told.busy) == ("look", 3.0, 7.0)
