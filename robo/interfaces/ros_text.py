"""Message types as ROS writes them: the text of a `.msg`, `.srv` or `.action` file."""

from typing import Any, get_args, get_type_hints

from msgspec import inspect

import robo_messages
from robo.interfaces import catalogue
from robo_messages import Message

_PACKAGES = {
    "action": "action_msgs",
    "example": "example_interfaces",
    "std": "std_msgs",
    "geometry": "geometry_msgs",
    "nav": "nav_msgs",
    "nav2": "nav2_msgs",
    "sensor": "sensor_msgs",
    "diagnostic": "diagnostic_msgs",
    "lifecycle": "lifecycle_msgs",
    "tf2": "tf2_msgs",
    "visualization": "visualization_msgs",
    "system": "rcl_interfaces",
}
_ELSEWHERE = {
    "action/UUID": "unique_identifier_msgs/UUID",
    "std/Time": "builtin_interfaces/Time",
    "std/Duration": "builtin_interfaces/Duration",
    "std/Trigger": "std_srvs/Trigger",
    "std/SetBool": "std_srvs/SetBool",
    "system/Clock": "rosgraph_msgs/Clock",
}


def ros_name(name: str) -> str:
    """A type's name in ROS: `geometry/Twist` is `geometry_msgs/Twist`."""
    group, _, type_name = name.partition("/")
    return _ELSEWHERE.get(name) or f"{_PACKAGES.get(group, group)}/{type_name}"


def ros_text(name: str) -> str:
    """The definition of a message, a service or an action.

    Raises:
        robo_messages.UnknownType: there is no such type.
    """
    parts = [_message(catalogue.find(part)) for part in catalogue.parts(name)]
    return "\n---\n".join(["\n".join([f"# {ros_name(name)}", *parts[0]]), *("\n".join(part) for part in parts[1:])])


def _message(type_: type[Message]) -> list[str]:
    interface = catalogue.describe(type_)
    lines = [f"# {line}".rstrip() for line in interface.description.splitlines()]
    lines += [f"{kind} {key}={interface.constants[key]}" for key, kind in _constant_types(type_, interface).items()]
    info = inspect.type_info(type_)
    assert isinstance(info, inspect.StructType)
    for field, said in zip(info.fields, interface.fields, strict=True):
        if said.description:
            lines.append(f"# {said.description}")
        lines.append(f"{ros_type(field.type)} {field.encode_name}{_default(said.default, field.type)}")
    return lines


def _constant_types(type_: type[Message], interface: catalogue.Interface) -> dict[str, str]:
    """The constants with their types: the one that is said, else one byte with or without sign."""
    byte = "int8" if any(value < 0 for value in interface.constants.values()) else "uint8"
    hints = get_type_hints(type_, include_extras=True)
    return {key: _said(get_args(hints[key])) or byte for key in interface.constants}


def _said(said: tuple[Any, ...]) -> str | None:
    """What the type within a ClassVar is called in ROS; None for a plain one."""
    info = inspect.type_info(said[0])
    return str(info.extra["ros"]) if isinstance(info, inspect.Metadata) and info.extra else None


def ros_type(info: inspect.Type) -> str:
    """A field's type as ROS writes it: `float32[]`, `geometry_msgs/Point`."""
    if isinstance(info, inspect.Metadata):
        return str((info.extra or {}).get("ros") or ros_type(info.type))
    if isinstance(info, inspect.StructType):
        return ros_name(robo_messages.type_name(info.cls)) if issubclass(info.cls, Message) else info.cls.__name__
    if isinstance(info, (inspect.ListType, inspect.VarTupleType)):
        fixed = info.min_length if info.min_length == info.max_length else None
        return f"{ros_type(info.item_type)}[{'' if fixed is None else fixed}]"
    names: dict[type[inspect.Type], str] = {
        inspect.FloatType: "float64",
        inspect.IntType: "int64",
        inspect.BoolType: "bool",
        inspect.StrType: "string",
        inspect.BytesType: "uint8[]",
        inspect.ByteArrayType: "uint8[]",
        inspect.MemoryViewType: "uint8[]",
        inspect.AnyType: "rcl_interfaces/ParameterValue",
    }
    return names.get(type(info), "string")


def _default(value: object, info: inspect.Type) -> str:
    """A default other than ROS's own zero; arrays have none."""
    if ros_type(info).endswith("]"):
        return ""
    single = isinstance(value, (bool, int, float, str)) and not isinstance(info, inspect.StructType)
    return f" {catalogue.default_text(value)}" if single and value else ""
