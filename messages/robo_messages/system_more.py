"""How ROS says a value of any type (ROS: rcl_interfaces). Imported when its type is asked for."""

from robo_messages import _types as width
from robo_messages._registry import Message, message


@message("system/ParameterValue")
class ParameterValue(Message):
    """A value and which type it has: what `Parameter.value` is for a program that reads ROS's types alone.

    Nodes of robo's say `Parameter` and the value as it is; this stands in recordings and on the wires of other systems.
    """

    type: width.UInt8 = 0
    """Which field counts: 0 none, 1 bool, 2 integer, 3 double, 4 string, 5 bytes, 6 bools, 7 integers, 8 doubles,
    9 strings."""
    bool_value: bool = False
    """Of type 1."""
    integer_value: width.Int64 = 0
    """Of type 2."""
    double_value: float = 0.0
    """Of type 3: the number, in the parameter's own unit."""
    string_value: str = ""
    """Of type 4."""
    byte_array_value: width.Bytes = memoryview(b"")
    """Of type 5. A decoded one points into the payload: no copy is made."""
    bool_array_value: list[bool] = []
    """Of type 6."""
    integer_array_value: list[width.Int64] = []
    """Of type 7."""
    double_array_value: list[float] = []
    """Of type 8: the numbers, in the parameter's own unit."""
    string_array_value: list[str] = []
    """Of type 9."""
