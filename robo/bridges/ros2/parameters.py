"""Parameters of robo's nodes, served as those of ROS's nodes are: six services for each node. Used by the steward."""

from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import zenoh

import robo_messages
from robo.bridges.ros2 import tokens
from robo.bridges.ros2.announced import Announced
from robo.bridges.ros2.calls import Answer, Asking, Pending, RosDoor, Workers
from robo.bridges.ros2.forms import service_form
from robo.bridges.ros2.parameter_types import (
    Answers,
    Changes,
    FloatingPointRange,
    IntegerRange,
    ListParametersResult,
    Names,
    ParameterDescriptor,
    SetParametersResult,
)
from robo.bridges.ros2.services import QUALITY
from robo.bridges.ros2.tally import Count
from robo.interfaces.ros_values import ANY
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.tools.parameters import Described
from robo.wire import names
from robo.wire.keys import NodeToken, parameters_key
from robo.wire.queries import Fault
from robo.wire.reports import Result
from robo_messages import Message
from robo_messages.system import Parameter

_WITHIN = 5.0
"""How long a node may take to answer, s."""
_MOST_NODES = 300
"""Nodes whose parameters are served."""
_WIDEST = float(2**63)

Tell = Callable[[Answer], None]
Then = Callable[[Any], None]

_SERVED: dict[str, type[Message]] = {
    "get_parameters": Names.Get,
    "get_parameter_types": Names.Types,
    "describe_parameters": Names.Describe,
    "list_parameters": Names.List,
    "set_parameters": Changes.Each,
    "set_parameters_atomically": Changes.All,
}
"""By the name of the service, its request."""


class Parameters:
    """The parameters of all nodes of a robot."""

    def __init__(
        self, robo: zenoh.Session, ros: zenoh.Session, announced: Announced, workers: Workers, *, writes: bool
    ) -> None:
        """
        Args:
            robo, ros: the networks.
            announced: what is announced in ROS.
            workers: hand answers back.
            writes: whether ROS may set them.
        """
        self._robo, self._ros, self._announced, self._workers, self._writes = robo, ros, announced, workers, writes
        self._doors: dict[str, tuple[int, list[RosDoor]]] = {}

    def meet(self, token: NodeToken, is_there: bool) -> None:
        """A node of the robot has come, or is gone."""
        count, doors = self._doors.get(token.full_name, (0, []))
        if is_there:
            if not doors and len(self._doors) < _MOST_NODES:
                doors = self._open(token)
            self._doors[token.full_name] = count + 1, doors
        elif count > 1:
            self._doors[token.full_name] = count - 1, doors
        else:
            self._doors.pop(token.full_name, None)
            for door in doors:
                door.close()

    def close(self) -> None:
        """Serve no more."""
        for _, doors in self._doors.values():
            for door in doors:
                door.close()
        self._doors.clear()

    def _open(self, token: NodeToken) -> list[RosDoor]:
        doors = []
        node = Node(self._robo, token, self._workers, writes=self._writes)
        for service, request in _SERVED.items():
            form = service_form(robo_messages.type_name(request).removesuffix("_Request"))
            name = names.join(token.namespace, token.node, service)
            self._announced.end(token.full_name, "SS", name, form.type, form.hash, QUALITY)
            key = tokens.data_key(self._announced.domain, name, form.type, form.hash)
            asked = node.asked(service, request)
            doors.append(RosDoor(self._ros, key, form, asked, Count(name, name, "to_ros"), Pending(), self._workers))
        return doors


