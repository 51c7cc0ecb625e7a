"""What a recording says of the robot beside its messages: whose it is, and the parameters of its nodes."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

from robo.errors import BagError

if TYPE_CHECKING:
    from robo.bag.read.reader import Bag

ABOUT: Final = "robo.about"
"""The metadata that say who recorded what, with which versions."""
ROBOTS: Final = "robots"
"""Their word for the namespaces of the nodes that ran."""
PARAMETERS: Final = "parameters.yaml"
"""The attachment that has the parameters of all nodes, as a file that `robo up` and ROS 2 read."""


_OF_ROBOTS: Final = frozenset({"odom", "cmd_vel", "tf", "tf_static", "log"})
"""Topics that a robot has in its namespace; `camera/image` tells none."""
_OF_NO_NAMESPACE: Final = frozenset({"odom", "cmd_vel"})
"""Topics of a robot that has none; `/tf` is there for all robots of ROS."""


def robots_of(recording: "Bag") -> list[str] | None:
    """The namespaces of the robots that were recorded, as the recording says; None where it is none of robo's."""
    try:
        every = recording.metadata
    except BagError:
        return None  # its messages can be read all the same
    if ABOUT not in every:
        return None
    said = sorted(every[ABOUT].get(ROBOTS, "").split())
    return [one for one in said if not any(one.startswith(f"{other}/") for other in said)]


def robot_of(recording: "Bag") -> str | None:
    """The namespace of the robot that was recorded, where the recording says so and it was one."""
    robots = robots_of(recording) or []
    return robots[0] if len(robots) == 1 else None


def robots_among(names: Iterable[str], said: Sequence[str] | None) -> list[str]:
    """The robots in whose namespaces topics are; none where the robot has no namespace, as is usual in ROS.

    Args:
        names: of topics, without leading slashes.
        said: the robots that the recording says; None where it is none of robo's. Of one that says none of these
            topics', and of one of ROS's, the names tell.
    """
    names = [name for name in names if name != "clock"]  # which is one for all robots
    there = [robot for robot in said or () if any(name.startswith(f"{robot}/") for name in names)]
    if there or not names:
        return there
    first = {name.partition("/")[0] if "/" in name else "" for name in names}
    if said is not None and len(first) == 1:
        return sorted(first - {""})
    if _OF_NO_NAMESPACE & set(names):
        return []
    return sorted({name.partition("/")[0] for name in names if name.partition("/")[2] in _OF_ROBOTS})


def only_robot(recording: "Bag") -> str:
    """The namespace that names of the recording's topics may leave out; empty where there is none, or more than one."""
    robots = robots_among(recording.topics, robots_of(recording))
    return robots[0] if len(robots) == 1 else ""


def parameters_of(recording: "Bag") -> dict[str, dict[str, object]]:
    """The parameters of its nodes, by full name without the leading slash; none where it has no such attachment.

    Raises:
        BagError: the attachment cannot be read, or has mistakes.
    """
    from robo.parameters import files  # whoever records does without YAML
    from robo.text.tree import Problem

    if PARAMETERS not in recording.attachments:
        return {}
    problems: list[Problem] = []
    text = recording.attachment(PARAMETERS).decode("utf-8", "replace")
    found = files.read(text, PARAMETERS, problems)
    if problems:
        raise BagError("its attachment cannot be read:\n" + "\n".join(map(str, problems)), recording.path)
    return {entry.pattern.strip("/"): entry.values for entry in found.entries if entry.names_one_node}
