"""Actions: those of robo's in ROS, and those of ROS's in robo: three services each. Used by the steward.

The two topics of an action cross as other topics do (`rules`, `forms`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from robo.bridges.ros2 import tokens
from robo.bridges.ros2.calls import ANSWER_WITHIN, Asking, Pending, RoboDoor, RosDoor, to_robo, to_ros
from robo.bridges.ros2.forms import ActionForm, NoForm, ServiceForm, action_form, robo_action
from robo.bridges.ros2.intake import MOST_ROUTES
from robo.bridges.ros2.rules import Crossing, Rules
from robo.bridges.ros2.services import QUALITY
from robo.bridges.ros2.sides import Sides
from robo.bridges.ros2.tokens import EndToken
from robo.wire import long_query, names
from robo.wire.keys import ActionPart, EndpointToken, action_key
from robo.wire.qos import KEEP_ALL, QoS

_SEND_GOAL = "/_action/send_goal"
_PARTS: dict[ActionPart, Callable[[ActionForm], ServiceForm]] = {
    "send_goal": lambda form: form.send_goal,
    "cancel_goal": lambda form: form.cancel_goal,
    "get_result": lambda form: form.get_result,
}


class Open(NamedTuple):
    """An action that crosses."""

    doors: list[RosDoor] | list[RoboDoor]
    servers: set[str]
    """Those that serve it."""
    form: ActionForm
    token: Any = None
    """That of it in robo."""


class Actions:
    """All actions that cross."""

    def __init__(self, sides: Sides, rules: Rules) -> None:
        """`rules` are those for actions."""
        self._robo, self._ros, self._announced, self._tally, self._misfits, self._workers, self._node = sides
        self._rules = rules
        self._in_ros: dict[str, Open] = {}
        self._in_robo: dict[str, Open] = {}

    def meet_robo(self, token: EndpointToken, is_there: bool) -> None:
        """An action of robo's has come, or is gone."""
        crossing = self._rules.to_ros(token.topic) if token.kind == "act" else None
        if crossing is None:
            return
        served = self._in_ros.get(crossing.key)
        if is_there and served is None:
            self._open_in_ros(crossing, token)
        elif is_there and served is not None:
            served.servers.add(token.full_name)
            self._announce(crossing, served.form, token.full_name)
        elif served is not None:
            served.servers.discard(token.full_name)
            for part, of in _PARTS.items():
                name = action_key(crossing.name, part)
                self._announced.withdraw_end(token.full_name, "SS", name, of(served.form).type)
            if not served.servers:
                _close(self._in_ros.pop(crossing.key))

    def meet_ros(self, token: EndToken, is_there: bool) -> None:
        """An action of ROS's has come, or is gone: it is known by the first of its services."""
        if token.kind != "SS" or not token.topic.endswith(_SEND_GOAL):
            return
        crossing = self._rules.from_ros(token.topic.removesuffix(_SEND_GOAL))
        if crossing is None:
            return
        served = self._in_robo.get(crossing.key)
        if is_there and served is None:
            self._open_in_robo(crossing, token)
        elif is_there and served is not None:
            served.servers.add(token.said)
        elif served is not None:
            served.servers.discard(token.said)
            if not served.servers:
                _close(self._in_robo.pop(crossing.key))

    def close(self) -> None:
        """Nothing crosses any more."""
        for one in (*self._in_ros.values(), *self._in_robo.values()):
            _close(one)
        self._in_ros.clear()
        self._in_robo.clear()

    def _open_in_ros(self, crossing: Crossing, token: EndpointToken) -> None:
        what = f"action {crossing.key}"
        if crossing.key in self._in_robo or len(self._in_ros) >= MOST_ROUTES:
            self._tally.fault(what, f"/{crossing.key} is executed in robo and in ROS: ROS's goals do not come to robo")
            return
        try:
            form = action_form(crossing.rule.plan.type or token.type_name)
        except NoForm as reason:
            self._tally.fault(what, f"action /{crossing.key} does not cross: {reason}")
            return
        doors = []
        count = self._tally.of(crossing.key, crossing.name, "to_ros")
        for part, of in _PARTS.items():
            service, name = of(form), action_key(crossing.name, part)
            key = tokens.data_key(self._announced.domain, name, service.type, service.hash)
            asking = Asking(self._robo, action_key(crossing.key, part), self._workers, _patience(part))
            doors.append(RosDoor(self._ros, key, service, to_robo(asking, service), count, Pending(), self._workers))
        self._in_ros[crossing.key] = Open(doors, {token.full_name}, form)
        self._announce(crossing, form, token.full_name)

    def _announce(self, crossing: Crossing, form: ActionForm, node: str) -> None:
        for part, of in _PARTS.items():
            service = of(form)
            name = action_key(crossing.name, part)
            self._announced.end(node, "SS", name, service.type, service.hash, QUALITY)

    def _open_in_robo(self, crossing: Crossing, token: EndToken) -> None:
        what = f"action /{crossing.name} of ROS"
        if crossing.key in self._in_ros or len(self._in_robo) >= MOST_ROUTES:
            self._tally.fault(
                what, f"{what} is executed in robo, too, as /{crossing.key}: robo's goals do not go to ROS"
            )
            return
        name, wanted = robo_action(token.type), crossing.rule.plan.type
        if name is None or (wanted is not None and wanted != name):
            self._misfits.unknown(what, crossing.key, token.type, wanted)
            return
        try:
            form = action_form(name)
        except NoForm as reason:
            self._tally.fault(what, f"{what} does not cross: {reason}")
            return
        if form.send_goal.hash != token.hash:
            self._misfits.hash(what, form.send_goal, token.hash, token)
            return
        doors = []
        count = self._tally.of(crossing.key, crossing.name, "from_ros")
        for part, of in _PARTS.items():
            service, ros = of(form), action_key(crossing.name, part)
            gid = self._announced.end(self._node, "SC", ros, service.type, service.hash, QUALITY)
            key = tokens.data_key(self._announced.domain, ros, service.type, service.hash)
            asked = to_ros(Asking(self._ros, key, self._workers, _patience(part)), gid)
            robo = action_key(crossing.key, part)
            doors.append(RoboDoor(self._robo, robo, service, asked, count, Pending(), self._workers))
        own = EndpointToken(*names.split(self._node), "act", name, QoS(depth=KEEP_ALL), crossing.key)
        declared = self._robo.liveliness().declare_token(own.key())
        self._in_robo[crossing.key] = Open(doors, {token.said}, form, declared)


def _patience(part: ActionPart) -> float:
    """How long an answer may take, s: a result comes when its goal is over."""
    return long_query.LONGEST if part == "get_result" else ANSWER_WITHIN


def _close(one: Open) -> None:
    if one.token is not None:
        one.token.undeclare()
    for door in one.doors:
        door.close()
