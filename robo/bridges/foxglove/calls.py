"""What clients ask of nodes: services, values of parameters, changes of them. Functions on a session that block."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import msgspec
import zenoh

import robo_messages
from robo.bridges.foxglove.offered import ServedService
from robo.bridges.foxglove.protocol import Call, Parameter
from robo.dashboard.requests import STOP
from robo.errors import MessageError, NodeUnreachable, ParameterError, RoboError
from robo.interfaces import catalogue, cdr
from robo.interfaces.message_input import message_of
from robo.node import services
from robo.text.brief import shown
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.tools import parameters
from robo.tools.parameters import Described
from robo.tools.replies import samples
from robo.wire import codec, names
from robo.wire.keys import NodeToken, parameters_key
from robo.wire.qos import QoS
from robo_messages import Message, Trigger

TIMEOUT = 5.0
"""How long a service may take, s."""
_TRIGGER = "std/Trigger"
"""The type of services that stop robots."""
_FLOATS = {"float": "float64", "list[float]": "float64_array", "tuple[float, ...]": "float64_array"}
"""What viewers call types of which JSON does not tell that they are no whole numbers."""


def call(session: zenoh.Session, asked: Call, service: ServedService) -> bytes:
    """Call a service, before everything else that is on its way; its answer in the encoding of the request.

    Raises:
        ServiceError: it refuses, or nobody answers.
        MessageError: the request is not one of its type, or its answer cannot be shown.
    """
    request, response = (catalogue.find(name) for name in robo_messages.halves_of(service.type))
    message = message_from(request, asked.encoding, asked.data)
    stamp = codec.pack_attachment(1, time.time_ns())
    payload = robo_messages.encode(message), stamp
    encoding = f"{codec.MSGPACK};{robo_messages.type_name(request)}"
    sample = services.ask(session, service.key, payload, encoding, TIMEOUT, TIMEOUT, QoS.COMMAND.priority)
    answer = codec.Decoder(response)
    try:
        said = answer.decode(sample.payload.to_bytes(), str(sample.encoding))
    except codec.Malformed as reason:
        raise MessageError(f"the answer of {service.key} cannot be read: {reason}") from None
    return robo_messages.encode_json(said) if asked.encoding == "json" else cdr.encoder(response)(said)


def is_stop(service: ServedService) -> bool:
    """Whether a service stops a robot: by its name and its type."""
    return service.key.rpartition("/")[2] == STOP and service.type == _TRIGGER


def stop_answer(asked: Call, said: object) -> bytes:
    """What an emergency stop has answered.

    Args:
        asked: the call.
        said: the answer, as plain data.

    Returns:
        It, in the encoding of the request.

    Raises:
        MessageError: it is no answer of a `Trigger`.
    """
    type_: type[Message] = Trigger.Response
    answer = message_of(type_, said)
    return robo_messages.encode_json(answer) if asked.encoding == "json" else cdr.encoder(type_)(answer)


def refusal(asked: Call, service: ServedService, why: str) -> bytes | None:
    """An answer that says that a service has not done what was asked, where its type can say so.

    Args:
        asked: the call.
        service: that was called.
        why: it has not.

    Returns:
        It, in the encoding of the request; None where the type has no `success` with a `message`.
    """
    type_ = catalogue.find_here(robo_messages.halves_of(service.type)[1])
    kinds = {field.name: field.type for field in msgspec.structs.fields(type_)} if type_ is not None else {}
    if type_ is None or (kinds.get("success"), kinds.get("message")) != (bool, str):
        return None
    said = type_(success=False, message=why)
    if asked.encoding == "json":
        return robo_messages.encode_json(said)
    return cdr.encoder(type_)(said) if asked.encoding == "cdr" else None


def message_from(type_: type[Message], encoding: str, data: bytes) -> Message:
    """A message of a client.

    Args:
        type_: what it has to be.
        encoding: `cdr` or `json`.
        data: its bytes.

    Raises:
        MessageError: it is none.
    """
    if encoding == "cdr":
        if not type_.__struct_fields__:
            return type_()  # viewers leave out the byte that ROS has in the place of nothing
        return cdr.decoder(type_)(data)
    if encoding != "json":
        raise MessageError(f"encoding {shown(encoding)} is not spoken here: use cdr or json")
    try:
        return message_of(type_, msgspec.json.decode(data or b"{}"))
    except UNREADABLE as error:
        raise MessageError(f"no JSON: {error}") from None


def all_parameters(
    session: zenoh.Session, covers: Callable[[str], bool] = lambda _: True, timeout: float = parameters.TIMEOUT
) -> list[Parameter]:
    """The parameters of every node that answers in time, as far as its full name is covered."""
    found: list[Parameter] = []
    key = parameters_key("", "**", "describe")
    for sample in samples(session.get(key, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE)):
        node = "/" + str(sample.key_expr).removesuffix("/parameters/describe")
        if not covers(node.strip("/")):
            continue
        try:
            said = msgspec.msgpack.decode(sample.payload.to_bytes(), type=readable(dict[str, Described]))
        except UNREADABLE:
            continue  # a stranger's
        found += _shown(node, said.values())
    return sorted(found, key=lambda one: one.name)


def some_parameters(
    session: zenoh.Session, wanted: Sequence[str], covers: Callable[[str], bool] = lambda _: True
) -> tuple[list[Parameter], list[str]]:
    """Parameters by name, and what is wrong with those that are not there.

    Args:
        session: the network.
        wanted: `/r1/safety_monitor.max_speed`.
        covers: which nodes are asked at all, by their full names without a slash before them.
    """
    found: list[Parameter] = []
    wrong: list[str] = []
    for node, named in by_node(wanted).items():
        try:
            _have_covered(node, covers)
            described = parameters.describe(session, _token(node), named)
        except (NodeUnreachable, ParameterError) as error:
            found += [Parameter(f"{node}.{name}") for name in named]
            wrong.append(str(error))
        else:
            found += _shown(node, described)
    return found, wrong


def set_parameters(
    session: zenoh.Session, changes: Iterable[Parameter], covers: Callable[[str], bool] = lambda _: True
) -> list[str]:
    """Set parameters, of each node that is covered all or none. Returns what was refused, and why."""
    wrong: list[str] = []
    values = {one.name: one.value for one in changes}
    for node, named in by_node(values).items():
        unset = [name for name in named if values[f"{node}.{name}"] in (None, msgspec.UNSET)]
        try:
            _have_covered(node, covers)
            if unset:
                raise ParameterError(f"{node}: {', '.join(unset)} cannot be removed")
            parameters.set_all(session, _token(node), {name: values[f"{node}.{name}"] for name in named})
        except RoboError as error:
            wrong.append(f"{node}: {error}")
    return wrong


def by_node(wanted: Iterable[str]) -> Mapping[str, list[str]]:
    """Names of parameters by the full name of their node: a node's name has no dot."""
    found: dict[str, list[str]] = {}
    for full in wanted:
        node, _, name = full.partition(".")
        found.setdefault("/" + node.strip("/"), []).append(name)
    return found


def shown_parameter(node: str, name: str, value: Any, type_name: str = "") -> Parameter:
    """A parameter as viewers have it."""
    kind = _FLOATS.get(type_name) or ("float64" if isinstance(value, float) else msgspec.UNSET)
    return Parameter(f"{node}.{name}", codec.jsonable(value), kind)


def _shown(node: str, described: Iterable[Described]) -> list[Parameter]:
    return [shown_parameter(node, one.name, one.value, one.type) for one in described]


def _have_covered(node: str, covers: Callable[[str], bool]) -> None:
    if not covers(node.strip("/")):
        raise ParameterError(f"{node} is not of the robot that this bridge is for")


def _token(node: str) -> NodeToken:
    try:
        return NodeToken(*names.split(names.absolute(node, "")), "", 0, "")
    except ValueError as error:
        raise ParameterError(str(error)) from None
