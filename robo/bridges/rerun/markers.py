"""Markers to what is drawn of them: lines, points, and the middle of a box or ball; what is deleted is gone. Pure."""

import math
from collections.abc import Callable, Iterator, Sequence

from robo.bridges.rerun.marks import Colour, Gone, Mark, Place, Points, Strips
from robo_messages.visualization import Marker, MarkerArray

_MOST = 2_000
"""Of a topic."""
_BALLS = (Marker.SPHERE, Marker.CUBE, Marker.CYLINDER)
_HEAPS = (Marker.POINTS, Marker.SPHERE_LIST, Marker.CUBE_LIST)


class Markers:
    """Knows which there are."""

    def __init__(self) -> None:
        self._there: dict[str, set[str]] = {}
        """The paths of each topic's."""

    def take(self, key: str, message: MarkerArray, named: Callable[[str, str], str]) -> Iterator[Mark]:
        """What is drawn of markers.

        Args:
            key: their topic.
            message: they.
            named: takes the topic and a frame that it names, and returns the frame among those of all robots.
        """
        there = self._there.setdefault(key, set())
        drawn: dict[str, Mark] = {}
        gone: set[str] = set()
        for marker in message.markers:
            if marker.action in (Marker.DELETE, Marker.DELETEALL):
                ended = {path for path in {*there, *drawn} if _ends(key, marker, path)}
                gone |= ended
                for path in ended:
                    drawn.pop(path, None)
                continue
            path = _path(key, marker)
            mark = _mark(path, named(key, marker.header.frame_id), marker)
            if mark is not None and (path in there or len(there) + len(drawn) < _MOST):
                drawn[path] = mark
        # What is deleted and there again was never gone for whoever looks.
        removed = (gone & there) - drawn.keys()
        there -= removed
        there.update(drawn)
        yield from (Gone(path) for path in sorted(removed))
        yield from drawn.values()


def _path(key: str, marker: Marker) -> str:
    return f"{key}/{marker.ns or 'marker'}/{marker.id}"


def _ends(key: str, marker: Marker, path: str) -> bool:
    """Whether a marker says of another one that it is no more."""
    if marker.action == Marker.DELETE:
        return path == _path(key, marker)
    return not marker.ns or path.rpartition("/")[0] == f"{key}/{marker.ns}"


def _mark(path: str, frame: str, marker: Marker) -> Mark | None:
    colour, radius = _colour(marker), marker.scale.x / 2
    places = [_moved_by(marker, (p.x, p.y, p.z)) for p in marker.points]
    if marker.type == Marker.LINE_STRIP:
        return Strips(path, frame, [places], colour, max(radius, 0.005))
    if marker.type == Marker.LINE_LIST:
        pairs = [places[at : at + 2] for at in range(0, len(places) - 1, 2)]
        return Strips(path, frame, pairs, colour, max(radius, 0.005))
    if marker.type in _HEAPS:
        return Points(path, frame, places, colour, max(radius, 0.01))
    if marker.type in _BALLS:
        return Points(path, frame, [_moved_by(marker, (0.0, 0.0, 0.0))], colour, max(radius, 0.01))
    return None


def _colour(marker: Marker) -> Colour:
    red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in _parts(marker))
    return red, green, blue


def _parts(marker: Marker) -> Sequence[float]:
    found = marker.color.r, marker.color.g, marker.color.b
    return found if all(map(math.isfinite, found)) else (1.0, 1.0, 1.0)


def _moved_by(marker: Marker, place: Place) -> Place:
    """A point of a marker in the frame of its header."""
    q, at = marker.pose.orientation, marker.pose.position
    x, y, z = place
    # v + 2 q × (q × v + w v), for a unit quaternion; zeros, which some send, turn nothing
    cx, cy, cz = q.y * z - q.z * y + q.w * x, q.z * x - q.x * z + q.w * y, q.x * y - q.y * x + q.w * z
    return (
        at.x + x + 2 * (q.y * cz - q.z * cy),
        at.y + y + 2 * (q.z * cx - q.x * cz),
        at.z + z + 2 * (q.x * cy - q.y * cx),
    )
