"""Who speaks on a topic: what comes twice or went round in a circle, what was lost, and who may command. Pure."""

from collections.abc import Callable

from robo.node.message_info import MessageInfo, SoleSource

MOST_SOURCES = 1_000
"""Senders of one topic that are remembered; a stranger that makes up ids fills no memory."""
COMMANDS = ("geometry/Twist", "geometry/TwistStamped")
"""Of these types one sender at a time is let through."""


class Numbers:
    """The numbers of the messages of each sender of a topic."""

    def __init__(self) -> None:
        self._last: dict[bytes | str, int] = {}

    def missed(self, source: "bytes | str", number: int, *, once: bool) -> int:
        """How many messages of a sender are missing before this one.

        Args:
            source: who.
            number: of the message.
            once: whether a message that is not newer than the last one is left out.

        Returns:
            How many; -1 for one that is to be left out.
        """
        last = self._last.get(source)
        if last is None:
            if len(self._last) >= MOST_SOURCES:
                del self._last[next(iter(self._last))]
            self._last[source] = number
            return 0
        if once and number <= last:
            return -1
        self._last[source] = number
        return max(0, number - last - 1)

    def knows(self, source: "bytes | str") -> bool:
        """Whether a sender has been heard."""
        return source in self._last


class Commander:
    """Lets one sender of commands at a time through: robo's base and mux see the bridge as one source."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        """`tell` gets a sentence for each sender that is refused."""
        self._sole = SoleSource()
        self._tell = tell

    def admits(self, sender: str, name: str, now: float) -> bool:
        """Whether a command counts.

        Args:
            sender: its id.
            name: of its node, in words.
            now: s, by a clock that never goes back.
        """
        info = MessageInfo(0.0, name or "a sender that ROS does not know", sender)
        return self._sole.admits(info, "", now, lambda who, _: self._tell(who))
