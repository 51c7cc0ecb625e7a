"""What a callback learns of a message: from the publisher's stamp and announcement to a `MessageInfo`."""

import math

import msgpack
import pytest
import zenoh

from robo import MessageInfo, Node, Publisher, subscribe
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import String
from tests.support import eventually


class Source(Node):
    out = Publisher(String, "said")


class Receiver(Node):
    def on_start(self) -> None:
        self.heard: dict[str, MessageInfo] = {}

    @subscribe("said")
    def on_said(self, text: String, info: MessageInfo) -> None:
        self.heard[text.data] = info


@pytest.mark.parametrize(
    ("handed_on", "least"), [(0.0, 0.0), (2.5, 2.5), (math.inf, 1e8), (math.nan, 1e8), (1e300, 1e8), (-1.0, 0.0)]
)
def test_an_age_that_is_handed_on_arrives_also_where_nobody_knows_it(
    session: zenoh.Session, other: zenoh.Session, handed_on: float, least: float
) -> None:
    with Receiver(namespace="r1", session=session) as receiver, Source(namespace="r1", session=other) as source:
        eventually(lambda: source.out.has_subscribers, "the subscription is seen")
        source.out.publish(String("it"), handed_on)
        eventually(lambda: "it" in receiver.heard, "it has come")
        info = receiver.heard["it"]
        assert info.age >= least
        assert info.age < least + 60 or least > 1e7
        assert info.source_id == source.out.id
        eventually(lambda: _named(receiver, source), "whose it is")


def _named(receiver: Receiver, source: Source) -> bool:
    source.out.publish(String("who"))
    return "who" in receiver.heard and receiver.heard["who"].source == "/r1/source"


def test_a_plain_client_tells_neither_age_nor_name(session: zenoh.Session, other: zenoh.Session) -> None:
    with Receiver(namespace="r1", session=session) as receiver:

        def came() -> bool:
            other.put("r1/said", msgpack.packb({"data": "it"}))
            return "it" in receiver.heard

        eventually(came, "it has come")
        assert receiver.heard["it"] == MessageInfo(math.inf, "", "")


def test_an_age_is_handed_on_whatever_the_id_of_the_session(endpoint: str) -> None:
    """Zenoh writes ids without their leading zeros: about one of sixteen has some."""
    for zid in ("0123456789abcdef0123456789abcde", "00fedcba98765432100123456789abc", "1"):
        own_id: dict[str, object] = {"id": zid.lstrip("0")}
        session = open_session(Network(mode="peer", listen=(endpoint,), more=own_id))
        try:
            with (
                Receiver(namespace="r1", session=session) as receiver,
                Source(namespace="r1", session=session) as source,
            ):
                source.out.publish(String("it"), 2.5)
                eventually(lambda: "it" in receiver.heard, "it has come")
                assert receiver.heard["it"].age >= 2.5, zid
        finally:
            close_session(session)
