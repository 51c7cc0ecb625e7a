"""What is drawn of messages, whoever draws it. Lengths in m, colours red, green, blue from 0 to 255. Pure."""

from collections.abc import Sequence
from typing import NamedTuple

from robo_messages import OccupancyGrid
from robo_messages.sensor import Image

Place = tuple[float, float, float]
Colour = tuple[int, int, int]


class Moved(NamedTuple):
    """A frame stands somewhere in another one."""

    path: str
    parent: str
    child: str
    at: Place
    turned: tuple[float, float, float, float]
    """A quaternion: x, y, z, w."""
    always: bool = False
    """Whether it holds at all times."""


class Axes(NamedTuple):
    """A frame is to be seen."""

    path: str
    frame: str
    length: float


class Points(NamedTuple):
    """Points in a frame."""

    path: str
    frame: str
    places: Sequence[Place]
    colour: Colour
    radius: float


class Strips(NamedTuple):
    """Lines through points in a frame."""

    path: str
    frame: str
    strips: Sequence[Sequence[Place]]
    colour: Colour
    radius: float


class Numbers(NamedTuple):
    """Numbers, by name; each is a curve."""

    path: str
    values: dict[str, float]


class Said(NamedTuple):
    """A line of a log."""

    path: str
    text: str
    level: str
    """As Rerun calls it: `INFO`."""


class Picture(NamedTuple):
    """A picture of pixels."""

    path: str
    image: Image


class Encoded(NamedTuple):
    """A picture as a file."""

    path: str
    data: bytes
    kind: str
    """`image/jpeg`"""


class Grid(NamedTuple):
    """A map."""

    path: str
    frame: str
    grid: OccupancyGrid


class Gone(NamedTuple):
    """What was drawn there is no more."""

    path: str


Mark = Moved | Axes | Points | Strips | Numbers | Said | Picture | Encoded | Grid | Gone
