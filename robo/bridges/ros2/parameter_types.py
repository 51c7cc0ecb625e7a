"""The services by which ROS's tools see and set parameters of a node (ROS: rcl_interfaces)."""

from typing import Any

from msgspec import field

from robo_messages import Message, message
from robo_messages._types import Int64, UInt8, UInt64
from robo_messages.system import Parameter


@message("system/FloatingPointRange")
class FloatingPointRange(Message):
    """Which numbers a parameter may be."""

    from_value: float = 0.0
    """The least, in the parameter's own unit."""
    to_value: float = 0.0
    """The largest."""
    step: float = 0.0
    """From one to the next; 0 for any."""


@message("system/IntegerRange")
class IntegerRange(Message):
    """Which whole numbers a parameter may be."""

    from_value: Int64 = 0
    """The least, in the parameter's own unit."""
    to_value: Int64 = 0
    """The largest."""
    step: UInt64 = 0
    """From one to the next; 0 for any."""


@message("system/ParameterDescriptor")
class ParameterDescriptor(Message):
    """What is known of a parameter."""

    name: str = ""
    """Its name."""
    type: UInt8 = 0
    """As in `ParameterValue`."""
    description: str = ""
    """What it means."""
    additional_constraints: str = ""
    """What else it may be, in words."""
    read_only: bool = False
    """Whether it cannot be set while its node runs."""
    dynamic_typing: bool = False
    """Whether it may be of another type."""
    floating_point_range: FloatingPointRange | None = None
    """Where it is a number with limits."""
    integer_range: IntegerRange | None = None
    """Where it is a whole number with limits."""


@message("system/SetParametersResult")
class SetParametersResult(Message):
    """Whether a parameter was set."""

    successful: bool = False
    """Whether it was."""
    reason: str = ""
    """Why not."""


@message("system/ListParametersResult")
class ListParametersResult(Message):
    """Which parameters there are."""

    names: list[str] = field(default_factory=list)
    """Of parameters."""
    prefixes: list[str] = field(default_factory=list)
    """What stands before their last dots."""


class Names:
    """Requests that name parameters."""

    @message("system/GetParameters_Request")
    class Get(Message):
        """Values."""

        names: list[str] = field(default_factory=list)
        """Of parameters."""

    @message("system/GetParameterTypes_Request")
    class Types(Message):
        """Types."""

        names: list[str] = field(default_factory=list)
        """Of parameters."""

    @message("system/DescribeParameters_Request")
    class Describe(Message):
        """All that is known."""

        names: list[str] = field(default_factory=list)
        """Of parameters."""

    @message("system/ListParameters_Request")
    class List(Message):
        """Names."""

        prefixes: list[str] = field(default_factory=list)
        """Those below these alone; all where there is none."""
        depth: UInt64 = 0
        """How many dots at most; 0 for any number."""


class Changes:
    """Requests that set parameters."""

    @message("system/SetParameters_Request")
    class Each(Message):
        """Each by itself."""

        parameters: list[Parameter] = field(default_factory=list)
        """Which, and to what."""

    @message("system/SetParametersAtomically_Request")
    class All(Message):
        """All or none."""

        parameters: list[Parameter] = field(default_factory=list)
        """Which, and to what."""


class Answers:
    """Answers."""

    @message("system/GetParameters_Response")
    class Get(Message):
        """Values."""

        values: list[Any] = field(default_factory=list)
        """In the order of the names, each in the parameter's own unit; nothing for one that is not there."""

    @message("system/GetParameterTypes_Response")
    class Types(Message):
        """Types."""

        types: list[UInt8] = field(default_factory=list)
        """As in `ParameterValue`."""

    @message("system/DescribeParameters_Response")
    class Describe(Message):
        """All that is known."""

        descriptors: list[ParameterDescriptor] = field(default_factory=list)
        """In the order of the names."""

    @message("system/ListParameters_Response")
    class List(Message):
        """Names."""

        result: ListParametersResult = field(default_factory=ListParametersResult)
        """Which there are."""

    @message("system/SetParameters_Response")
    class Each(Message):
        """What became of each."""

        results: list[SetParametersResult] = field(default_factory=list)
        """In the order of the request."""

    @message("system/SetParametersAtomically_Response")
    class All(Message):
        """What became of all."""

        result: SetParametersResult = field(default_factory=SetParametersResult)
        """Whether all were set."""
