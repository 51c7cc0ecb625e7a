"""What crosses: by which name, in which direction, with which quality. Pure."""

import re
from collections.abc import Callable, Iterable, Mapping

import msgspec

from robo.errors import UsageError
from robo.launch.plan import CrossingPlan, Ros2Plan
from robo.wire import names
from robo.wire.keys import DIAGNOSTICS_TOPIC, LOG_TOPIC, PARAMETER_EVENTS_TOPIC, is_hidden

EVERYTHING: Mapping[str, CrossingPlan] = {"**": CrossingPlan(), "/clock": CrossingPlan()}
"""Where nothing is said: what the robot has goes to ROS, and nothing comes from there."""

NOTHING: Mapping[str, str] = {}

_OF_ALL_ROBOTS = ("tf", "tf_static", DIAGNOSTICS_TOPIC)
"""Topics that a ROS graph has once: their names have no robot in them."""
_NO_TOPICS = (LOG_TOPIC, PARAMETER_EVENTS_TOPIC)
"""What crosses in another form."""
_WILD = re.compile(r"\*\*|\*")


class Rule(msgspec.Struct, frozen=True):
    """A name, or a pattern of names."""

    robo: str
    """Keys in robo, with `*` and `**`."""
    ros: str
    """Names in ROS, without their leading slash, with the same `*` and `**`."""
    plan: CrossingPlan
    is_own: bool = False
    """Whether it is of what each node of robo's says beside its topics: its log, its changed parameters."""

    @property
    def is_exact(self) -> bool:
        """Whether it is of one name."""
        return "*" not in self.robo

    @property
    def to_ros(self) -> bool:
        """Whether what robo says goes to ROS."""
        return self.plan.direction != "from_ros"

    @property
    def from_ros(self) -> bool:
        """Whether what ROS says comes to robo."""
        return self.plan.direction != "to_ros"


class Crossing(msgspec.Struct, frozen=True):
    """A topic, a service or an action that crosses."""

    key: str
    """In robo."""
    name: str
    """In ROS, without its leading slash."""
    rule: Rule


class Rules:
    """The rules of one kind of thing; names come before patterns, and of these the first that fits decides."""

    def __init__(
        self,
        said: Mapping[str, CrossingPlan],
        namespace: str,
        own: Mapping[str, str] = NOTHING,
        actions: "Rules | None" = None,
    ) -> None:
        """
        Args:
            said: by name in robo.
            namespace: of the robot: what names that do not begin with / are within.
            own: what each node of robo's says beside its topics, by its last word: how it is called in ROS.
            actions: the rules for actions, of which each has two topics.

        Raises:
            UsageError: a name is none, or patterns do not fit each other; tells all that is wrong.
        """
        wrong: list[str] = []
        found: list[Rule] = []
        for name, plan in said.items():
            try:
                found.append(_rule(name, plan, namespace))
            except ValueError as error:
                wrong.append(str(error))
        found += [
            Rule(names.join(namespace, "**", word), ros, CrossingPlan(), is_own=True) for word, ros in own.items()
        ]
        rules = sorted(
            found, key=lambda rule: not (rule.is_exact or rule.is_own)
        )  # stable: what was said first comes first
        wrong += _clashes(rule for rule in rules if not rule.is_own)
        if wrong:
            raise UsageError("\n".join(wrong))
        self.rules = tuple(rules)
        self._actions = actions
        self._forms = [(rule, _expression(rule.robo), _expression(rule.ros)) for rule in rules]

    def patterns_to_ros(self) -> list[str]:
        """The keys in robo of what goes to ROS."""
        of_actions = self._actions.patterns_to_ros() if self._actions is not None else ()
        return [*(rule.robo for rule in self.rules if rule.to_ros), *(f"{one}{_ACTION}*" for one in of_actions)]

    def patterns_from_ros(self) -> list[str]:
        """The names in ROS of what comes from there."""
        of_actions = self._actions.patterns_from_ros() if self._actions is not None else ()
        return [*(rule.ros for rule in self.rules if rule.from_ros), *(f"{one}{_ACTION}*" for one in of_actions)]

    def to_ros(self, key: str) -> Crossing | None:
        """What becomes in ROS of a key of robo's; None where it does not go there."""
        if self._actions is not None and _ACTION in key:
            return _of_action(key, self._actions.to_ros)
        for rule, robo, _ in self._forms:
            match = robo.fullmatch(key)
            if match is not None and (rule.is_exact or rule.is_own or crosses_by_name(key)):
                name = _filled(rule.ros, match) if rule.plan.ros or rule.is_own else _default_name(key)
                return Crossing(key, name, rule) if rule.to_ros else None
        return None

    def from_ros(self, name: str) -> Crossing | None:
        """What becomes in robo of a name of ROS's, without its leading slash; None where it does not come."""
        if self._actions is not None and _ACTION in name:
            return _of_action(name, self._actions.from_ros)
        for rule, _, ros in self._forms:
            if rule.from_ros and (match := ros.fullmatch(name)) is not None:
                key = _filled(rule.robo, match)
                return Crossing(key, name, rule) if rule.is_exact or crosses_by_name(key) else None
        return None

    def crossing_from_ros(self, key: str) -> Crossing | None:
        """What brings a key of robo's from ROS; None where nothing does."""
        for rule, robo, _ in self._forms:
            if rule.from_ros and (match := robo.fullmatch(key)) is not None:
                return Crossing(key, _filled(rule.ros, match), rule)
        return None

    def key_in_robo(self, name: str, *, says: bool) -> str | None:
        """The key in robo of a topic or service of ROS's, without its leading slash; None for one that does not cross.

        Args:
            name: in ROS.
            says: whether it is about who says or serves it there, and not about who hears or calls it.
        """
        if says:
            found = self.from_ros(name)
            return found.key if found is not None else None
        for rule, _, ros in self._forms:
            match = ros.fullmatch(name)
            if (
                rule.to_ros
                and not rule.is_own
                and match is not None
                and self.to_ros(key := _filled(rule.robo, match)) is not None
            ):
                return key
        return None


