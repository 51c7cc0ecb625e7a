"""A question whose answer takes long, and links that are lost meanwhile; network and time are played."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from robo.wire.long_query import GRACE, PERIOD, Gone, LongQuery


class Network:
    """Notes who asks."""

    def __init__(self) -> None:
        self.asked = self.woken = 0
        self.handlers: list[Any] = []
        self.now = 0.0
        self.meanwhile: Callable[[], None] = lambda: None
        """What happens on another thread while somebody asks."""

    def get(self, _key: str, handler: object, **_options: object) -> None:
        self.asked += 1
        self.handlers.append(handler)
        self.meanwhile()

    def wake(self) -> None:
        self.woken += 1

    def query(self) -> LongQuery:
        session: Any = self
        return LongQuery(session, "key", b"", "", self.wake, lambda: self.now)


def test_each_link_that_is_lost_has_its_grace() -> None:
    network = Network()
    query = network.query()
    for asked, network.now in ((2, 10.0), (3, 100.0)):  # in between the question stands
        query.lose()
        assert query.look() is None
        assert network.asked == asked
        assert query.look_again_at == network.now + GRACE


def test_what_was_asked_just_after_a_loss_is_asked_once_more() -> None:
    """It may have gone by the link that was being lost: then nothing comes of it, not even an end."""
    network = Network()
    query = network.query()
    network.now = 10.0
    network.handlers[0].drop()
    assert query.look() is None
    assert (network.asked, query.look_again_at) == (2, 10.0 + GRACE)
    network.now = query.look_again_at - 0.1
    assert query.look() is None
    assert network.asked == 2
    network.now = query.look_again_at
    assert query.look() is None
    assert (network.asked, query.look_again_at) == (3, float("inf"))
    network.now = 100.0
    assert query.look() is None
    assert network.asked == 3
    answer = object()
    network.handlers[1].callback(SimpleNamespace(ok=answer, err=None))
    assert query.look() is answer, "whichever time of asking it is to"


def test_where_nobody_answers_for_a_while_whoever_was_asked_is_gone() -> None:
    network = Network()
    query = network.query()
    network.now = 10.0
    while network.now < 10.0 + GRACE:
        query.lose()
        assert query.look() is None
        network.now += PERIOD / 2
    query.lose()
    with pytest.raises(Gone):
        query.look()


def test_the_news_that_a_server_has_left_counts_for_who_is_just_asking() -> None:
    network = Network()
    query = network.query()
    network.handlers[0].drop()  # Zenoh ends what the server held, and says only then that it has left
    network.meanwhile = query.lose
    for network.now in (0.0, GRACE / 2, GRACE):
        assert query.look() is None
        assert query.look_again_at == network.now + PERIOD
    with pytest.raises(Gone):
        query.look()


def test_who_looks_seldom_asks_again_before_he_gives_up() -> None:
    network = Network()
    query = network.query()
    network.now = 10.0
    query.lose()
    assert query.look() is None
    query.lose()
    network.now = 20.0
    assert query.look() is None
    query.lose()
    with pytest.raises(Gone):
        query.look()


def test_an_answer_that_the_news_of_the_servers_leave_has_overtaken_counts() -> None:
    network = Network()
    query = network.query()
    query.lose()
    assert query.look() is None
    woken, answer = network.woken, object()
    network.handlers[0].callback(SimpleNamespace(ok=answer, err=None))
    assert network.woken > woken, "whoever waits looks again"
    assert query.look() is answer
    assert query.look_again_at == float("inf")
