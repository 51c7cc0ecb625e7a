"""The tree of a buffer as a list, for tools and people."""

from collections.abc import Iterable

import msgspec

from robo.tf.history import Link


class FrameInfo(msgspec.Struct, frozen=True):
    """One frame that stands in another."""

    child: str
    """The frame."""
    parent: str
    """The frame that it stands in, by the newest that was said."""
    static: bool
    """Whether it does not move."""
    rate: float | None
    """Hz: how often it was said within the history; None for a static frame, and where it was said less than twice."""
    newest: int | None
    """The stamp of what was said last, ns; None where nothing was since the history was cleared."""
    age: float | None
    """How old that is, s; None of a static frame, which does not grow old."""
    source: str
    """Who said it last; empty where nobody has told."""
    depth: int
    """How many frames it stands in, one in the other: at least 1."""


def frames_of(links: Iterable[Link], now: int) -> list[FrameInfo]:
    """All frames that stand in another: each is followed by those that stand in it, in the order of their names.

    Args:
        links: all of them.
        now: from when ages count, ns.
    """
    inside: dict[str, list[Link]] = {}
    for link in links:
        inside.setdefault(link.parent, []).append(link)
    children = {link.child for below in inside.values() for link in below}
    found: list[FrameInfo] = []
    first = [link for root in sorted(inside.keys() - children) for link in sorted(inside[root], key=_name)]
    waiting = [(link, 1) for link in reversed(first)]
    while waiting:
        link, depth = waiting.pop()
        found.append(_info(link, depth, now))
        waiting += [(one, depth + 1) for one in sorted(inside.get(link.child, ()), key=_name, reverse=True)]
    return found


def _name(link: Link) -> str:
    return link.child


def _info(link: Link, depth: int, now: int) -> FrameInfo:
    stamps = link.history.stamps
    newest = link.stamp if link.static else stamps[-1] if stamps else None
    age = None if link.static or newest is None else (now - newest) / 1e9
    rate = (len(stamps) - 1) * 1e9 / (stamps[-1] - stamps[0]) if len(stamps) > 1 else None
    return FrameInfo(link.child, link.parent, link.static, rate, newest, age, link.source, depth)
