"""Parts of nodes: what they declare is the node's, and each node has one of its own."""

import pytest
import zenoh

from robo import (
    Client,
    ContractError,
    LifecycleNode,
    MessageInfo,
    Node,
    Parameters,
    Part,
    Publisher,
    service,
    subscribe,
    timer,
)
from robo.node.contract import contract_of
from robo.node.contract_text import contract_data
from robo.testing import Clock, RunNode
from robo_messages import String, Trigger


class Echo(Part):
    """Says again what it hears."""

    said = Publisher(String, "said")
    ask = Client(Trigger.Request, Trigger.Response, "ask")

    def __init__(self, word: str = "", *, mark: str = "!") -> None:
        self.word, self.mark = word, mark
        self.heard: list[str] = []

    @subscribe("heard")
    def on_heard(self, message: String, info: MessageInfo) -> None:
        self.heard.append(message.data)
        self.said.publish(String(f"{self.node.name}: {self.word} {message.data}{self.mark} {info.age:.1f}"))

    @service("count")
    def count(self, _request: Trigger.Request) -> Trigger.Response:
        return Trigger.Response(message=str(len(self.heard)))

    @timer(rate=1.0)
    def tick(self) -> None:
        self.said.publish(String("tick"))


class Parrot(Node):
    echo = Echo("word", mark="?")


class Managed(LifecycleNode):
    echo = Echo("three")


def test_what_a_part_declares_is_in_the_contract_of_its_node() -> None:
    contract = contract_data(Parrot)
    assert [(topic.topic, topic.type) for topic in contract.publishers] == [("said", "std/String")]
    assert [topic.topic for topic in contract.subscriptions] == ["heard"]
    assert [served.service for served in contract.services] == ["count"]
    assert [one.method for one in contract.timers] == ["echo.tick"]
    assert contract_of(Parrot).clients[0].attribute == "echo.ask"
    assert isinstance(Parrot.echo, Echo)


def test_each_node_has_its_own(run_node: RunNode, clock: Clock) -> None:
    polly, coco = [run_node(Parrot, name=name, namespace=name) for name in ("polly", "coco")]
    polly.send("heard", String("hello"))
    assert [one.data for one in polly.published("said")] == ["polly: word hello? 0.0"]
    assert polly.node.echo.heard == ["hello"]
    assert coco.node.echo.heard == []
    assert polly.call("count", Trigger.Request()).message == "1"
    clock.advance(1.0)
    assert [one.data for one in coco.published("said")] == ["tick"]


def test_a_part_of_a_managed_node_works_while_that_is_active(session: zenoh.Session) -> None:
    with Managed(namespace="r1", session=session) as node:
        assert node.echo.node is node
        assert node.echo.said.topic == "r1/said"


def test_an_end_of_a_part_before_the_start() -> None:
    with pytest.raises(ContractError, match=r"Echo\.said is used before the node has started"):
        Parrot().echo.said.publish(String())


class Tuned(Part):
    class Parameters(Parameters):
        rate: float = 1.0


class Hooked(Part):
    def on_start(self) -> None: ...

    def main(self) -> None: ...


@pytest.mark.parametrize(
    ("part", "told"), [(Tuned(), "may not have Parameters"), (Hooked(), "may not have on_start, main")]
)
def test_what_belongs_to_the_node_is_refused_in_a_part(part: Part, told: str) -> None:
    with pytest.raises(ContractError, match=f"Odd.part: {type(part).__name__} is a part of a node and {told}, which"):
        contract_of(type("Odd", (Node,), {"part": part}))