class Node:
    """The parameters of one node."""

    def __init__(self, session: zenoh.Session, token: NodeToken, workers: Workers, *, writes: bool) -> None:
        """
        Args:
            session: robo's network.
            token: of the node.
            workers: hand answers back.
            writes: whether they may be set.
        """
        self._session, self._token, self._workers, self._writes = session, token, workers, writes

    def asked(self, service: str, request: type[Message]) -> Callable[[bytes, Tell], None]:
        """What answers one of the six services."""
        answer: Callable[[Any, Tell], None] = getattr(self, f"_{service}")

        def ask(payload: bytes, tell: Tell) -> None:
            answer(robo_messages.decode(payload, request), tell)

        return ask

    def _get_parameters(self, request: Names.Get, tell: Tell) -> None:
        def then(values: dict[str, Any]) -> None:
            tell(robo_messages.encode(Answers.Get([values.get(name) for name in request.names])))

        self._ask("get", None, dict[str, Any], then, tell)

    def _get_parameter_types(self, request: Names.Types, tell: Tell) -> None:
        def then(values: dict[str, Any]) -> None:
            types = [ANY.to_ros(values.get(name)).type for name in request.names]
            tell(robo_messages.encode(Answers.Types(types)))

        self._ask("get", None, dict[str, Any], then, tell)

    def _list_parameters(self, request: Names.List, tell: Tell) -> None:
        def then(values: dict[str, Any]) -> None:
            tell(robo_messages.encode(Answers.List(listed(list(values), request.prefixes, request.depth))))

        self._ask("get", None, dict[str, Any], then, tell)

    def _describe_parameters(self, request: Names.Describe, tell: Tell) -> None:
        def then(found: dict[str, Described]) -> None:
            tell(robo_messages.encode(Answers.Describe([descriptor(name, found.get(name)) for name in request.names])))

        self._ask("describe", None, dict[str, Described], then, tell)

    def _set_parameters(self, request: Changes.Each, tell: Tell) -> None:
        results: list[SetParametersResult] = []

        def next_one(result: SetParametersResult | None = None) -> None:
            if result is not None:
                results.append(result)
            if len(results) < len(request.parameters):
                self._set([request.parameters[len(results)]], next_one)
            else:
                tell(robo_messages.encode(Answers.Each(results)))

        next_one()

    def _set_parameters_atomically(self, request: Changes.All, tell: Tell) -> None:
        self._set(request.parameters, lambda result: tell(robo_messages.encode(Answers.All(result))))

    def _set(self, parameters: Sequence[Parameter], then: Callable[[SetParametersResult], None]) -> None:
        if not self._writes:
            then(SetParametersResult(False, "the bridge to ROS 2 lets nobody set parameters"))
            return
        changes = {one.name: one.value for one in parameters}
        if not changes:
            then(SetParametersResult(True))
            return

        def done(result: Result) -> None:
            then(SetParametersResult(result.successful, result.reason))

        def failed(answer: Answer) -> None:
            then(SetParametersResult(False, answer.message if isinstance(answer, Fault) else ""))

        self._ask("set", changes, Result, done, failed)

    def _ask(self, verb: str, request: object, kind: Any, then: Then, tell: Tell) -> None:
        key = parameters_key(self._token.namespace, self._token.node, verb)
        said = {"payload": msgspec.msgpack.encode(request)} if request is not None else {}

        def take(answer: Answer) -> None:
            if isinstance(answer, Fault):
                tell(answer)
                return
            try:
                found = msgspec.msgpack.decode(answer, type=readable(kind))
            except UNREADABLE as error:
                tell(Fault("Malformed", f"the answer of {self._token.full_name} cannot be read: {error}"))
                return
            then(found)

        Asking(self._session, key, self._workers, _WITHIN).ask(take, **said)


def listed(there: Sequence[str], prefixes: Sequence[str], depth: int) -> ListParametersResult:
    """The names that ROS means.

    Args:
        there: all names.
        prefixes: what they are below; empty for all.
        depth: how many dots they have at most below their prefix; 0 for any number.
    """
    found = [name for name in there if any(not depth or rest.count(".") < depth for rest in _rests(name, prefixes))]
    return ListParametersResult(found, sorted({name.rpartition(".")[0] for name in found if "." in name}))


def _rests(name: str, prefixes: Sequence[str]) -> list[str]:
    """What stands behind each prefix that a name has; the name where there are none."""
    if not prefixes:
        return [name]
    return [name.removeprefix(f"{one}.") for one in prefixes if name == one or name.startswith(f"{one}.")]


def descriptor(name: str, about: Described | None) -> ParameterDescriptor:
    """What ROS is told of a parameter."""
    if about is None:
        return ParameterDescriptor(name)
    least, most = (_limit(about.constraints, *words) for words in (("ge", "gt"), ("le", "lt")))
    value = ANY.to_ros(about.value)
    found = ParameterDescriptor(name, value.type, _text(about), _constraints(about), about.read_only)
    if least is None and most is None:
        return found
    if value.type == _INTEGER:
        low, high = (int(max(-_WIDEST, min(_WIDEST - 1024, one))) for one in (_or(least, -_WIDEST), _or(most, _WIDEST)))
        return msgspec.structs.replace(found, integer_range=IntegerRange(low, high))
    if value.type == _DOUBLE:
        limits = FloatingPointRange(_or(least, -_LARGEST), _or(most, _LARGEST))
        return msgspec.structs.replace(found, floating_point_range=limits)
    return found


_INTEGER, _DOUBLE = 2, 3
_LARGEST = 1.7976931348623157e308


def _limit(constraints: dict[str, float | int | str], *words: str) -> float | None:
    found = (constraints.get(word) for word in words)
    return next((float(one) for one in found if isinstance(one, (int, float))), None)


def _or(limit: float | None, other: float) -> float:
    return other if limit is None else limit


def _text(about: Described) -> str:
    return f"{about.description} [{about.unit}]" if about.unit else about.description


def _constraints(about: Described) -> str:
    return ", ".join(f"{name} {value}" for name, value in about.constraints.items())
