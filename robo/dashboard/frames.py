"""Where the parts of robots stand, for a page: the newest transform of each frame. Pure."""

from collections.abc import Container

import msgspec

import robo_messages
from robo.text.unreadable import UNREADABLE
from robo_messages import TFMessage

_MOST_FRAMES = 500
"""Of a robot: a stranger that makes some up fills no memory, and hides no other robot's."""
_LONGEST_NAME = 200
_MOST_PAYLOAD = 256_000
"""Of a message, bytes: 500 frames take a quarter of it."""


class Frame(msgspec.Struct, frozen=True):
    """A frame in its parent's."""

    parent: str
    at: tuple[float, float, float]
    """m."""
    turned: tuple[float, float, float, float]
    """A quaternion: x, y, z, w."""


def read(payload: bytes) -> dict[str, Frame]:
    """The frames of a message, by name; none where it is no message of transforms, or a very large one."""
    if len(payload) > _MOST_PAYLOAD:
        return {}
    try:
        message = robo_messages.decoder_of(TFMessage).decode(payload)
    except UNREADABLE:
        return {}
    found: dict[str, Frame] = {}
    for one in message.transforms:
        if max(len(one.child_frame_id), len(one.header.frame_id)) <= _LONGEST_NAME and len(found) < _MOST_FRAMES:
            at, turned = one.transform.translation, one.transform.rotation
            found[one.child_frame_id] = Frame(
                one.header.frame_id, (at.x, at.y, at.z), (turned.x, turned.y, turned.z, turned.w)
            )
    return found


class Frames:
    """The frames of each robot, as its topics tell them."""

    def __init__(self) -> None:
        self._of: dict[str, dict[str, Frame]] = {}

    def take(self, robot: str, found: dict[str, Frame]) -> None:
        """Take in what a message has said of a robot."""
        frames = self._of.setdefault(robot, {})
        for name, frame in found.items():
            if name in frames or len(frames) < _MOST_FRAMES:
                frames[name] = frame

    def of(self, robot: str) -> dict[str, Frame]:
        """Those of a robot, by name."""
        return self._of.get(robot, {})

    def keep(self, robots: Container[str]) -> None:
        """Forget the frames of all others: nobody looks at them."""
        self._of = {robot: frames for robot, frames in self._of.items() if robot in robots}
