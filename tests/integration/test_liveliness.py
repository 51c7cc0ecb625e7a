"""Who hears of tokens is told all of them when he asks, by a session beside his own."""

import threading
from collections.abc import Iterator
from typing import Any

import pytest
import zenoh

from robo.wire import liveliness
from robo.wire.network import Mode, Network
from robo.wire.session import beside, close_session, open_session, opened


@pytest.fixture
def token(session: zenoh.Session) -> Iterator[str]:
    """The key of a token that the router declares."""
    held = session.liveliness().declare_token("one/token")
    yield "one/token"
    held.undeclare()


def heard(session: zenoh.Session) -> Any:
    """A subscription of tokens, once it has told of one."""
    came = threading.Event()
    subscriber = liveliness.hear(session, "one/*", lambda _: came.set())
    assert came.wait(10.0)
    return subscriber


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_who_hears_of_tokens_asks_by_a_second_session(mode: Mode, endpoint: str, token: str) -> None:
    before = len(opened())
    session = open_session(Network(mode=mode, connect=(endpoint,)))
    assert list(liveliness.ask(session, "one/*", 10.0)) == [token]
    assert len(opened()) == before + 1, "who hears of none asks by himself"
    subscriber = heard(session)
    assert list(liveliness.ask(session, "one/*", 10.0)) == [token]
    assert len(opened()) == before + 2
    subscriber.undeclare()
    assert list(liveliness.ask(session, "one/*", 10.0)) == [token]
    assert len(opened()) == before + 2, "what it knew it knows on, so it asks by the same one"
    close_session(session)
    assert len(opened()) == before


def test_a_router_asks_by_itself(session: zenoh.Session, token: str) -> None:
    heard(session).undeclare()
    assert list(liveliness.ask(session, "one/*", 10.0)) == [token]
    assert beside(session, 10.0) is None


def test_where_nobody_answers_there_is_no_second_one_and_no_error(endpoint: str) -> None:
    router = open_session(Network(mode="router", listen=(endpoint,)))
    session = open_session(Network(mode="client", connect=(endpoint,)))
    liveliness.hear(session, "one/*", lambda _: None)
    close_session(router)
    assert list(liveliness.ask(session, "one/*", 0.2)) == []
    close_session(session)
