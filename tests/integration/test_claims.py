"""Names of nodes are claimed before the nodes start: of two, one has them."""

import asyncio
import socket
import threading
from collections.abc import Iterator

import pytest
import zenoh

from robo.supervisor.changes import Changes
from robo.supervisor.presence import Presence
from robo.wire.claims import Claim, PortTaken, declare, names_in_use, told
from robo.wire.discovery import hostname
from robo.wire.keys import ClaimToken
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.conftest import free_port
from tests.processes import FakeJournal, FakeStopping
from tests.support import eventually


@pytest.fixture
def linked(session: zenoh.Session, endpoint: str) -> Iterator[str]:
    """A second router, linked to the first; where it listens."""
    listen = f"tcp/127.0.0.1:{free_port()}"
    router = open_session(Network(mode="router", listen=(listen,), connect=(endpoint,)))
    eventually(lambda: len(list(session.info.routers_zid())) == 1, "the two are linked")
    yield listen
    close_session(router)


def claim(endpoint: str, run: str, *nodes: str) -> Claim:
    return Claim(Network(mode="router", listen=(endpoint,), connect=(endpoint,)), f"robot_{run}", nodes, run)


def test_a_claim_keeps_others_off_and_goes_with_its_holder(session: zenoh.Session, endpoint: str) -> None:
    first, second = claim(endpoint, "1", "/r1/base", "/r1/monitor"), claim(endpoint, "0", "/r2/base", "/r1/monitor")
    assert first.take() == []
    held = declare(session, first.tokens)
    taken = second.take()
    assert {(token.full_name, token.run) for token in taken} == {("/r1/monitor", "1")}
    assert told(taken).startswith("/r1/monitor runs already (process ")
    assert told(taken).endswith(", robot robot_1)")
    second.close()
    first.settle(lambda _: True)
    left = {"/r1/base", "/r1/monitor"}
    eventually(lambda: {token.full_name for token in names_in_use(session, 1.0)} == left, "its own claims are left")
    for token in held:
        token.undeclare()
    other = claim(endpoint, "2", "/r1/base")
    assert other.take() == []
    other.close()


@pytest.mark.parametrize("together", [True, False])
def test_of_two_that_claim_at_once_one_has_the_names(
    together: bool, session: zenoh.Session, endpoint: str, linked: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    del session  # it has to be there first
    monkeypatch.setattr(Claim, "_wait_for_turn", lambda _: None)  # as if on two machines
    for turn in range(5):
        claims = [
            claim(endpoint, f"{turn}0", "/r1/base"),
            claim(endpoint if together else linked, f"{turn}1", "/r1/base"),
        ]
        winners = _race(claims)
        # Over two routers neither may have seen the other yet: then both hear of each other later, and the second
        # gives way (see the supervisor).
        assert len(winners) == 1 or (not together and len(winners) == 2)
        for one in claims:
            one.close()
        eventually(lambda: _free(endpoint), "the names are free again")


def _race(claims: list[Claim]) -> list[Claim]:
    """Those of some claims that get what they claim, all at once."""
    begin = threading.Barrier(len(claims))
    winners: list[Claim] = []

    def take(one: Claim) -> None:
        begin.wait()
        if one.take():
            one.close()
        else:
            winners.append(one)

    threads = [threading.Thread(target=take, args=(one,)) for one in claims]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return winners


def _free(endpoint: str) -> bool:
    looking = open_session(Network(mode="client", connect=(endpoint,)))
    try:
        return not list(names_in_use(looking, 1.0))
    finally:
        close_session(looking)


def test_an_established_run_keeps_its_names_whatever_its_clock_says(session: zenoh.Session, endpoint: str) -> None:
    token = ClaimToken("r1", "base", "fleet", 17, hostname(), "9-established-with-a-clock-ahead")
    held = declare(session, [token])
    newcomer = claim(endpoint, "1", "/r1/base")
    assert newcomer.take() == [token]
    newcomer.close()
    held[0].undeclare()


def test_a_port_of_another_program_is_told_with_the_program() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(PortTaken, match=r"is taken by process \d+ \(.*\) and no Zenoh answers there\n  stop that"):
            claim(endpoint, "1", "/r1/base").take()


def test_a_site_that_does_not_answer_is_known_and_no_hindrance(endpoint: str) -> None:
    site = f"tcp/127.0.0.1:{free_port()}"
    one = Claim(Network(mode="router", listen=(endpoint,), connect=(site, endpoint)), "r1", ["/r1/base"], "1")
    assert one.take() == []
    assert one.unreached.keys() == {site}
    one.close()


def test_a_run_looks_who_has_a_name_before_it_takes_one_more(
    session: zenoh.Session, other: zenoh.Session, endpoint: str
) -> None:
    mine = claim(endpoint, "1", "/r1/base")
    presence = Presence("r1", "", mine, {}, Changes(), FakeJournal(), FakeStopping())
    presence.session = session
    held = declare(other, [claim(endpoint, "9", "/r1/lidar").token_of("/r1/lidar")])
    eventually(lambda: bool(list(names_in_use(session, 1.0))), "the other's claim shows")

    async def take(name: str) -> str | None:
        return await presence.claim(name)

    taken = asyncio.run(take("/r1/lidar"))
    assert taken is not None
    assert taken.startswith("/r1/lidar runs already (process ")
    assert asyncio.run(take("/r1/camera")) is None
    assert {(t.full_name, t.run) for t in names_in_use(session, 1.0)} == {("/r1/lidar", "9"), ("/r1/camera", "1")}
    presence.release("/r1/camera")
    held[0].undeclare()
    eventually(lambda: not list(names_in_use(session, 1.0)), "both are free")
    assert asyncio.run(take("/r1/lidar")) is None
