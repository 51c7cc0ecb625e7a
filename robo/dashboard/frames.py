"""Where the parts of robots stand, for a page: the newest transform of each frame. Pure."""

import msgspec

import robo_messages
from robo.text.unreadable import UNREADABLE
from robo_messages import TFMessage

_MOST_FRAMES = 2_000
"""Of all robots: a stranger that makes some up fills no memory."""


class Frame(msgspec.Struct, frozen=True):
    """A frame in its parent's."""

    parent: str
    at: tuple[float, float, float]
    """m."""
    turned: tuple[float, float, float, float]
    """A quaternion: x, y, z, w."""


class Frames:
    """The frames of each robot, as its topics tell them."""

    def __init__(self) -> None:
        self._of: dict[str, dict[str, Frame]] = {}
        self._count = 0

    def take(self, robot: str, payload: bytes) -> bool:
        """Take in a message; whether it is one of transforms."""
        try:
            message = robo_messages.decoder_of(TFMessage).decode(payload)
        except UNREADABLE:
            return False
        frames = self._of.setdefault(robot, {})
        for one in message.transforms:
            if one.child_frame_id not in frames:
                if self._count >= _MOST_FRAMES:
                    continue
                self._count += 1
            at, turned = one.transform.translation, one.transform.rotation
            frames[one.child_frame_id] = Frame(
                one.header.frame_id, (at.x, at.y, at.z), (turned.x, turned.y, turned.z, turned.w)
            )
        return True

    def of(self, robot: str) -> dict[str, Frame]:
        """Those of a robot, by name."""
        return self._of.get(robot, {})
