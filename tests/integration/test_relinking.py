"""A tool that was held up until its link was cut is answered by the next one, and where there is none it ends."""

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import IO

import pytest
import zenoh

from robo.wire import liveliness
from robo.wire.network import Mode, Network
from robo.wire.relinking import over_losses
from robo.wire.session import close_session, open_session

ASKS = """
import sys
from robo.wire import liveliness
from robo.wire.network import Network
from robo.wire.relinking import over_losses
from robo.wire.session import close_session, open_session

session = open_session(Network(mode="client", connect=(sys.argv[1],)))
print("linked", flush=True)
sys.stdin.readline()
print(liveliness.every(session, "one/*", 10.0))
print(over_losses(session, lambda: [str(one.ok.key_expr) for one in session.get("one/question")], 10.0))
close_session(session)
"""


@pytest.fixture
def answers(session: zenoh.Session) -> Iterator[None]:
    """The router has a token, and answers a question."""
    with (
        session.liveliness().declare_token("one/token"),
        session.declare_queryable("one/question", lambda query: query.reply("one/question", b"")),
    ):
        yield


@contextmanager
def held_up(session: zenoh.Session, endpoint: str, links: Callable[[], object]) -> Iterator[IO[str]]:
    """What a tool prints that was held up until its link was cut, and then asks.

    Args:
        session: the router.
        endpoint: where it listens.
        links: is called once the tool is back.
    """
    cut, back = threading.Event(), threading.Event()

    def notice(event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.DELETE:
            cut.set()
        elif cut.is_set():
            back.set()

    with (
        session.info.declare_link_events_listener(notice),
        subprocess.Popen(
            [sys.executable, "-c", ASKS, endpoint], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as asking,
    ):
        try:
            assert asking.stdin is not None
            assert asking.stdout is not None
            assert asking.stdout.readline() == "linked\n"
            asking.send_signal(signal.SIGSTOP)
            assert cut.wait(20.0)
            asking.stdin.write("now\n")
            asking.stdin.flush()
            asking.send_signal(signal.SIGCONT)
            assert back.wait(20.0)
            links()
            yield asking.stdout
        finally:
            asking.kill()  # it may be stopped


@pytest.mark.usefixtures("answers")
def test_who_was_held_up_until_his_link_was_cut_is_answered(session: zenoh.Session, endpoint: str) -> None:
    with held_up(session, endpoint, lambda: None) as said:
        assert said.read() == "['one/token']\n['one/question']\n"


def test_who_is_back_before_all_others_asks_until_one_of_them_answers(session: zenoh.Session, endpoint: str) -> None:
    with ExitStack() as others:

        def link() -> None:
            others.enter_context(session.liveliness().declare_token("one/token"))
            others.enter_context(
                session.declare_queryable("one/question", lambda query: query.reply("one/question", b""))
            )

        late = threading.Timer(0.5, link)
        with held_up(session, endpoint, late.start) as said:
            assert said.read() == "['one/token']\n['one/question']\n"
        late.join()


class Unanswered:
    """A question to which nobody knows an answer."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self) -> list[str]:
        self.asked += 1
        return []


def test_where_the_link_does_not_come_back_it_ends_with_what_there_was(session: zenoh.Session, endpoint: str) -> None:
    client = open_session(Network(mode="client", connect=(endpoint,)))
    close_session(session)
    question = Unanswered()
    assert over_losses(client, question, 0.2) == []
    assert liveliness.every(client, "one/*", 0.2) == []
    assert question.asked == 1
    close_session(client)


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_where_no_link_is_lost_it_is_asked_once(session: zenoh.Session, endpoint: str, mode: Mode) -> None:
    other = open_session(Network(mode=mode, connect=(endpoint,)))
    for one in (session, other):
        question = Unanswered()
        assert over_losses(one, question, 10.0) == []
        assert question.asked == 1
    close_session(other)
