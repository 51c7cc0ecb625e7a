"""What types are called in ROS."""

from robo.interfaces.catalogue import Kind, whole_of

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
    "rosbag2": "rosbag2_interfaces",
    "tf2": "tf2_msgs",
    "visualization": "visualization_msgs",
    "system": "rcl_interfaces",
}
_ELSEWHERE = {
    "action/UUID": "unique_identifier_msgs",
    "std/Time": "builtin_interfaces",
    "std/Duration": "builtin_interfaces",
    "std/Trigger": "std_srvs",
    "std/SetBool": "std_srvs",
    "system/Clock": "rosgraph_msgs",
}
_FOLDERS: dict[Kind, str] = {"message": "msg", "service": "srv", "action": "action"}


def ros_name(name: str) -> str:
    """A type's name within texts of ROS: `geometry/Twist` is `geometry_msgs/Twist`; a package's own keeps its name."""
    group, _, type_name = name.partition("/")
    package = _ELSEWHERE.get(whole_of(name)[0]) or _PACKAGES.get(group, group)
    return f"{package}/{type_name}"


def full_name(name: str, kind: Kind | None = None) -> str:
    """A type's whole name in ROS: `geometry_msgs/msg/Twist`, `std_srvs/srv/Trigger_Request`.

    Args:
        name: in robo.
        kind: of which it is; by default what the name of a message says, which may be a part of a service.
    """
    package, _, type_name = ros_name(name).partition("/")
    return f"{package}/{_FOLDERS[kind or whole_of(name)[1]]}/{type_name}"
