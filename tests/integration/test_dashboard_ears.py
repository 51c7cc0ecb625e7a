"""Whether a robot listens to the pages that drive it."""

from collections.abc import Iterator
from contextlib import closing

import pytest
import zenoh

from robo.dashboard.ears import Ears
from robo.wire.keys import EndpointToken
from robo.wire.qos import QoS
from tests.support import eventually

pytestmark = pytest.mark.timeout(30)
KEY = "r1/cmd_vel_dashboard"


@pytest.fixture
def ears(session: zenoh.Session) -> Iterator[Ears]:
    with closing(Ears(session, KEY)) as found:
        yield found


def announced(session: zenoh.Session, name: str) -> zenoh.LivelinessToken:
    """Somebody announces that he subscribes."""
    token = EndpointToken("r1", name, "sub", "geometry/Twist", QoS.DEFAULT, KEY, "x:1")
    return session.liveliness().declare_token(token.key())


def test_a_plain_client_listens_after_somebody_else_has_come_and_gone(ears: Ears, other: zenoh.Session) -> None:
    plain = other.declare_subscriber(KEY, lambda _: None)
    eventually(lambda: ears.somebody_listens, "it listens")
    token = announced(other, "topic_echo_1")
    eventually(lambda: bool(ears._listeners), "somebody looks at it")
    token.undeclare()
    eventually(lambda: not ears._listeners, "he has gone")
    assert ears.somebody_listens
    plain.undeclare()
    eventually(lambda: not ears.somebody_listens, "the robot is gone")


def test_a_node_is_gone_with_its_announcement_whoever_else_hears_everything(ears: Ears, other: zenoh.Session) -> None:
    token = announced(other, "mux")
    eventually(lambda: ears.somebody_listens, "it listens")
    recorder = other.declare_subscriber("**", lambda _: None)
    token.undeclare()
    eventually(lambda: not ears.somebody_listens, "the robot is gone")
    recorder.undeclare()
