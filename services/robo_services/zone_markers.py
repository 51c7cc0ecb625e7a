"""Footprint and zones as markers, for viewers."""

import math

from robo_messages import ColorRGBA, Header, Marker, MarkerArray, Point, Vector3
from robo_services.contact import Shape
from robo_services.safety import FOOTPRINT, Limits
from robo_services.zones import ZoneAction

_COLOURS: dict[ZoneAction, tuple[float, float, float]] = {
    "stop": (1.0, 0.1, 0.1),
    "slow_down": (1.0, 0.7, 0.0),
    "limit": (1.0, 1.0, 0.2),
    "approach": (0.3, 0.7, 1.0),
}
_WIDTH = 0.02
_CORNERS_OF_A_CIRCLE = 48


def markers_of(limits: Limits, frame: str) -> MarkerArray:
    """One outline for the footprint and for each zone as it is without speed; before them what deletes older ones."""
    markers = [Marker(Header(frame_id=frame), action=Marker.DELETEALL)]
    if limits.body is not None:
        markers.append(_outline(frame, FOOTPRINT, limits.body.footprint, (0.9, 0.9, 0.9)))
    markers += [_outline(frame, f"zones/{zone.name}", zone.shape, _COLOURS[zone.action]) for zone in limits.zones]
    return MarkerArray(markers)


def _outline(frame: str, name: str, shape: Shape, colour: tuple[float, float, float]) -> Marker:
    corners = _circle(shape) if len(shape.corners) == 1 else list(shape.corners)
    return Marker(
        Header(frame_id=frame),
        ns=name,
        type=Marker.LINE_STRIP,
        scale=Vector3(x=_WIDTH),
        color=ColorRGBA(*colour, 1.0),
        frame_locked=True,
        points=[Point(x, y) for x, y in [*corners, corners[0]]],
    )


def _circle(shape: Shape) -> list[tuple[float, float]]:
    (x, y), n = shape.corners[0], _CORNERS_OF_A_CIRCLE
    angles = [math.tau * i / n for i in range(n)]
    return [(x + shape.radius * math.cos(a), y + shape.radius * math.sin(a)) for a in angles]
