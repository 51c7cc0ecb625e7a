"""What a buffer has seen that is not right, for whoever wants to tell it."""

from typing import Literal

import msgspec

Kind = Literal["two_sources", "two_parents", "now_static", "now_moving", "set_back", "left_out", "refused"]

MOST = 200
"""So many warnings are kept; then the oldest goes."""


class TransformWarning(msgspec.Struct, frozen=True):
    """Something that is wrong with the transforms that came, or may be."""

    kind: Kind
    """`two_sources`: two publish one frame in turn. `two_parents`: a frame has two parents in turn. `now_static`,
    `now_moving`: a frame was the other before. `set_back`: a frame's stamps went back by more than the buffer's
    duration, and its history was cleared. `left_out`: a stamp was older than that. `refused`: it was no transform."""
    child: str
    """The frame that it is about."""
    text: str
    """What has happened, the last time."""
    count: int
    """How often it has."""
    stamp: int
    """The stamp of the last transform that it is about, ns."""


class Notes:
    """Warnings, one of each kind for each frame. Its caller holds the buffer's lock."""

    def __init__(self) -> None:
        self._kept: dict[tuple[Kind, str], TransformWarning] = {}
        self.count = 0
        """How many there ever were."""

    def add(self, kind: Kind, child: str, text: str, stamp: int) -> None:
        """Note something."""
        before = self._kept.pop((kind, child), None)
        if before is None and len(self._kept) >= MOST:
            del self._kept[next(iter(self._kept))]
        count = before.count + 1 if before is not None else 1
        self._kept[kind, child] = TransformWarning(kind, child, text, count, stamp)
        self.count += 1

    def all(self) -> tuple[TransformWarning, ...]:
        """All that are kept, the last one at the end."""
        return tuple(self._kept.values())
