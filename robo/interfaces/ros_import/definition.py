"""What a file of ROS defines, and what is wrong with it."""

from collections.abc import Iterable
from typing import NamedTuple

from robo.errors import InterfaceError
from robo.interfaces.catalogue import Constant, Kind


class Place(NamedTuple):
    """Where something stands."""

    path: str
    """Of the file, as it was named."""
    line: int
    """From 1."""
    column: int
    """From 1."""


class Fault(NamedTuple):
    """A mistake in a file."""

    place: Place
    text: str


def refuse(faults: Iterable[Fault]) -> None:
    """Tell all faults at once.

    Raises:
        InterfaceError: there are some.
    """
    lines = [f"{place.path}:{place.line}:{place.column}: {text}" for place, text in sorted(set(faults))]
    if lines:
        raise InterfaceError("\n".join(lines))


class TypeName(NamedTuple):
    """The type of a field, as it is written."""

    base: str
    """`float32`, `Point`, `geometry_msgs/Point`."""
    letters: int | None = None
    """How long a text may be."""
    is_array: bool = False
    length: int | None = None
    """How many elements, always."""
    most: int | None = None
    """How many elements at most."""


Literal = Constant | list[Constant]


class Element(NamedTuple):
    """A field or a constant."""

    place: Place
    """Of its type."""
    type: TypeName
    name: str
    value: Literal | None
    """A constant's value, or the default that a field says."""
    docs: list[str]
    """Its comments, a line each."""


class Section(NamedTuple):
    """A message: what a file defines, or one of the parts of a service or an action."""

    docs: list[str]
    """The comments that it begins with, and those behind its last field."""
    notice: list[str]
    """A notice of copyright at its head."""
    constants: list[Element]
    fields: list[Element]


class Definition(NamedTuple):
    """A file."""

    package: str
    name: str
    kind: Kind
    path: str
    sections: list[Section]

    @property
    def ros_name(self) -> str:
        """`my_robot/Grip`."""
        return f"{self.package}/{self.name}"
