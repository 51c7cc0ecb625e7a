"""The hashes by which ROS tells types apart: RIHS01, over names and types of fields (REP-2011, REP-2016)."""

import json
from collections.abc import Iterable
from typing import NamedTuple

import robo_messages
from robo.interfaces import catalogue
from robo.interfaces.catalogue import PARTS, Kind
from robo.interfaces.ros_names import full_name, made_of
from robo.interfaces.ros_shape import Array, Part, Shape, Single, shape_of
from robo.interfaces.ros_shape import Kind as FieldKind
from robo.interfaces.ros_text import within_of

_IDS = {
    "int8": 2,
    "uint8": 3,
    "char": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
    "wstring": 18,
}
"""ROS's numbers of types; a `char` of a `.msg` file is a uint8."""
_NESTED = 1
_BOUNDED_TEXT = 4
"""What a bound adds to the number of a text's type."""
_FIXED, _BOUNDED, _ANY_LENGTH = 48, 96, 144
"""What arrays add to the number of their elements' type."""


class _Type(NamedTuple):
    number: int
    capacity: int = 0
    name: str = ""
    """Of a message."""
    letters: int = 0
    """How long a text may be."""


class _Description(NamedTuple):
    """A type, and what is within it by name."""

    name: str
    fields: list[tuple[str, _Type]]
    within: "dict[str, _Description]"


def type_hash(name: str, kind: Kind | None = None) -> str:
    """The hash of a message, a service or an action: `RIHS01_` and 64 digits.

    Args:
        name: of the type in robo. A part of a service or an action has a hash of its own, and so has what ROS makes of
            them: `std/Trigger_Event`, `example/Fibonacci_SendGoal`, `…_SendGoal_Request`, `…_FeedbackMessage`.
        kind: `service` for `std/Empty` as a service; else the name says it.

    Raises:
        UnknownType: there is no such type.
        ContractError: ROS cannot have it; names the field.
    """
    return _hash(_described(name, kind))


def described_fields(name: str) -> dict[str, dict[str, tuple[int, int, int, str]]]:
    """The fields of a type and of all within it, as a description in ROS has them.

    Returns:
        By the whole name of each type, by field in its order: ROS's number of its type, the capacity of an array,
        that of a text, and the name of a message.

    Raises:
        UnknownType, ContractError: as `type_hash`.
    """
    whole = _described(name)
    return {
        one.name: {field: (type_.number, type_.capacity, type_.letters, type_.name) for field, type_ in one.fields}
        for one in (whole, *whole.within.values())
    }


def _hash(described: _Description) -> str:
    referenced = [_plain(described.within[one]) for one in sorted(described.within)]
    whole = {"type_description": _plain(described), "referenced_type_descriptions": referenced}
    import hashlib  # OpenSSL is 4 MB, and nodes that read recordings want no hashes

    return f"RIHS01_{hashlib.sha256(json.dumps(whole).encode()).hexdigest()}"


def _plain(described: _Description) -> dict[str, object]:
    fields = [
        {
            "name": name,
            "type": {
                "type_id": type_.number,
                "capacity": type_.capacity,
                "string_capacity": type_.letters,
                "nested_type_name": type_.name,
            },
        }
        for name, type_ in described.fields
    ]
    return {"type_name": described.name, "fields": fields}


def _described(name: str, kind: Kind | None = None) -> _Description:
    made = made_of(name)
    if made is not None:
        return _described(*made).within[full_name(name)]
    parts = [_message(shape_of(catalogue.find(part))) for part in catalogue.parts(name)]
    match parts:
        case [message] if kind == "service":
            whole = full_name(name, kind)
            halves = (message._replace(name=f"{whole}_{half}") for half in PARTS[kind])
            return _service(whole, *halves)
        case [message]:
            return message
        case [request, response]:
            return _service(full_name(name, "service"), request, response)
    return _action(full_name(name, "action"), *parts)


def _message(shape: Shape) -> _Description:
    within = {one.ros_name: _Description(one.ros_name, _message_fields(one), {}) for one in within_of(shape)}
    return _Description(shape.ros_name, _message_fields(shape), within)


def _message_fields(shape: Shape) -> list[tuple[str, _Type]]:
    fields = [(field.name, _type(field.kind)) for field in shape.fields]
    return fields or [("structure_needs_at_least_one_member", _Type(_IDS["uint8"]))]


def _type(kind: FieldKind) -> _Type:
    match kind:
        case Single(word):
            return _Type(_IDS[word]) if kind.most is None else _Type(_IDS[word] + _BOUNDED_TEXT, letters=kind.most)
        case Part(shape):
            return _Type(_NESTED, name=shape.ros_name)
        case Array():
            one = _type(kind.item)
            if kind.length is not None:
                return one._replace(number=one.number + _FIXED, capacity=kind.length)
            if kind.most is not None:
                return one._replace(number=one.number + _BOUNDED, capacity=kind.most)
            return one._replace(number=one.number + _ANY_LENGTH)


def _of(name: str, fields: list[tuple[str, _Type]], inner: Iterable[_Description]) -> _Description:
    within: dict[str, _Description] = {}
    for one in inner:
        within |= {**one.within, one.name: one}
    return _Description(name, fields, within)


def _made(name: str, **fields: _Description) -> _Description:
    """A message of messages, which ROS makes of a service or an action."""
    return _of(name, [(key, _Type(_NESTED, name=one.name)) for key, one in fields.items()], fields.values())


def _service(name: str, request: _Description, response: _Description) -> _Description:
    event = _of(
        f"{name}_Event",
        [
            ("info", _Type(_NESTED, name=_EVENT)),
            ("request", _Type(_NESTED + _BOUNDED, 1, request.name)),
            ("response", _Type(_NESTED + _BOUNDED, 1, response.name)),
        ],
        [_event_info(), request, response],
    )
    return _made(name, request_message=request, response_message=response, event_message=event)


_EVENT = "service_msgs/msg/ServiceEventInfo"


def _event_info() -> _Description:
    """What ROS's introspection says of each request and response."""
    time = _shipped("std/Time")
    fields = [
        ("event_type", _Type(_IDS["uint8"])),
        ("stamp", _Type(_NESTED, name=time.name)),
        ("client_gid", _Type(_IDS["char"] + _FIXED, 16)),
        ("sequence_number", _Type(_IDS["int64"])),
    ]
    return _of(_EVENT, fields, [time])


def _shipped(name: str) -> _Description:
    return _message(shape_of(robo_messages.find_type(name)))


def _action(name: str, goal: _Description, result: _Description, feedback: _Description) -> _Description:
    uuid, time = _shipped("action/UUID"), _shipped("std/Time")
    id_field = ("goal_id", _Type(_NESTED, name=uuid.name))
    accepted = [("accepted", _Type(_IDS["bool"])), ("stamp", _Type(_NESTED, name=time.name))]
    status = [("status", _Type(_IDS["int8"])), ("result", _Type(_NESTED, name=result.name))]
    send = f"{name}_SendGoal"
    get = f"{name}_GetResult"
    return _made(
        name,
        goal=goal,
        result=result,
        feedback=feedback,
        send_goal_service=_service(
            send,
            _made(f"{send}_Request", goal_id=uuid, goal=goal),
            _of(f"{send}_Response", accepted, [time]),
        ),
        get_result_service=_service(
            get, _of(f"{get}_Request", [id_field], [uuid]), _of(f"{get}_Response", status, [result])
        ),
        feedback_message=_made(f"{name}_FeedbackMessage", goal_id=uuid, feedback=feedback),
    )
