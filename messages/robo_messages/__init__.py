"""robo's message types: ROS names and field shapes as msgspec Structs.

This package depends on msgspec alone, so a client that only wants to read a topic needs no more:

>>> from robo_messages import Twist, Vector3, decode, encode
>>> decode(encode(Twist(linear=Vector3(x=0.5))), Twist).linear.x
0.5

The types that most nodes do without are imported when they are asked for, here or by name.
"""

import importlib
from typing import TYPE_CHECKING

from robo_messages import _registry
from robo_messages._registry import (
    Message,
    UnknownType,
    decode,
    decode_json,
    decoder_of,
    encode,
    encode_json,
    find_type,
    json_schema,
    message,
    type_name,
    type_names,
)
from robo_messages.diagnostic import DiagnosticArray, DiagnosticStatus, KeyValue
from robo_messages.geometry import (
    Point,
    Pose,
    PoseStamped,
    PoseWithCovariance,
    Quaternion,
    Transform,
    TransformStamped,
    Twist,
    TwistStamped,
    TwistWithCovariance,
    Vector3,
)
from robo_messages.nav import MapMetaData, OccupancyGrid, Odometry, Path
from robo_messages.sensor import (
    BatteryState,
    CompressedImage,
    Image,
    Imu,
    JointState,
    Joy,
    LaserScan,
    NavSatFix,
    NavSatStatus,
    PointCloud2,
    PointField,
    Range,
)
from robo_messages.services import Empty, SetBool, Trigger, halves_of, service_type_name
from robo_messages.std import Bool, Duration, Header, String, Time
from robo_messages.system import Clock, Log, Parameter, ParameterEvent

if TYPE_CHECKING:
    from robo_messages.action import (
        UUID,
        CancelGoal,
        GoalInfo,
        GoalStatus,
        GoalStatusArray,
    )
    from robo_messages.example import Fibonacci
    from robo_messages.flight import Snapshot, TakeSnapshot
    from robo_messages.geometry_more import (
        Accel,
        AccelStamped,
        Point32,
        PointStamped,
        Polygon,
        PolygonStamped,
        PoseArray,
        PoseWithCovarianceStamped,
        QuaternionStamped,
        TwistWithCovarianceStamped,
        Vector3Stamped,
        Wrench,
        WrenchStamped,
    )
    from robo_messages.lifecycle import (
        ChangeState,
        GetAvailableStates,
        GetAvailableTransitions,
        GetState,
        State,
        Transition,
        TransitionDescription,
        TransitionEvent,
    )
    from robo_messages.nav2 import FollowWaypoints, WaypointStatus
    from robo_messages.playing import GetPlayback
    from robo_messages.rosbag2 import GetRate, IsPaused, Seek, SetRate
    from robo_messages.sensor_more import CameraInfo, RegionOfInterest, TimeReference
    from robo_messages.std_arrays import (
        ByteMultiArray,
        Float32MultiArray,
        Float64MultiArray,
        Int8MultiArray,
        Int16MultiArray,
        Int32MultiArray,
        Int64MultiArray,
        MultiArrayDimension,
        MultiArrayLayout,
        UInt8MultiArray,
        UInt16MultiArray,
        UInt32MultiArray,
        UInt64MultiArray,
    )
    from robo_messages.std_numbers import (
        Byte,
        Char,
        ColorRGBA,
        Float32,
        Float64,
        Int8,
        Int16,
        Int32,
        Int64,
        UInt8,
        UInt16,
        UInt32,
        UInt64,
    )
    from robo_messages.system_more import ParameterValue
    from robo_messages.tf2 import TFMessage
    from robo_messages.visualization import (
        Marker,
        MarkerArray,
        MeshFile,
        UVCoordinate,
    )

_LATER = {
    "robo_messages.action": "UUID GoalInfo GoalStatus GoalStatusArray",
    "robo_messages.flight": "Snapshot",
    "robo_messages.geometry_more": (
        "Accel AccelStamped Point32 PointStamped Polygon PolygonStamped PoseArray PoseWithCovarianceStamped "
        "QuaternionStamped TwistWithCovarianceStamped Vector3Stamped Wrench WrenchStamped"
    ),
    "robo_messages.lifecycle": "State Transition TransitionDescription TransitionEvent",
    "robo_messages.nav2": "WaypointStatus",
    "robo_messages.sensor_more": "CameraInfo RegionOfInterest TimeReference",
    "robo_messages.std_arrays": (
        "ByteMultiArray Float32MultiArray Float64MultiArray Int8MultiArray Int16MultiArray Int32MultiArray "
        "Int64MultiArray MultiArrayDimension MultiArrayLayout UInt8MultiArray UInt16MultiArray UInt32MultiArray "
        "UInt64MultiArray"
    ),
    "robo_messages.std_numbers": (
        "Byte Char ColorRGBA Float32 Float64 Int8 Int16 Int32 Int64 UInt8 UInt16 UInt32 UInt64"
    ),
    "robo_messages.system_more": "ParameterValue",
    "robo_messages.tf2": "TFMessage",
    "robo_messages.visualization": "Marker MarkerArray MeshFile UVCoordinate",
}
"""Modules that are imported when one of their types is asked for: most nodes save the time and the memory."""

