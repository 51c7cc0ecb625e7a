"""Services: those of robo's in ROS, and those of ROS's in robo. Used by the steward."""

from typing import Any

from robo.bridges.ros2 import tokens
from robo.bridges.ros2.calls import Asking, Pending, RoboDoor, RosDoor, to_robo, to_ros
from robo.bridges.ros2.forms import NoForm, ServiceForm, robo_service, service_form
from robo.bridges.ros2.intake import MOST_ROUTES
from robo.bridges.ros2.quality import RosQoS
from robo.bridges.ros2.rules import Crossing, Rules
from robo.bridges.ros2.sides import Sides
from robo.bridges.ros2.tokens import EndToken
from robo.wire import names
from robo.wire.keys import EndpointToken
from robo.wire.qos import KEEP_ALL, QoS

QUALITY = RosQoS(depth=10)
"""Of ROS's services and their clients."""
_OWN_SERVICES = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
)
"""What each node of ROS's serves for its tools: no pattern brings them to robo."""


class Services:
    """All services that cross."""

    def __init__(self, sides: Sides, rules: Rules) -> None:
        """`rules` are those for services."""
        self._robo, self._ros, self._announced, self._tally, self._misfits, self._workers, self._node = sides
        self._rules = rules
        self._in_ros: dict[str, tuple[RosDoor, set[str], ServiceForm]] = {}
        """By key in robo: the door, and the nodes that serve it."""
        self._in_robo: dict[str, tuple[RoboDoor, set[str], Any]] = {}
        """By key in robo: the door, the tokens of those that serve it, and the token of it."""

    def meet_robo(self, token: EndpointToken, is_there: bool) -> None:
        """A service of robo's has come, or is gone."""
        crossing = self._rules.to_ros(token.topic) if token.kind == "srv" else None
        if crossing is None:
            return
        served = self._in_ros.get(token.topic)
        if is_there and served is None:
            self._open_in_ros(crossing, token)
        elif is_there and served is not None:
            served[1].add(token.full_name)
            self._announce(crossing, served[2], token)
        elif served is not None:
            served[1].discard(token.full_name)
            self._announced.withdraw_end(token.full_name, "SS", crossing.name, served[2].type)
            if not served[1]:
                self._in_ros.pop(token.topic)[0].close()

    def meet_ros(self, token: EndToken, is_there: bool) -> None:
        """A service of ROS's has come, or is gone."""
        is_own = "/_action/" in token.topic or token.kind != "SS"
        crossing = self._rules.from_ros(token.topic) if not is_own else None
        if crossing is None or (not crossing.rule.is_exact and token.topic.rpartition("/")[2] in _OWN_SERVICES):
            return
        served = self._in_robo.get(crossing.key)
        if is_there and served is None:
            self._open_in_robo(crossing, token)
        elif is_there and served is not None:
            served[1].add(token.said)
        elif served is not None:
            served[1].discard(token.said)
            if not served[1]:
                door, _, announced = self._in_robo.pop(crossing.key)
                announced.undeclare()
                door.close()

    def close(self) -> None:
        """Nothing crosses any more."""
        for door, _, announced in self._in_robo.values():
            announced.undeclare()
            door.close()
        for door_in_ros, *_ in self._in_ros.values():
            door_in_ros.close()
        self._in_robo.clear()
        self._in_ros.clear()

    def _open_in_ros(self, crossing: Crossing, token: EndpointToken) -> None:
        what = f"service {crossing.key}"
        if crossing.key in self._in_robo or len(self._in_ros) >= MOST_ROUTES:
            self._tally.fault(what, f"/{crossing.key} is served in robo and in ROS: ROS's calls do not come to robo")
            return
        try:
            form = service_form(crossing.rule.plan.type or token.type_name)
        except NoForm as reason:
            self._tally.fault(what, f"service /{crossing.key} does not cross: {reason}")
            return
        key = tokens.data_key(self._announced.domain, crossing.name, form.type, form.hash)
        asked = to_robo(Asking(self._robo, crossing.key, self._workers), form)
        count = self._tally.of(crossing.key, crossing.name, "to_ros")
        door = RosDoor(self._ros, key, form, asked, count, Pending(), self._workers)
        self._in_ros[crossing.key] = door, {token.full_name}, form
        self._announce(crossing, form, token)

    def _announce(self, crossing: Crossing, form: ServiceForm, token: EndpointToken) -> None:
        self._announced.end(token.full_name, "SS", crossing.name, form.type, form.hash, QUALITY)

    def _open_in_robo(self, crossing: Crossing, token: EndToken) -> None:
        what = f"service /{token.topic} of ROS"
        if crossing.key in self._in_ros or len(self._in_robo) >= MOST_ROUTES:
            self._tally.fault(what, f"{what} is served in robo, too, as /{crossing.key}: robo's calls do not go to ROS")
            return
        name, wanted = robo_service(token.type), crossing.rule.plan.type
        if name is None or (wanted is not None and wanted != name):
            self._misfits.unknown(what, crossing.key, token.type, wanted)
            return
        try:
            form = service_form(name)
        except NoForm as reason:
            self._tally.fault(what, f"{what} does not cross: {reason}")
            return
        if form.hash != token.hash:
            self._misfits.hash(what, form, token.hash, token)
            return
        gid = self._announced.end(self._node, "SC", crossing.name, form.type, form.hash, QUALITY)
        asked = to_ros(Asking(self._ros, token.data_key, self._workers), gid)
        count = self._tally.of(crossing.key, crossing.name, "from_ros")
        door = RoboDoor(self._robo, crossing.key, form, asked, count, Pending(), self._workers)
        own = EndpointToken(*names.split(self._node), "srv", name, QoS(depth=KEEP_ALL), crossing.key)
        self._in_robo[crossing.key] = door, {token.said}, self._robo.liveliness().declare_token(own.key())
