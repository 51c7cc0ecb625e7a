"""The bridge: all of its parts, in the order in which they begin and end."""

from collections.abc import Callable
from contextlib import ExitStack

import msgspec
import zenoh

from robo.bridges.ros2.actions import Actions
from robo.bridges.ros2.announced import Announced
from robo.bridges.ros2.calls import Workers
from robo.bridges.ros2.graph import GraphInRobo, GraphInRos
from robo.bridges.ros2.misfits import Misfits
from robo.bridges.ros2.networks import closed_to_ros, is_joined
from robo.bridges.ros2.parameters import Parameters
from robo.bridges.ros2.presence import Presence, RoboToken, RosToken, Steward
from robo.bridges.ros2.rules import crossings_of
from robo.bridges.ros2.scope import GRAPH, NODE, Scope
from robo.bridges.ros2.services import Services
from robo.bridges.ros2.sides import Sides
from robo.bridges.ros2.tally import Count, Tally
from robo.bridges.ros2.tokens import EndToken
from robo.bridges.ros2.topics_from_ros import TopicsFromRos
from robo.bridges.ros2.topics_to_ros import TopicsToRos
from robo.bridges.ros2.type_questions import TypeQuestions
from robo.errors import UsageError
from robo.launch.plan import Ros2Plan
from robo.wire import names
from robo.wire.keys import EndpointToken, NodeToken

_DOOR_TIMEOUT = 0.5
"""How long a router may take to say whether it is open, s."""


class Status(msgspec.Struct, frozen=True):
    """How the bridge does."""

    domain: int
    ros_is_there: bool
    """Whether anybody is in ROS's network."""
    ros_nodes: int
    """Nodes of robo's that ROS sees."""
    ros_ends: int
    """Ends of robo's that ROS sees."""
    topics: list[Count]
    faults: list[str]
    """What does not cross, and why."""


