"""A start is all or nothing, and a stop leaves nothing: seen by all that a node declares on its session."""

import threading
from typing import Any

import pytest
import zenoh

from robo import Client, MessageInfo, Node, Publisher, service, subscribe, timer
from robo_messages import String, Trigger
from tests.support import eventually


class Declared:
    """Something that is declared on a session, until it is undeclared."""

    def __init__(self, thing: Any, what: str, live: list[str]) -> None:
        self._thing = thing
        self._what = what
        self._live = live
        live.append(what)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._thing, name)

    def undeclare(self) -> None:
        self._thing.undeclare()
        self._live.remove(self._what)


class Ledger:
    """A session that knows what is declared on it, and may refuse a declaration."""

    def __init__(self, session: zenoh.Session, refused: int | None = None) -> None:
        self._session: Any = session
        self._refused = refused
        self.live: list[str] = []
        self.all: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("declare_"):
            return lambda key, *words, **options: self._declare(self._session, name, key, *words, **options)
        return getattr(self._session, name)

    def liveliness(self) -> Any:
        ledger, liveliness = self, self._session.liveliness()

        class Liveliness:
            def __getattr__(self, name: str) -> Any:
                return lambda key, *words, **options: ledger._declare(liveliness, name, key, *words, **options)

        return Liveliness()

    def _declare(self, where: Any, name: str, key: object, *words: Any, **options: Any) -> Declared:
        what = f"{name} {key}"
        self.all.append(what)
        if len(self.all) - 1 == self._refused:
            raise zenoh.ZError(f"refused: {what}")
        return Declared(getattr(where, name)(key, *words, **options), what, self.live)


class Base(Node):
    """Declares one of each."""

    out = Publisher(String, "out")
    reset = Client(Trigger.Request, Trigger.Response, "reset")

    def on_start(self) -> None:
        self.create_publisher(String, "more")

    @subscribe("in")
    def on_text(self, _: String) -> None:
        """Take it."""

    @subscribe("informed")
    def on_informed(self, _: String, info: MessageInfo) -> None:
        """Take it."""

    @service("~/served")
    def served(self, _: Trigger.Request) -> Trigger.Response:
        return Trigger.Response()

    @timer(rate=100.0)
    def tick(self) -> None:
        """Let it pass."""


class Warming(Base):
    """Is asked whether it is ready, and has work of its own."""

    def ready(self) -> bool:
        return True

    def main(self) -> None:
        self.sleep(60)


def lived(session: zenoh.Session, node_class: type[Base]) -> Ledger:
    """What a node declares that starts and is closed."""
    ledger: Any = Ledger(session)
    node = node_class(namespace="r1", session=ledger)
    with node:
        if node_class is Warming:
            eventually(lambda: any("/node/" in what for what in ledger.all), "it is ready")
    assert not node.logger.logger.handlers
    eventually(lambda: not _of_robo(), "its threads have ended")
    return ledger  # type: ignore[no-any-return]


def _of_robo() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("robo-")]


@pytest.mark.parametrize("node_class", [Base, Warming])
def test_a_node_that_is_closed_has_taken_back_all_that_it_declared(
    robo_session: zenoh.Session, node_class: type[Base]
) -> None:
    ledger = lived(robo_session, node_class)
    assert ledger.live == []
    kinds = {what.partition(" ")[0].removeprefix("declare_") for what in ledger.all}
    assert kinds == {"publisher", "subscriber", "queryable", "querier", "token"}


def test_a_node_that_is_refused_any_of_its_ends_leaves_nothing_behind(robo_session: zenoh.Session) -> None:
    for refused in range(len(lived(robo_session, Base).all)):
        ledger: Any = Ledger(robo_session, refused)
        node = Base(namespace="r1", session=ledger)
        with pytest.raises(zenoh.ZError, match="refused"):
            node.start()
        assert ledger.live == [], f"after {ledger.all[-1]}"
        assert not node.logger.logger.handlers
    eventually(lambda: not _of_robo(), "all threads have ended")


def test_nodes_that_share_a_session_leave_each_other_alone(robo_session: zenoh.Session) -> None:
    ledger: Any = Ledger(robo_session)
    with Base(name="first", namespace="r1", session=ledger) as first:
        before = sorted(ledger.live)
        with Base(name="second", namespace="r1", session=ledger) as second:
            assert len(ledger.live) == 2 * len(before)
            assert first.status.node != second.status.node
        assert sorted(ledger.live) == before
        assert not first.stopping
        assert first.session == ledger
    assert ledger.live == []


class Ending(Node):
    """Is told to end while it is asked whether it is ready."""

    def on_start(self) -> None:
        self.asked = 0

    def ready(self) -> bool:
        self.asked += 1
        self.shutdown()
        return True

    @timer(rate=20.0)
    def tick(self) -> None:
        """Give whoever asks again the time for it."""
        self.ticks = getattr(self, "ticks", 0) + 1


def test_a_node_that_is_told_to_end_is_asked_no_more_whether_it_is_ready(robo_session: zenoh.Session) -> None:
    ledger: Any = Ledger(robo_session)
    node = Ending(namespace="r1", session=ledger)
    with node:
        eventually(lambda: getattr(node, "ticks", 0) >= 20, "it has run on")
    assert node.asked == 1
    assert not any("/node/" in what for what in ledger.all)
