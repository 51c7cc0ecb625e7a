"""Types on both sides: robo's by ROS's name and hash, and how the bytes of either become the other's.

Types of users are imported when one of them is met first.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec

import robo_messages
from robo.bag.types import of_robo
from robo.bridges.ros2.tokens import dds_type, ros_type
from robo.errors import ContractError, MessageError
from robo.interfaces import catalogue, cdr
from robo.interfaces.ros_names import full_name
from robo.interfaces.type_hash import type_hash
from robo.text.brief import brief
from robo.text.unreadable import UNREADABLE
from robo.wire import codec
from robo.wire.actions import ActionTypes, action_types
from robo.wire.codec import Malformed
from robo_messages import Message, UnknownType
from robo_messages._types import Int8
from robo_messages.action import parts_of
from robo_messages.std import Time

_MOST_REASON = 300
"""Of what is quoted of somebody's message, characters."""


_FEEDBACK = "_FeedbackMessage"


class Form(NamedTuple):
    """Messages of one type: of a topic, or of one half of a service."""

    name: str
    """In robo."""
    type: str
    """As DDS has it."""
    hash: str
    encoding: str
    """Zenoh's, in robo."""
    to_cdr: Callable[[bytes], bytes]
    """A payload of robo's as CDR. Raises Malformed."""
    to_robo: Callable[[bytes], bytes]
    """CDR as a payload of robo's. Raises Malformed."""


class ServiceForm(NamedTuple):
    """A service."""

    name: str
    """In robo."""
    type: str
    """As DDS has it."""
    hash: str
    request: Form
    response: Form


class ActionForm(NamedTuple):
    """An action: what ROS makes of it."""

    name: str
    send_goal: ServiceForm
    get_result: ServiceForm
    cancel_goal: ServiceForm
    feedback: Form
    status: Form


class NoForm(Exception):
    """A type that cannot cross; the text says why."""


@functools.lru_cache(2048)
def form_of(name: str) -> Form:
    """Messages of one of robo's types.

    Raises:
        NoForm: it is not known here, or ROS cannot have it.
    """
    if name.endswith(_FEEDBACK) and is_action(name.removesuffix(_FEEDBACK)):
        return action_form(name.removesuffix(_FEEDBACK)).feedback
    type_ = _found(name)
    ros = full_name(name)
    return _form(name, dds_type(ros), _hash(name), type_, type_)


@functools.lru_cache(1024)
def service_form(name: str) -> ServiceForm:
    """A service of robo's. Raises as `form_of`."""
    request, response = (form_of(half) for half in robo_messages.halves_of(name))
    return ServiceForm(name, dds_type(full_name(name, "service")), _hash(name), request, response)


@functools.lru_cache(256)
def action_form(name: str) -> ActionForm:
    """An action of robo's. Raises as `form_of`."""
    goal, result, feedback = (_found(part) for part in parts_of(name))
    try:
        types = action_types(goal, result, feedback)
        hashes = {end: type_hash(f"{name}_{end}") for end in ("SendGoal", "GetResult", "FeedbackMessage")}
    except (ContractError, UnknownType) as error:
        raise NoForm(str(error)) from None
    ros = full_name(name, "action")
    send, get = _ros_halves(types)

    def service(end: str, robo: tuple[Any, Any], in_ros: tuple[Any, Any]) -> ServiceForm:
        halves = (
            _form(robo_messages.type_name(one), "", "", one, other) for one, other in zip(robo, in_ros, strict=True)
        )
        return ServiceForm(f"{name}_{end}", dds_type(f"{ros}_{end}"), hashes[end], *halves)

    message = types.feedback_message
    return ActionForm(
        name,
        service("SendGoal", (types.send_goal_request, types.send_goal_response), (types.send_goal_request, send)),
        service("GetResult", (types.get_result_request, types.get_result_response), (types.get_result_request, get)),
        service_form("action/CancelGoal"),
        _form(
            f"{name}_FeedbackMessage", dds_type(f"{ros}_FeedbackMessage"), hashes["FeedbackMessage"], message, message
        ),
        form_of("action/GoalStatusArray"),
    )


