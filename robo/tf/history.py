"""What is known of one link of the tree of frames: where a child frame stood in its parent, and when.

A sample is 8 bytes of time and 56 of numbers, packed: a thousand frames at 100 Hz are a million samples within ten
seconds, which as messages would take six times as much, and lists of them keep the garbage collector busy.

**Threads.** One thread at a time changes links and histories: it holds the buffer's lock. Others read a history without
it. They may, because a history is only ever added to at its end, its numbers before its times, so that whoever finds a
time finds its numbers; everything else makes a new history, and the link is then given that one. Each single step of
this (`+=` of bytes, `append`, setting an attribute) is one operation of the interpreter.
"""

import struct
from array import array
from bisect import bisect_left, bisect_right
from typing import NamedTuple

from robo.tf.screw import Bracket, Seven, between, held

_SAMPLE = struct.Struct("7d")
_PAIR = struct.Struct("14d")
SIZE = _SAMPLE.size
pack = _SAMPLE.pack
"""Seven floats as a sample."""

MOST_NS = 1 << 62
"""Times are within this and its negative, ns: 146 years around 1970."""
_NEVER = -1
_RECENT = 16
"""Among so many samples at the end of a history a time is looked for first: most ask for what was just now."""


class History:
    """Samples in the order of their times, each time once; of one parent frame, or of several."""

    __slots__ = ("bracket", "parents", "samples", "stamps")

    def __init__(self, stamps: "array[int]", samples: bytearray, parents: list[str] | None = None) -> None:
        self.stamps = stamps
        """ns."""
        self.samples = samples
        """Of each `SIZE` bytes."""
        self.parents = parents
        """The parent of each sample; None where all have that of the link."""
        self.bracket: Bracket | None = None
        """What was followed last, which holds between its two ends: the next lookup often wants the same."""

    @classmethod
    def empty(cls) -> "History":
        """One without samples."""
        return cls(array("q"), bytearray())

    @classmethod
    def fixed(cls, values: Seven) -> "History":
        """One that is the same at all times: its bracket is never left."""
        history = cls.empty()
        history.bracket = held(-2 * MOST_NS, 2 * MOST_NS, values)
        return history

    def bracket_at(self, ns: int) -> Bracket | None:
        """What to follow at a time: the motion between two samples, or one of them; None before the first or after all.

        Between two samples of different parents the first one holds until the second, as in tf2 (TimeCache::getData).
        """
        stamps, parents = self.stamps, self.parents
        count = len(stamps)
        low = count - _RECENT if count > _RECENT and stamps[-_RECENT] <= ns else 0
        i = bisect_right(stamps, ns, low) - 1
        if i < 0:
            return None
        begin = stamps[i]
        if begin != ns and i + 1 >= count:
            return None
        if begin == ns or (parents is not None and parents[i] != parents[i + 1]):
            bracket = held(ns - 1, ns + 1, self.values(i))  # what is between its ends is this ns alone
        else:
            bracket = between(begin, stamps[i + 1], _PAIR.unpack_from(self.samples, SIZE * i))
        self.bracket = bracket
        return bracket

    def values(self, index: int) -> Seven:
        """The numbers of a sample."""
        x, y, z, qx, qy, qz, qw = _SAMPLE.unpack_from(self.samples, SIZE * index)
        return x, y, z, qx, qy, qz, qw

    def parent_at(self, ns: int, usual: str) -> str:
        """The parent frame at a time, by the samples until then; `usual` where there is but one."""
        parents = self.parents
        if parents is None:
            return usual
        return parents[max(bisect_right(self.stamps, ns) - 1, 0)]

    def since(self, ns: int) -> "History":
        """A copy that begins with the first sample of a time or later."""
        i = bisect_left(self.stamps, ns)
        return History(self.stamps[i:], self.samples[SIZE * i :], _if_several(self.parents and self.parents[i:]))

    def merged(self, ns: int, sample: bytes, parent: str, usual: str) -> "History":
        """This history with one sample more; a copy, unless it comes last. Of the same time the new one counts.

        Args:
            ns: its time.
            sample: its numbers, packed.
            parent: its parent frame.
            usual: that of the others, where it is one.
        """
        if self.stamps and ns > self.stamps[-1] and (self.parents is not None or parent == usual):
            self.samples += sample
            if self.parents is not None:
                self.parents.append(parent)
            self.stamps.append(ns)
            return self
        i = bisect_left(self.stamps, ns)
        j = bisect_right(self.stamps, ns)
        stamps, samples = self.stamps[:i], self.samples[: SIZE * i]
        stamps.append(ns)
        stamps.extend(self.stamps[j:])
        samples += sample
        samples += self.samples[SIZE * j :]
        known = self.parents if self.parents is not None else [usual] * len(self.stamps)
        return History(stamps, samples, _if_several([*known[:i], parent, *known[j:]]))

    def has(self, ns: int, sample: bytes) -> bool:
        """Whether this very sample is there."""
        i = bisect_left(self.stamps, ns)
        return i < len(self.stamps) and self.stamps[i] == ns and self.samples[SIZE * i : SIZE * (i + 1)] == sample


def _if_several(parents: list[str] | None) -> list[str] | None:
    return parents if parents and any(parent != parents[0] for parent in parents) else None


class Said(NamedTuple):
    """A sample as it came."""

    ns: int
    parent: str
    source: str
    sample: bytes
    """Packed."""


class Late(NamedTuple):
    """Samples in a row that are too old for their link: somebody is late, or a clock was set back."""

    begin: int
    """The time of the first one, ns."""
    last: Said
    newest: int
    """The newest time of the link meanwhile, ns."""


class Link:
    """A child frame, its parent by the newest sample, and its history."""

    __slots__ = ("child", "former", "high", "history", "late", "low", "parent", "source", "stamp", "static", "turns")

    def __init__(self, parent: str, child: str, source: str, history: History) -> None:
        self.parent = parent
        self.child = child
        self.source = source
        """Who said it last."""
        self.history = history
        self.static = False
        self.stamp = 0
        """Of a static link, when it was said, ns."""
        self.former: tuple[str, str] | None = None
        """The parent and the source before those of now."""
        self.turns = 0
        """How often the former ones came back."""
        self.late: Late | None = None
        self.low = self.high = _NEVER
        """What comes between these two times, by the same source with the same parent, is just added, ns."""

    @classmethod
    def fixed(cls, parent: str, child: str, source: str, stamp: int, values: Seven) -> "Link":
        """A static link."""
        link = cls(parent, child, source, History.fixed(values))
        link.static, link.stamp = True, stamp
        return link

    def successor(self, parent: str, history: History) -> "Link":
        """Another link of the same child, that moves."""
        link = Link(parent, self.child, self.source, history)
        link.former, link.turns = self.former, self.turns
        return link

    @property
    def is_plain(self) -> bool:
        """Whether it is known, and has had one parent all the time."""
        return self.static or (self.history.parents is None and len(self.history.stamps) > 0)

    def open(self, span: int) -> None:
        """Let what comes next be just added, until the history is longer than a span, ns."""
        if self.is_plain and not self.static:
            self.low, self.high = self.history.stamps[-1], self.history.stamps[0] + span
        else:
            self.low = self.high = _NEVER
