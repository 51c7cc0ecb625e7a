"""Whether a link is one to a site."""

import pytest

from robo.supervisor.sites import Sites, is_among
from robo.wire.admin import RouterLink, RouterSession
from tests.processes import FakeJournal


@pytest.mark.parametrize(
    ("endpoint", "whatami", "dst", "reached"),
    [
        ("tcp/127.0.0.1:7447", "router", "tcp/127.0.0.1:7447", True),
        ("tcp/localhost:7447", "router", "tcp/127.0.0.1:7447", True),
        ("tcp/127.0.0.1:7447", "router", "tcp/127.0.0.1:40001", False),  # another robot of this machine
        ("tcp/10.0.0.5:7447", "router", "tcp/10.0.0.5:40001", True),  # it has dialled this one
        ("tcp/10.0.0.5:7447", "client", "tcp/10.0.0.5:40001", False),
        ("tls/10.0.0.5:7447", "router", "tcp/10.0.0.5:7447", False),
        ("tcp/[::1]:7447?iface=lo", "router", "tcp/[::1]:7447", True),
        ("tcp/no such host:7447", "router", "tcp/10.0.0.5:7447", False),
        ("tcp/10.0.0.5:7447", "peer", "unixsock-stream//tmp/x.sock", False),
    ],
)
def test_a_site_is_known_by_its_link(endpoint: str, whatami: str, dst: str, reached: bool) -> None:
    assert is_among(endpoint, [RouterSession("a1", whatami, [RouterLink(dst=dst)])]) is reached


def test_a_site_that_is_not_reached_is_told_once_and_remembered() -> None:
    journal = FakeJournal()
    sites = Sites("r1", ["tcp/10.0.0.5:7447", "tcp/10.0.0.6:7447"], journal)
    sites.note({"tcp/10.0.0.5:7447": ConnectionRefusedError(), "tcp/127.0.0.1:7447": TimeoutError()})
    sites.note({"tcp/10.0.0.5:7447": ConnectionRefusedError()})
    (warning,) = journal.warned
    assert warning.startswith("tcp/10.0.0.5:7447 is not reached: ")
    assert warning.endswith("; the robot runs without it, and links to it when it answers")
    lost, unknown = sites.all.values()
    assert (lost.robot, lost.reached, bool(lost.reason)) == ("r1", False, True)
    assert (unknown.reached, unknown.reason) == (False, ""), "nobody has tried it so far"