class Bridge:
    """Connects a robot's network with ROS's."""

    def __init__(
        self,
        robo: zenoh.Session,
        ros: zenoh.Session,
        plan: Ros2Plan,
        namespace: str,
        tell: Callable[[str], None],
        node: str = "",
        *,
        alone: bool = False,
    ) -> None:
        """
        Args:
            robo, ros: the networks; they are closed by who has opened them.
            plan: what crosses.
            namespace: of the robot; empty for all robots.
            tell: is told once of each thing that does not cross, in a sentence.
            node: the bridge's full name.
            alone: whether that is a node which speaks for itself, in whose session this is.

        Raises:
            UsageError: the plan contradicts itself.
            RunError: a library is missing.
        """
        if namespace.strip("/").partition("/")[0] == GRAPH:
            raise UsageError(
                f"a robot named {namespace} cannot be bridged: ROS's nodes are shown there; name it otherwise"
            )
        self.node = node or "/" + names.join(namespace, NODE)
        self._crossings = crossings = crossings_of(plan, namespace)
        self._plan, self._ros = plan, ros
        self._scope = scope = Scope(self.node, alone)
        self._told: set[RoboToken] = set()
        """Of robo, what the parts know; used by the steward."""
        self._routers: frozenset[str] = frozenset()
        """Those of ROS's network that were asked whether anything can cross."""
        self._tally = tally = Tally(tell)
        self._steward = Steward(
            lambda error: tally.fault(f"work {error}", f"the bridge: {type(error).__name__}: {error}")
        )
        self._over = ExitStack()
        with ExitStack() as made:
            self._announced = announced = Announced(ros, plan.domain, scope)
            made.callback(announced.close)
            workers = Workers(self._fail)
            made.callback(workers.close)
            misfits = Misfits(tally, TypeQuestions(ros, announced, workers, self.node).ask)
            own: set[str] = set()
            self._to_ros = TopicsToRos(robo, ros, crossings.topics, self._who, announced, tally, scope, own)
            self._from_ros = TopicsFromRos(
                robo, ros, crossings.topics, self._who, announced, tally, misfits, self._steward, scope, own
            )
            sides = Sides(robo, ros, announced, tally, misfits, workers, self.node)
            self._services = Services(sides, crossings.services)
            made.callback(self._services.close)
            self._actions = Actions(sides, crossings.actions)
            made.callback(self._actions.close)
            self._parameters = Parameters(robo, ros, announced, workers, writes=plan.parameters == "write")
            made.callback(self._parameters.close)
            self._in_ros = GraphInRos(crossings, announced, scope)
            self._in_robo = GraphInRobo(robo, crossings, self._who)
            announced.node(self.node)
            made.callback(self._in_robo.close)
            made.callback(self._to_ros.close)
            made.callback(self._from_ros.close)
            self._presence = Presence(robo, ros, plan.domain, self._meet_robo, self._meet_ros, self._meet_alone)
            made.callback(self._presence.close)
            self._to_ros.start()
            self._from_ros.start()
            self._steward.start()
            made.callback(self._steward.close)
            self._over = made.pop_all()

    def status(self) -> Status:
        """How it does, with rates since the last time that it was asked."""
        self._look_at_door()
        nodes, ends = self._announced.counts()
        return Status(self._plan.domain, is_joined(self._ros), nodes, ends, self._tally.look(), self._tally.faults())

    def close(self) -> None:
        """End it: nothing crosses any more."""
        self._over.close()

    def _look_at_door(self) -> None:
        """See, where another router has come, whether it is one at which anything can cross."""
        routers = frozenset(str(zid) for zid in self._ros.info.routers_zid())
        if routers == self._routers:
            return
        self._routers = routers
        closed = closed_to_ros(self._ros, self._plan.connect, _DOOR_TIMEOUT)
        if closed is None:
            self._tally.mend("door")
        else:
            self._tally.fault("door", closed)

    def _fail(self, error: BaseException) -> None:
        self._tally.fault("work", f"the bridge has failed: {type(error).__name__}: {error}")

    def _who(self) -> Presence:
        return self._presence

    def _meet_robo(self, token: RoboToken, is_there: bool) -> None:
        self._steward.do(lambda: self._tell_of_robo(token, is_there))

    def _meet_alone(self, full_name: str, is_alone: bool) -> None:
        """A node of robo's has begun to speak in ROS for itself, or does so no more."""

        def meet() -> None:
            for token in self._presence.robo_of(full_name):
                self._tell_of_robo(token, not is_alone)
                if is_alone and isinstance(token, EndpointToken) and token.kind == "pub":
                    self._to_ros.meet(token, is_there=False)  # a message may have come before the token was told
            if is_alone:
                self._announced.withdraw_node(full_name)  # its ends may have been told, and itself not yet

        self._steward.do(meet)

    def _tell_of_robo(self, token: RoboToken, is_there: bool) -> None:
        """Tell the parts of a token of robo's, each once; for the steward."""
        if not is_there:
            if token in self._told:
                self._told.discard(token)
                self._pass_on(token, is_there=False)
        elif token not in self._told and self._is_ours(token) and not self._presence.is_alone(token.full_name):
            self._told.add(token)
            self._pass_on(token, is_there=True)

    def _is_ours(self, token: RoboToken) -> bool:
        return self._in_ros.has(token) if isinstance(token, NodeToken) else self._scope.has(token)

    def _pass_on(self, token: RoboToken, *, is_there: bool) -> None:
        self._in_ros.meet(token, is_there)
        if isinstance(token, NodeToken):
            if self._plan.parameters != "none":
                self._parameters.meet(token, is_there)
            return
        if token.kind == "pub":
            self._to_ros.meet(token, is_there)
        self._services.meet_robo(token, is_there)
        self._actions.meet_robo(token, is_there)

    def _meet_ros(self, token: RosToken, is_there: bool) -> None:
        def meet() -> None:
            self._in_robo.meet(token, is_there)
            if isinstance(token, EndToken) and not self._presence.is_of_bridge(token.node.session):
                self._from_ros.meet(token, is_there)
                self._services.meet_ros(token, is_there)
                self._actions.meet_ros(token, is_there)

        self._steward.do(meet)
