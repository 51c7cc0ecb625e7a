"""What types are called in ROS."""

import re

import robo_messages
from robo.interfaces import catalogue
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
    "type_description": "type_description_interfaces",
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
_SERVICES_ELSEWHERE = {"std/Empty": "std_srvs"}
"""Services whose request and response robo has as one message, which ROS has in another package."""
_MADE = re.compile(
    r"(?P<action>\w+/\w+)_(?:(?:SendGoal|GetResult)(?:_Request|_Response|_Event)?|FeedbackMessage)|(?P<service>\w+/\w+)_Event"
)
_FOLDERS: dict[Kind, str] = {"message": "msg", "service": "srv", "action": "action"}


def ros_name(name: str) -> str:
    """A type's name within texts of ROS: `geometry/Twist` is `geometry_msgs/Twist`; a package's own keeps its name."""
    group, _, type_name = name.partition("/")
    package = _ELSEWHERE.get(whole_of(name)[0]) or _PACKAGES.get(group, group)
    return f"{package}/{type_name}"


def robo_name(name: str) -> str:
    """What robo calls a type of ROS: `geometry_msgs/Inertia` is `geometry/Inertia`, whether it ships or not."""
    package, _, type_name = name.partition("/")
    for ours, theirs in _ELSEWHERE.items():
        if (theirs, type_name) == (package, ours.partition("/")[2]):
            return ours
    groups = {theirs: group for group, theirs in _PACKAGES.items()}
    return f"{groups.get(package, package)}/{type_name}"


def full_name(name: str, kind: Kind | None = None) -> str:
    """A type's whole name in ROS: `geometry_msgs/msg/Twist`, `std_srvs/srv/Trigger_Request`.

    Args:
        name: in robo.
        kind: of which it is; by default what the name of a message says, which may be a part of a service.
    """
    made = made_of(name)
    if made is not None:
        return full_name(*made) + name.removeprefix(made[0])
    package, _, type_name = ros_name(name).partition("/")
    if kind == "service":
        package = _SERVICES_ELSEWHERE.get(name, package)
    return f"{package}/{_FOLDERS[kind or whole_of(name)[1]]}/{type_name}"


def made_of(name: str) -> tuple[str, Kind] | None:
    """The action or the service of which ROS makes a type: `example/Fibonacci` of `example/Fibonacci_FeedbackMessage`.

    None for any other type, for a message of a user's that is only called so, and where its parts are not known yet.
    """
    found = made_by_name(name)
    if found is None:
        return None
    whole, kind = found
    return found if f"{whole}_{catalogue.PARTS[kind][0]}" in robo_messages.type_names() else None


def made_by_name(name: str) -> tuple[str, Kind] | None:
    """The action or the service of which ROS would make a type of this name."""
    match = _MADE.fullmatch(name)
    if match is None:
        return None
    kind: Kind = "action" if match["action"] else "service"
    return match[kind], kind
