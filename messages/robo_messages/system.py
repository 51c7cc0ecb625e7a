"""What robo itself says: time, log records, changes of parameters (ROS: rosgraph_msgs, rcl_interfaces)."""

from typing import Any, ClassVar

from msgspec import field

from robo_messages._registry import Message, message
from robo_messages._types import UInt8, UInt32
from robo_messages.std import Time


@message("system/Clock")
class Clock(Message):
    """The time that nodes with `use_sim_time` follow."""

    clock: Time = field(default_factory=Time)
    """The time of now."""


@message("system/Log")
class Log(Message):
    """One log record of a node."""

    DEBUG: ClassVar[int] = 10
    INFO: ClassVar[int] = 20
    WARN: ClassVar[int] = 30
    ERROR: ClassVar[int] = 40
    FATAL: ClassVar[int] = 50

    stamp: Time = field(default_factory=Time)
    """When it was said."""
    level: UInt8 = 0
    """DEBUG, INFO, WARN, ERROR or FATAL."""
    name: str = ""
    """The node's full name."""
    msg: str = ""
    """What was said."""
    file: str = ""
    """The source file that said it."""
    function: str = ""
    """The function that said it."""
    line: UInt32 = 0
    """The line in the file."""


@message("system/Parameter")
class Parameter(Message):
    """A parameter and its value, in its own type."""

    name: str = ""
    """With dots within a Struct: `gains.p`."""
    value: Any = None
    """In the unit that `robo param describe` tells."""


@message("system/ParameterEvent")
class ParameterEvent(Message):
    """What changed in a node's parameters."""

    stamp: Time = field(default_factory=Time)
    """When they changed."""
    node: str = ""
    """The node's full name."""
    new_parameters: list[Parameter] = []
    """Those that have been added: none, for a node of robo's has all of its own from its start."""
    changed_parameters: list[Parameter] = []
    """Those that have changed, with their new values."""
    deleted_parameters: list[Parameter] = []
    """Those that are gone: none."""
