"""A node's sign of life to its supervisor."""

import socket

import msgspec

from robo import Node, NodeStatus
from robo.process.heartbeat import Heart
from robo.wire.reports import Beat


class Bridge(Node):
    """One with more topics than a socket takes at once."""

    @property
    def status(self) -> NodeStatus:
        published = {f"{n}/of/a/robot/with/a/long/name": n for n in range(20_000)}
        return NodeStatus(self.full_name, published, {}, {}, {}, callback_errors=2, uptime=3.0)


def test_a_node_of_very_many_topics_lives_and_says_so() -> None:
    supervisor, own = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with supervisor, own:
        node = Bridge(namespace="r1")
        Heart(node, own, 60.0, []).beat()
        supervisor.settimeout(30)
        beat = msgspec.msgpack.decode(supervisor.recv(1_000_000), type=Beat)
        assert (beat.status.node, beat.status.uptime, beat.status.callback_errors) == ("/r1/bridge", 3.0, 2)
        assert not node.stopping
