"""What a recording says of the robot beside its messages: whose it is, and the parameters of its nodes."""

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


def robot_of(recording: "Bag") -> str | None:
    """The namespace of the robot that was recorded, where the recording says so and it was one."""
    try:
        every = recording.metadata
    except BagError:
        return None  # its messages can be read all the same
    robots = every.get(ABOUT, {}).get(ROBOTS, "").split()
    first = min(robots, key=len, default="")
    return first if first and all(f"{one}/".startswith(f"{first}/") for one in robots) else None


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