def robo_type(type_: str) -> str | None:
    """Robo's name of a type as DDS has it; None where robo has none."""
    ros = ros_type(type_)
    if ros.endswith(_FEEDBACK) and "/action/" in ros:
        action = robo_action(type_.removesuffix(f"{_FEEDBACK}_") + "_SendGoal_")
        return f"{action}{_FEEDBACK}" if action is not None else None
    known = of_robo(ros)
    return known.name if known is not None else None


def is_action(name: str) -> bool:
    """Whether a name of robo's is one of an action."""
    return f"{name}_Goal" in catalogue.known()


def robo_service(type_: str) -> str | None:
    """Robo's name of a service's type as DDS has it; None where robo has none."""
    ros = ros_type(type_)
    known = of_robo(f"{ros}_Request")
    return known.name.removesuffix("_Request") if known is not None else None


def robo_action(type_: str) -> str | None:
    """Robo's name of an action by the type of its `send_goal` as DDS has it; None where robo has none."""
    ros = ros_type(type_).removesuffix("_SendGoal")
    for name in catalogue.known():
        whole, kind = catalogue.whole_of(name)
        if kind == "action" and full_name(whole, "action") == ros:
            return whole
    return None


def _found(name: str) -> type[Message]:
    try:
        found = catalogue.find_here(name)
    except Exception as error:  # of a user's module, or of a disk on which it is looked for
        raise NoForm(brief(f"type {name} cannot be used: {type(error).__name__}: {error}", _MOST_REASON)) from None
    if found is None:
        raise NoForm(f"type {brief(name, 100)} is not known here")
    return found


def _hash(name: str) -> str:
    try:
        return type_hash(name)
    except (ContractError, UnknownType) as error:
        raise NoForm(f"ROS cannot have type {name}: {error}") from None


def _form(name: str, dds: str, hash_: str, robo: Any, ros: Any) -> Form:
    """A form of a class in robo and one in ROS, which may have fewer fields."""
    try:
        encode, decode = cdr.encoder(ros), cdr.decoder(ros)
    except (ContractError, UnknownType) as error:
        raise NoForm(f"ROS cannot have type {name}: {error}") from None
    reader = codec.Decoder(robo)
    fast, write = reader.fast, robo_messages.encode
    fields = ros.__struct_fields__

    def to_cdr(payload: bytes) -> bytes:
        try:
            try:
                message = fast(payload)
            except UNREADABLE:
                message = reader.decode_other(payload, "")
            return encode(message if robo is ros else ros(*(getattr(message, field) for field in fields)))
        except Malformed:
            raise
        except MessageError as error:
            raise Malformed(f"ROS cannot have it: {brief(str(error), _MOST_REASON)}") from None
        except Exception as error:  # a user's class of messages may raise anything
            raise Malformed(brief(f"{type(error).__name__}: {error}", _MOST_REASON)) from None

    def to_robo(data: bytes) -> bytes:
        try:
            message = decode(data)
            return write(message if robo is ros else robo(**{field: getattr(message, field) for field in fields}))
        except Exception as error:  # as above
            raise Malformed(brief(f"{type(error).__name__}: {error}", _MOST_REASON)) from None

    return Form(name, dds, hash_, f"{codec.MSGPACK};{name}", to_cdr, to_robo)


def _ros_halves(types: ActionTypes) -> tuple[Any, Any]:
    """The answers to `send_goal` and `get_result` as ROS has them: without robo's reasons."""

    def made(part: str, *fields: tuple[Any, ...]) -> Any:
        type_: Any = msgspec.defstruct(f"Ros{part}", fields, bases=(Message,), module=__name__)
        return robo_messages.message(f"{types.name}_Ros{part}")(type_)

    return (
        made("SendGoal", ("accepted", bool, False), ("stamp", Time, msgspec.field(default_factory=Time))),
        made("GetResult", ("status", Int8, 0), ("result", types.result, msgspec.field(default_factory=types.result))),
    )
