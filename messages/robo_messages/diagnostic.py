"""How well parts of a robot do (ROS: diagnostic_msgs)."""

from typing import Annotated, ClassVar

from msgspec import Meta, field

from robo_messages._registry import Message, message
from robo_messages.std import Header


@message("diagnostic/KeyValue")
class KeyValue(Message):
    """One figure of a status, as text."""

    key: str = ""
    """What the figure is."""
    value: str = ""
    """The figure, with its unit where it has one."""


@message("diagnostic/DiagnosticStatus")
class DiagnosticStatus(Message):
    """How well one component does."""

    OK: ClassVar[int] = 0
    WARN: ClassVar[int] = 1
    ERROR: ClassVar[int] = 2
    STALE: ClassVar[int] = 3

    level: Annotated[int, Meta(ge=0, le=3, extra={"ros": "byte"})] = 0
    """OK, WARN, ERROR or STALE."""
    name: str = ""
    """The component: a node's full name, or one of its checks, `/r1/base: battery`."""
    message: str = ""
    """How it does, in a sentence."""
    hardware_id: str = ""
    """The device, for example its serial number."""
    values: list[KeyValue] = []
    """Figures beside it."""


@message("diagnostic/DiagnosticArray")
class DiagnosticArray(Message):
    """How well several components do."""

    header: Header = field(default_factory=Header)
    """When all of it was so."""
    status: list[DiagnosticStatus] = []
    """One for each component."""
