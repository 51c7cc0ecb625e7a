"""A node that is in ROS's graph by itself: what it says goes there from its own process, and no bridge stands between.

It is the bridge's own machinery within the node's session, for what that node publishes, hears, serves and calls, each
by its name in robo.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from robo.bridges.ros2.bridge import Bridge
from robo.bridges.ros2.networks import join_ros
from robo.bridges.ros2.rules import crosses_by_name
from robo.launch.plan import CrossingPlan, Direction, Ros2Plan
from robo.node.clock import Clock
from robo.node.node import Node
from robo.wire.keys import EndpointToken
from robo.wire.session import close_session

_STOPS_WITHIN = 1.0
"""s."""
_PERIOD = 1.0
"""After how long it is looked whether ROS's network is there, s."""
_TOPICS: Mapping[str, Direction] = {"pub": "to_ros", "sub": "from_ros"}
_SERVICES: Mapping[str, Direction] = {"srv": "to_ros", "cli": "from_ros"}
_ACTIONS: Mapping[str, Direction] = {"act": "to_ros", "acl": "from_ros"}


@contextmanager
def in_ros(node: Node, connect: str, domain: int) -> Iterator[None]:
    """While this goes on, a node that has started is in ROS's graph.

    Args:
        node: whatever it makes later stays out of it.
        connect: the endpoint of ROS's router, which may come later.
        domain: ROS_DOMAIN_ID of the graph.

    Raises:
        RunError: a library is missing.
    """
    plan = plan_of(node.announced(), connect, domain)
    ros = join_ros(connect, patient=True)
    try:
        bridge = Bridge(node.session, ros, plan, node.namespace, node.logger.warning, node.full_name, alone=True)
        timer = node.create_timer(_PERIOD, _Watch(node, bridge, plan).look, Clock(), turn="ros2")
        try:
            yield
        finally:
            timer.stop(_STOPS_WITHIN)
            bridge.close()
    finally:
        close_session(ros)


class _Watch:
    """Tells when ROS's network is there, and when it is not."""

    def __init__(self, node: Node, bridge: Bridge, plan: Ros2Plan) -> None:
        self._node, self._bridge, self._where = node, bridge, f"at {plan.connect}, domain {plan.domain}"
        self._is_there: bool | None = None

    def look(self) -> None:
        is_there = self._bridge.status().ros_is_there
        if is_there == self._is_there:
            return
        self._is_there = is_there
        if is_there:
            self._node.logger.info("in the graph of ROS 2 %s", self._where)
        else:
            self._node.logger.warning("not in the graph of ROS 2: nobody answers %s; it is dialled on", self._where)


def plan_of(ends: Sequence[EndpointToken], connect: str, domain: int) -> Ros2Plan:
    """What crosses for a node with these ends. Pure."""
    topics, services, actions = (_crossings(ends, kinds) for kinds in (_TOPICS, _SERVICES, _ACTIONS))
    return Ros2Plan(domain=domain, connect=connect, topics=topics, services=services, actions=actions)


def _crossings(ends: Sequence[EndpointToken], kinds: Mapping[str, Direction]) -> dict[str, CrossingPlan]:
    found: dict[str, CrossingPlan] = {}
    for one in ends:
        direction = kinds.get(one.kind)
        if direction is None or not crosses_by_name(one.topic):
            continue
        before = found.get(one.topic)
        if before is not None and before.direction != direction:
            direction = "both"
        found[one.topic] = CrossingPlan(direction=direction, type=one.type_name)
    return {f"/{key}": crossing for key, crossing in found.items()}