class Crossings(msgspec.Struct, frozen=True):
    """All rules of a bridge."""

    namespace: str
    topics: Rules
    services: Rules
    actions: Rules
    plan: Ros2Plan


def crossings_of(plan: Ros2Plan, namespace: str) -> Crossings:
    """The rules of a plan, for the robot of a namespace.

    Raises:
        UsageError: names are not valid, or two rules contradict each other.
    """
    own = ({LOG_TOPIC: "rosout"} if plan.rosout else {}) | (
        {} if plan.parameters == "none" else {PARAMETER_EVENTS_TOPIC: "parameter_events"}
    )
    services, actions = (
        Rules(EVERYTHING if said is None else said, namespace) for said in (plan.services, plan.actions)
    )
    topics = Rules(EVERYTHING if plan.topics is None else plan.topics, namespace, own, actions)
    return Crossings(namespace, topics, services, actions, plan)


def _rule(name: str, plan: CrossingPlan, namespace: str) -> Rule:
    key = names.shown_key(names.key_of(name))
    robo = key if name.startswith("/") else names.join(namespace, key)
    ros = names.shown_key(names.key_of(plan.ros)) if plan.ros else _default_name(robo)
    if _WILD.findall(robo) != _WILD.findall(ros):
        raise ValueError(f"{name}: {plan.ros} needs the same * and ** in the same order")
    return Rule(robo, ros, plan)


_ACTION = "/_action/"
_TOPICS_OF_ACTIONS = ("feedback", "status")


def _of_action(name: str, crosses: Callable[[str], Crossing | None]) -> Crossing | None:
    """How a topic of an action crosses: as its action does."""
    action, _, part = name.rpartition(_ACTION)
    found = crosses(action) if part in _TOPICS_OF_ACTIONS else None
    if found is None:
        return None
    direction = found.rule.plan.direction
    rule = msgspec.structs.replace(found.rule, plan=CrossingPlan(ros=found.name, direction=direction))
    return Crossing(f"{found.key}{_ACTION}{part}", f"{found.name}{_ACTION}{part}", rule)


def _clashes(rules: Iterable[Rule]) -> list[str]:
    """Rules of one name that say something else."""
    seen: dict[str, Rule] = {}
    wrong = []
    for rule in rules:
        before = seen.setdefault(rule.ros, rule)
        if before is not rule:
            wrong.append(f"/{before.robo} and /{rule.robo} are both /{rule.ros} in ROS: leave one of them out")
    return wrong


def _default_name(key: str) -> str:
    last = key.rpartition("/")[2]
    return last if last in _OF_ALL_ROBOTS else key


def crosses_by_name(key: str) -> bool:
    """Whether patterns mean a key: not what crosses in another form, or is no topic."""
    return key.rpartition("/")[2] not in _NO_TOPICS and not is_hidden(key) and all(map(names.is_word, key.split("/")))


def _expression(pattern: str) -> re.Pattern[str]:
    """What a pattern fits; each `*` and `**` is a group."""
    *outer, last = pattern.split("/")
    text = "".join("((?:[^/]+/)*)" if chunk == "**" else f"{_chunk(chunk)}/" for chunk in outer)
    return re.compile(text + ("(.+)" if last == "**" else _chunk(last)))


def _chunk(chunk: str) -> str:
    return re.escape(chunk).replace(r"\*", "([^/]*)")


def _filled(pattern: str, match: re.Match[str]) -> str:
    """A name with what was found for each `*` and `**`."""
    found = iter(match.groups())
    return names.join(*(_WILD.sub(lambda _: next(found).strip("/"), chunk) for chunk in pattern.split("/")))
