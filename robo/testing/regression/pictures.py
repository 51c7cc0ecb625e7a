"""A field that differs, as a picture."""

import re
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from robo.bag.look.fields import number
from robo.bag.read.reader import Bag
from robo.bag.regression.report import Spot
from robo.errors import UsageError
from robo.interfaces.parts import Field, Missing
from robo.text.svg import Point, plot

_MOST = 2_000
"""Points of a line."""


def draw(folder: Path, topic: str, spot: Spot, then: Bag, now: Bag) -> Path | None:
    """Draw the field of a spot, as recorded and as it is now. Returns the file; None where there are no points.

    Raises:
        UsageError: it cannot be written.
    """
    begin = then.begin
    lines = thinned(*(_points(recording, topic, spot.field, begin) for recording in (then, now)))
    if not all(lines):
        return None
    text = plot(f"{topic} {spot.field}", ("recorded", "now"), lines[0], lines[1], (spot.time - begin) * 1e-9)
    name = f"{topic.replace('/', '-')}.{spot.field}"  # no name has a hyphen: of two topics both have one of their own
    path = folder / f"{re.sub(r'[^A-Za-z0-9_.-]+', '_', name)[:150]}.svg"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror}") from None
    return path


def _points(recording: Bag, topic: str, field: str, begin: int) -> Iterable[Point]:
    if not field:  # they differ as a whole
        return
    wanted = Field(re.sub(r"\.(\d+)", r"[\1]", field))
    for message in recording.messages(topic):
        with suppress(Missing):
            value = number(wanted.of(message.value))
            if value is not None:
                yield (message.published - begin) * 1e-9, value


def thinned(*lines: Iterable[Point]) -> list[list[Point]]:
    """So many points of each line that a picture shows them: of all lines every n-th, so that they have the same."""
    kept = [_thinned(line) for line in lines]
    widest = max(step for _, step in kept)
    return [points[:: widest // step] for points, step in kept]


def _thinned(points: Iterable[Point]) -> tuple[list[Point], int]:
    """Every n-th point, and n: a power of two."""
    kept: list[Point] = []
    step = 1
    for index, point in enumerate(points):
        if index % step == 0:
            kept.append(point)
            if len(kept) > _MOST:
                kept, step = kept[::2], step * 2
    return kept, step
