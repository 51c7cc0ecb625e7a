"""On whose behalf something speaks in ROS's graph: a bridge for its robot, or one node for itself. Pure."""

import msgspec

from robo.wire.keys import EndpointToken, NodeToken

NODE = "ros2_bridge"
"""What bridges are called, each in the namespace of its robot."""
GRAPH = "ros2"
"""The namespace in which ROS's nodes are shown in robo: their own names could be those of robo's nodes."""

BRIDGES = "@robo_ros2/**"
"""Tokens in ROS's network of who speaks there for robo: what one says there is not taken for ROS's by another."""


class Scope(msgspec.Struct, frozen=True):
    """Who speaks there."""

    node: str
    """The full name of the bridge, or of the node that speaks for itself."""
    alone: bool = False
    """Whether it is such a node."""

    def has(self, token: EndpointToken | NodeToken) -> bool:
        """Whether a node or an end in robo's network goes to ROS: the node's own, or all that has not come from ROS."""
        if self.alone:
            return token.full_name == self.node
        return token.node != NODE and token.full_name != self.node and token.namespace.partition("/")[0] != GRAPH

    def key(self, session: str) -> str:
        """The token by which others in ROS's network know it.

        Args:
            session: its id there.
        """
        return f"@robo_ros2/{session}{self.node if self.alone else ''}"


def who_of(key: str) -> tuple[str, str]:
    """The session of such a token, and the full name of the node that speaks for itself; empty for a bridge."""
    _, _, said = key.partition("/")
    session, slash, name = said.partition("/")
    return session, slash + name
