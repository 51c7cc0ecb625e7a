"""How many messages of each topic are drawn: as many as somebody sees, fewer while the viewer is too slow. Pure."""

from collections.abc import Hashable

from robo_messages import LaserScan, Log, Message, OccupancyGrid, Odometry, Path, TFMessage
from robo_messages.sensor import CompressedImage, Image
from robo_messages.visualization import Marker, MarkerArray

_RATES: dict[type, float] = {
    TFMessage: 25.0, Odometry: 25.0, LaserScan: 10.0, Image: 5.0, CompressedImage: 10.0, Path: 2.0, OccupancyGrid: 1.0,
}  # fmt: skip
"""Hz."""
_OTHERS = 10.0
_LATE, _IN_TIME = 0.3, 0.1
"""From when on fewer are drawn, and more again, s."""
_MOST_SLOWER = 32.0
_MOST_KNOWN = 10_000


class Pace:
    """Says which messages are drawn."""

    def __init__(self, rate: float | None = None) -> None:
        """
        Args:
            rate: at most so many of each topic a second; 0 for all; None for what suits their types.
        """
        self._rate = rate
        self._last: dict[Hashable, int] = {}
        self.slower = 1.0
        """How many times fewer there are for now."""

    def draws(self, key: str, message: Message, time: int, late: float = 0.0) -> bool:
        """Whether a message is drawn.

        Args:
            key: its topic.
            message: it.
            time: of it, ns.
            late: for how long it has waited, s.
        """
        if late > _LATE:
            self.slower = min(self.slower * 1.1, _MOST_SLOWER)
        elif late < _IN_TIME:
            self.slower = max(self.slower * 0.98, 1.0)
        rate = self._rate if self._rate is not None else _RATES.get(type(message), _OTHERS)
        if not rate or isinstance(message, Log) or key.endswith("tf_static") or _deletes(message):
            return True
        which = self._which(key, message)
        last = self._last.get(which)
        if last is not None and 0 <= time - last < 0.95e9 / rate * self.slower:
            return False
        if len(self._last) >= _MOST_KNOWN:
            self._last.clear()
        self._last[which] = time
        return True

    def _which(self, key: str, message: Message) -> Hashable:
        """What takes the place of what: transforms of other frames do not."""
        if isinstance(message, TFMessage):
            return (key, *(one.child_frame_id for one in message.transforms[:20]))
        return key


def _deletes(message: Message) -> bool:
    """Whether it is said once that something is no more."""
    return isinstance(message, MarkerArray) and any(one.action != Marker.ADD for one in message.markers)