_PARTS_LATER = {
    ("_Request", "_Response"): {
        "robo_messages.action": "CancelGoal",
        "robo_messages.flight": "TakeSnapshot",
        "robo_messages.lifecycle": "ChangeState GetAvailableStates GetAvailableTransitions GetState",
        "robo_messages.playing": "GetPlayback",
        "robo_messages.rosbag2": "GetRate IsPaused Seek SetRate",
    },
    ("_Goal", "_Result", "_Feedback"): {
        "robo_messages.example": "Fibonacci",
        "robo_messages.nav2": "FollowWaypoints",
    },
}
"""The same of services and actions, whose parts are the types."""

__all__ = [
    "UUID",
    "Accel",
    "AccelStamped",
    "BatteryState",
    "Bool",
    "Byte",
    "ByteMultiArray",
    "CameraInfo",
    "CancelGoal",
    "ChangeState",
    "Char",
    "Clock",
    "ColorRGBA",
    "CompressedImage",
    "DiagnosticArray",
    "DiagnosticStatus",
    "Duration",
    "Empty",
    "Fibonacci",
    "Float32",
    "Float32MultiArray",
    "Float64",
    "Float64MultiArray",
    "FollowWaypoints",
    "GetAvailableStates",
    "GetAvailableTransitions",
    "GetPlayback",
    "GetRate",
    "GetState",
    "GoalInfo",
    "GoalStatus",
    "GoalStatusArray",
    "Header",
    "Image",
    "Imu",
    "Int8",
    "Int8MultiArray",
    "Int16",
    "Int16MultiArray",
    "Int32",
    "Int32MultiArray",
    "Int64",
    "Int64MultiArray",
    "IsPaused",
    "JointState",
    "Joy",
    "KeyValue",
    "LaserScan",
    "Log",
    "MapMetaData",
    "Marker",
    "MarkerArray",
    "MeshFile",
    "Message",
    "MultiArrayDimension",
    "MultiArrayLayout",
    "NavSatFix",
    "NavSatStatus",
    "OccupancyGrid",
    "Odometry",
    "Parameter",
    "ParameterEvent",
    "ParameterValue",
    "Path",
    "Point",
    "Point32",
    "PointCloud2",
    "PointField",
    "PointStamped",
    "Polygon",
    "PolygonStamped",
    "Pose",
    "PoseArray",
    "PoseStamped",
    "PoseWithCovariance",
    "PoseWithCovarianceStamped",
    "Quaternion",
    "QuaternionStamped",
    "Range",
    "RegionOfInterest",
    "Seek",
    "SetBool",
    "SetRate",
    "Snapshot",
    "State",
    "String",
    "TFMessage",
    "TakeSnapshot",
    "Time",
    "TimeReference",
    "Transform",
    "TransformStamped",
    "Transition",
    "TransitionDescription",
    "TransitionEvent",
    "Trigger",
    "Twist",
    "TwistStamped",
    "TwistWithCovariance",
    "TwistWithCovarianceStamped",
    "UInt8",
    "UInt8MultiArray",
    "UInt16",
    "UInt16MultiArray",
    "UInt32",
    "UInt32MultiArray",
    "UInt64",
    "UInt64MultiArray",
    "UVCoordinate",
    "UnknownType",
    "Vector3",
    "Vector3Stamped",
    "WaypointStatus",
    "Wrench",
    "WrenchStamped",
    "decode",
    "decode_json",
    "decoder_of",
    "encode",
    "encode_json",
    "find_type",
    "halves_of",
    "json_schema",
    "message",
    "service_type_name",
    "type_name",
    "type_names",
]

_module_of = {name: module for module, names in _LATER.items() for name in names.split()}
_parts_of: dict[str, tuple[str, ...]] = {}
for _parts, _later in _PARTS_LATER.items():
    for _module, _names in _later.items():
        _module_of |= dict.fromkeys(_names.split(), _module)
        _parts_of |= dict.fromkeys(_names.split(), _parts)
_registry.import_later(
    {
        f"{module.rpartition('.')[2].partition('_')[0]}/{name}{part}": module
        for name, module in _module_of.items()
        for part in _parts_of.get(name, ("",))
    }
)

if not TYPE_CHECKING:  # a type checker is to find just the names above

    def __getattr__(name: str) -> type:
        module = _module_of.get(name)
        if module is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = found = getattr(importlib.import_module(module), name)
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *_module_of})
