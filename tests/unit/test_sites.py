"""Whether a link is one to a site."""

import pytest

from robo.supervisor.sites import is_among
from robo.wire.admin import Link, RouterSession


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
    assert is_among(endpoint, [RouterSession("a1", whatami, [Link(dst=dst)])]) is reached
