"""What a node of ROS's says of its types when asked, and in which field they differ from robo's (REP-2016)."""

from collections.abc import Mapping
from typing import NamedTuple

from msgspec import field

from robo.interfaces.type_hash import described_fields
from robo_messages import Message, message
from robo_messages._types import UInt8, UInt64


@message("type_description/FieldType")
class FieldType(Message):
    """The type of a field."""

    type_id: UInt8 = 0
    """ROS's number of it."""
    capacity: UInt64 = 0
    """Of an array."""
    string_capacity: UInt64 = 0
    """Of a text."""
    nested_type_name: str = ""
    """Of a message."""


@message("type_description/Field")
class Field(Message):
    """A field."""

    name: str = ""
    """Its name."""
    type: FieldType = field(default_factory=FieldType)
    """Its type."""
    default_value: str = ""
    """As a text."""


@message("type_description/IndividualTypeDescription")
class IndividualTypeDescription(Message):
    """A type."""

    type_name: str = ""
    """Whole."""
    fields: list[Field] = field(default_factory=list)
    """In their order."""


@message("type_description/TypeDescription")
class TypeDescription(Message):
    """A type, and all within it."""

    type_description: IndividualTypeDescription = field(default_factory=IndividualTypeDescription)
    """Itself."""
    referenced_type_descriptions: list[IndividualTypeDescription] = field(default_factory=list)
    """Those within it."""


@message("type_description/TypeSource")
class TypeSource(Message):
    """The file that says a type."""

    type_name: str = ""
    """Whole."""
    encoding: str = ""
    """How it is written: `msg`."""
    raw_file_contents: str = ""
    """Its text."""


@message("type_description/KeyValue")
class KeyValue(Message):
    """Something more."""

    key: str = ""
    """What."""
    value: str = ""
    """How it is."""


class GetTypeDescription:
    """Ask a node for one of its types."""

    @message("type_description/GetTypeDescription_Request")
    class Request(Message):
        """Which."""

        type_name: str = ""
        """Whole."""
        type_hash: str = ""
        """With RIHS01_ before it."""
        include_type_sources: bool = True
        """Whether the files are wanted, too."""

    @message("type_description/GetTypeDescription_Response")
    class Response(Message):
        """What it is."""

        successful: bool = False
        """Whether the node knows it."""
        failure_reason: str = ""
        """Why not."""
        type_description: TypeDescription = field(default_factory=TypeDescription)
        """The type."""
        type_sources: list[TypeSource] = field(default_factory=list)
        """The files."""
        extra_information: list[KeyValue] = field(default_factory=list)
        """Anything more."""


class _One(NamedTuple):
    """A field as both sides compare it."""

    name: str
    type: tuple[int, int, int, str]


def difference(name: str, theirs: TypeDescription) -> str:
    """The first field in which a type of robo's differs from ROS's, in words; empty where none does.

    Args:
        name: of the type in robo.
        theirs: what a node of ROS's says of it.

    Raises:
        UnknownType, ContractError: robo does not have it, or ROS cannot.
    """
    ours = described_fields(name)
    for one in (theirs.type_description, *theirs.referenced_type_descriptions):
        mine = ours.get(one.type_name)
        if mine is None:
            continue  # it is told of the field that has it
        found = _first(one.type_name, mine, [_One(f.name, _plain(f.type)) for f in one.fields])
        if found:
            return found
    return ""


def _plain(type_: FieldType) -> tuple[int, int, int, str]:
    return type_.type_id, type_.capacity, type_.string_capacity, type_.nested_type_name


def _first(name: str, ours: Mapping[str, tuple[int, int, int, str]], theirs: list[_One]) -> str:
    there = {one.name: one.type for one in theirs}
    for field_name, type_ in there.items():
        if field_name not in ours:
            return f"{name}.{field_name} is a field in ROS alone"
        if ours[field_name] != type_:
            return f"{name}.{field_name} is of another type in ROS"
    for field_name in ours:
        if field_name not in there:
            return f"{name}.{field_name} is a field in robo alone"
    return f"the fields of {name} are in another order" if list(ours) != list(there) else ""
