"""A node's sign of life to its supervisor."""

import socket

import msgspec

from robo import Node, NodeStatus
from robo.process.heartbeat import Heart
from robo.wire.reports import Beat, TurnStatus


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


class Planner(Node):
    """One whose callback with a turn of its own runs for as long as the test says."""

    planning = 0.0

    @property
    def status(self) -> NodeStatus:
        turns = {
            "plan": TurnStatus(["think"], 9.0, "think", self.planning),
            "stop": TurnStatus(["stop"], 0.1, "", 0.0),
        }
        own = ("beat", 0.001) if self.planning < 0.001 else ("think", self.planning)
        return NodeStatus(self.full_name, {}, {}, {}, {}, 0, running=own[0], running_for=own[1], turns=turns)


def test_a_callback_that_does_not_return_is_named_where_it_has_a_turn_of_its_own() -> None:
    supervisor, own = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with supervisor, own:
        supervisor.settimeout(30)
        node = Planner()
        heart = Heart(node, own, 1.0, [])
        told = []
        for node.planning in (0.0, 0.5, 1.3):
            heart.beat()
            beat = msgspec.msgpack.decode(supervisor.recv(100_000), type=Beat)
            told.append((beat.late, beat.status.running, beat.status.running_for))
        assert told == [(False, "", 0.0), (False, "", 0.0), (True, "think", 1.3)]
