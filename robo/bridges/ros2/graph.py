"""The graph on both sides: robo's nodes as ROS sees them, and ROS's nodes as robo's tools do."""

from typing import Any

import zenoh

from robo.bridges.ros2 import quality, tokens
from robo.bridges.ros2.announced import Announced
from robo.bridges.ros2.forms import NoForm, form_of, robo_service, robo_type, service_form
from robo.bridges.ros2.presence import MOST_TOKENS, Presence, RoboToken, RosToken
from robo.bridges.ros2.rules import Crossings
from robo.bridges.ros2.scope import GRAPH, Scope
from robo.bridges.ros2.tokens import EndToken
from robo.wire import names
from robo.wire.keys import EndpointKind, EndpointToken, NodeToken
from robo.wire.qos import KEEP_ALL, QoS

_KINDS: dict[tokens.Kind, EndpointKind] = {"MP": "pub", "MS": "sub", "SS": "srv", "SC": "cli"}


class GraphInRos:
    """Robo's nodes and what they hear and call; what they say and serve is announced by who passes it on."""

    def __init__(self, crossings: Crossings, announced: Announced, scope: Scope) -> None:
        """
        Args:
            crossings: what crosses.
            announced: what is announced in ROS.
            scope: on whose behalf.
        """
        self._crossings, self._announced, self._scope = crossings, announced, scope

    def meet(self, token: RoboToken, is_there: bool) -> None:
        """A node or an end of robo's has come, or is gone. For the steward."""
        if isinstance(token, NodeToken):
            self._meet_node(token, is_there)
        elif token.kind in ("sub", "cli"):
            self._meet_end(token, is_there)

    def has(self, token: NodeToken) -> bool:
        """Whether a node is one of the robot's."""
        if self._scope.alone:
            return self._scope.has(token)
        is_graphs = token.namespace.partition("/")[0] == GRAPH
        inside = not self._crossings.namespace or token.full_name.startswith(f"/{self._crossings.namespace}/")
        return inside and not is_graphs

    def _meet_node(self, token: NodeToken, is_there: bool) -> None:
        if not self.has(token):
            return
        if is_there:
            self._announced.node(token.full_name)
        elif token.full_name != self._scope.node:
            self._announced.withdraw_node(token.full_name)

    def _meet_end(self, token: EndpointToken, is_there: bool) -> None:
        """A subscription, or a client, of what crosses in either direction: the graph is the same on both sides."""
        is_topic = token.kind == "sub"
        rules = self._crossings.topics if is_topic else self._crossings.services
        crossing = rules.crossing_from_ros(token.topic) or rules.to_ros(token.topic)
        if crossing is None:
            return
        try:
            form = form_of(token.type_name) if is_topic else service_form(token.type_name)
        except NoForm:
            return
        kind: tokens.Kind = "MS" if is_topic else "SC"
        if is_there:
            wanted = quality.to_ros(token.qos if token.qos.depth != KEEP_ALL or is_topic else QoS.DEFAULT)
            self._announced.end(token.full_name, kind, crossing.name, form.type, form.hash, wanted)
        else:
            self._announced.withdraw_end(token.full_name, kind, crossing.name, form.type)


class GraphInRobo:
    """ROS's nodes, and their ends of what crosses, below the namespace `ros2`."""

    def __init__(self, robo: zenoh.Session, crossings: Crossings, presence: Any) -> None:
        """
        Args:
            robo: robo's network.
            crossings: what crosses.
            presence: tells who is there.
        """
        self._liveliness = robo.liveliness()
        self._crossings = crossings
        self._presence: Any = presence
        self._declared: dict[str, tuple[int, Any]] = {}
        """By key: how many have it, and the token."""

    def meet(self, token: RosToken, is_there: bool) -> None:
        """A node or an end of ROS's has come, or is gone. For the steward."""
        found = self._shown(token)
        if found is None:
            return
        count, declared = self._declared.get(found, (0, None))
        if is_there:
            if declared is None and len(self._declared) < MOST_TOKENS:
                declared = self._liveliness.declare_token(found)
            self._declared[found] = count + 1, declared
        elif count > 1:
            self._declared[found] = count - 1, declared
        elif self._declared.pop(found, None) is not None and declared is not None:
            declared.undeclare()

    def close(self) -> None:
        """Show nothing more."""
        for _, declared in self._declared.values():
            if declared is not None:
                declared.undeclare()
        self._declared.clear()

    def _shown(self, token: RosToken) -> str | None:
        """The token that stands for one of ROS's."""
        presence: Presence = self._presence()
        node = token.node if isinstance(token, EndToken) else token
        if presence.is_of_bridge(node.session):
            return None
        namespace = names.join(GRAPH, node.namespace)
        if not isinstance(token, EndToken):
            return NodeToken(namespace, node.name, NodeToken.ROS, 0, NodeToken.ROS).key()
        return self._shown_end(token, namespace)

    def _shown_end(self, token: EndToken, namespace: str) -> str | None:
        is_topic = token.kind in ("MP", "MS")
        rules = self._crossings.topics if is_topic else self._crossings.services
        key = rules.key_in_robo(token.topic, says=token.kind in ("MP", "SS"))
        name = robo_type(token.type) if is_topic else robo_service(token.type)
        if key is None or name is None:
            return None
        qos = quality.to_robo(token.quality) if is_topic else QoS(depth=KEEP_ALL)
        return EndpointToken(namespace, token.node.name, _KINDS[token.kind], name, qos, key).key()
