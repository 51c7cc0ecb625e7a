"""Latched topics through a router, and after it was started again."""

from contextlib import ExitStack

import pytest
import zenoh

from robo import Node, Publisher, subscribe
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import String
from tests.support import PATIENCE, eventually, robo, run_robo

pytestmark = pytest.mark.timeout(180)


class Source(Node):
    state = Publisher(String, "state", latched=True)


class Reader(Node):
    def on_start(self) -> None:
        self.seen: list[str] = []

    @subscribe("state", latched=True)
    def on_state(self, text: String) -> None:
        self.seen.append(text.data)


def test_whoever_comes_later_gets_the_last_one_also_after_the_router_was_started_again(endpoint: str) -> None:
    def echo() -> str:
        done = run_robo("topic", "echo", "r1/state", "--once", "--connect", endpoint)
        assert done.returncode == 0, done.stderr
        return done.stdout

    with ExitStack() as stack:
        first = stack.enter_context(robo("router", "--listen", endpoint))
        first.wait_for("router at")
        here, there = (_client(stack, endpoint) for _ in range(2))
        source = stack.enter_context(Source(namespace="r1", session=here))
        source.state.publish(String("one"))
        early = stack.enter_context(Reader(name="early", namespace="r1", session=there))
        eventually(lambda: early.seen == ["one"], "what was said before")
        assert "one" in echo()

        first.process.kill()
        first.wait()
        source.state.publish(String("two"))
        between = stack.enter_context(Reader(name="between", namespace="r1", session=there))
        stack.enter_context(robo("router", "--listen", endpoint)).wait_for("router at")
        eventually(lambda: early.seen == ["one", "two"] and between.seen == ["two"], "what was said meanwhile")
        late = stack.enter_context(Reader(name="late", namespace="r1", session=there))
        eventually(lambda: late.seen == ["two"], "the last word")
        assert "two" in echo()
        source.state.publish(String("three"))
        eventually(lambda: {reader.seen[-1] for reader in (early, between, late)} == {"three"}, "what is said now")
        assert early.seen == ["one", "two", "three"]


def _client(stack: ExitStack, endpoint: str) -> zenoh.Session:
    session = open_session(Network(mode="client", connect=(endpoint,), timeout=PATIENCE))
    stack.callback(close_session, session)
    return session


def test_a_command_says_something_for_whoever_comes_later(endpoint: str) -> None:
    where = ("--connect", endpoint)
    words = ("topic", "pub", "r1/floor", "std/String")
    with robo("router", "--listen", endpoint) as router:
        router.wait_for("router at")
        with robo(*words, "{data: second}", "--latched", "--priority", "data_high", *where) as kept:
            kept.wait_for("is there for whoever comes later")
            late = run_robo("topic", "echo", "r1/floor", "--once", "--field", "data", *where)
            assert late.stdout.split() == ["second"]
            assert "latched, data_high" in run_robo("topic", "info", "r1/floor", *where).stdout
            kept.interrupt()
            assert kept.wait() == 130
        for wrong, told in (
            (("--latched", "--once"), "leave --once out"),
            (("--priority", "urgent"), "--priority urgent: priority 'urgent' is not known; use real_time, "),
        ):
            refused = run_robo(*words, *wrong, *where)
            assert refused.returncode == 2
            assert told in refused.stderr
