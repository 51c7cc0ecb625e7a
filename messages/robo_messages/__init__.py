"""robo's message types: ROS names and field shapes as msgspec Structs.

This package depends on msgspec alone, so a client that only wants to read a topic needs no more:

>>> from robo_messages import Twist, Vector3, decode, encode
>>> decode(encode(Twist(linear=Vector3(x=0.5))), Twist).linear.x
0.5
"""

from robo_messages._registry import (
    Message,
    UnknownType,
    decode,
    decode_json,
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

__all__ = [
    "BatteryState",
    "Bool",
    "Clock",
    "CompressedImage",
    "DiagnosticArray",
    "DiagnosticStatus",
    "Duration",
    "Empty",
    "Header",
    "Image",
    "Imu",
    "JointState",
    "Joy",
    "KeyValue",
    "LaserScan",
    "Log",
    "MapMetaData",
    "Message",
    "NavSatFix",
    "NavSatStatus",
    "OccupancyGrid",
    "Odometry",
    "Parameter",
    "ParameterEvent",
    "Path",
    "Point",
    "PointCloud2",
    "PointField",
    "Pose",
    "PoseStamped",
    "PoseWithCovariance",
    "Quaternion",
    "Range",
    "SetBool",
    "String",
    "Time",
    "Transform",
    "TransformStamped",
    "Trigger",
    "Twist",
    "TwistStamped",
    "TwistWithCovariance",
    "UnknownType",
    "Vector3",
    "decode",
    "decode_json",
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
