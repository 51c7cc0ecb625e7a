"""What is wrong with a question or with a transform, in words: frames, links and times, and what helps."""

from collections.abc import Iterable, Sequence

from robo.errors import (
    ExtrapolationError,
    FramesNotConnected,
    InTheFuture,
    InvalidTransform,
    NoTransformData,
    TooOld,
    UnknownFrame,
)
from robo.text.brief import brief
from robo.text.suggestions import suggest
from robo.text.terminal import visible
from robo.tf.history import Link

_LONGEST_NAME = 80


def name(frame: str) -> str:
    """A frame's name as a message shows it."""
    return visible(brief(frame, _LONGEST_NAME)) or "''"


def link_name(parent: str, child: str) -> str:
    """A link as a message shows it."""
    return f"{name(parent)} → {name(child)}"


def seconds(ns: int) -> str:
    """A time or a span in s, exact, with at least three digits behind the point: `12.480 s`."""
    whole, rest = divmod(abs(ns), 1_000_000_000)
    digits = f"{rest:09d}".rstrip("0")
    return f"{'-' if ns < 0 else ''}{whole}.{digits:0<3} s"


def said_by(source: str) -> str:
    """` from odometry`, or nothing where nobody knows."""
    return f" from {name(source)}" if source else ""


def loop_text(child: str, above: Sequence[str], ns: int | None = None) -> str:
    """A frame that would stand in itself: `above` are the frames from its parent on."""
    if ns is not None:
        loop = " in ".join(map(name, (*above, child)))
        return f"at {seconds(ns)} the frames are a loop, {loop}: their parents changed about that time"
    inside = f"{name(above[0])} stands in {' in '.join(map(name, above[1:]))} already"
    return f"{name(child)} cannot stand in {name(above[0])}: {inside}, and no frame can be its own ancestor"


def bad_name(frame: str, role: str) -> InvalidTransform | None:
    """What is wrong with a name in a lookup; None where nothing is."""
    if not frame:
        return InvalidTransform(f"the {role} frame has an empty name; it takes one such as base_link")
    if frame.startswith("/"):
        shown = name(frame)
        return InvalidTransform(f"the {role} frame {shown} begins with a slash; write {shown.lstrip('/')}")
    return None


def unknown_frame(frame: str, known: Iterable[str]) -> UnknownFrame | NoTransformData:
    """Nobody has named a frame."""
    names = sorted(known)
    if not names:
        return NoTransformData(f"there is no frame {name(frame)}: no transform has come yet of any frame")
    return UnknownFrame(f"there is no frame {name(frame)}; {suggest(frame, names)}")


def not_connected(target: str, source: str, root_of_target: str, root_of_source: str) -> FramesNotConnected:
    """Two frames are in two trees."""

    def place(frame: str, root: str) -> str:
        return f"{name(frame)} stands in {'no other frame' if frame == root else f'the tree of {name(root)}'}"

    return FramesNotConnected(
        f"nothing leads from {name(source)} to {name(target)}: {place(source, root_of_source)}, and "
        f"{place(target, root_of_target)}; a transform is missing that has {name(root_of_source)} or "
        f"{name(root_of_target)} as its child"
    )


def no_data(link: Link) -> NoTransformData:
    """Nothing has come of a link since its history was cleared."""
    which = link_name(link.parent, link.child)
    return NoTransformData(f"nothing has come of {which} since its history was cleared; wait for it")


def not_known_at(links: Sequence[Link], ns: int, *, newest: bool, duration: int) -> ExtrapolationError:
    """A time at which not all links are known.

    Args:
        links: those of the chain that move, with some history each.
        ns: the time.
        newest: whether it is the newest that they have, rather than one that was asked for.
        duration: how long the histories of the buffer are, ns.
    """
    late = min(links, key=lambda link: link.history.stamps[-1])
    early = max(links, key=lambda link: link.history.stamps[0])
    last, first = late.history.stamps[-1], early.history.stamps[0]
    if ns > last:
        which = link_name(late.parent, late.child)
        text = (
            f"{seconds(ns)} is in the future of {which}: its newest is of {seconds(last)}, {seconds(ns - last)} before"
        )
        return InTheFuture(f"{text}; wait for it, or leave the time out", late.parent, late.child, ns, last)
    which = link_name(early.parent, early.child)
    if newest:
        silent = link_name(late.parent, late.child)
        text = (
            f"there is no time at which all links are known: the newest of {silent} is of {seconds(last)}, and {which} "
            f"is known from {seconds(first)} on, {seconds(first - last)} after; does anybody still publish {silent}?"
        )
    else:
        text = (
            f"{seconds(ns)} is too old for {which}: its history begins at {seconds(first)}, {seconds(first - ns)} after"
        )
        if ns == 0:
            text += "; for the newest leave the time out, 0 is a time as any other"
        elif early.history.stamps[-1] - first >= duration * 9 // 10:
            text += f"; this buffer keeps {seconds(duration)}, Buffer(duration=…) more"
    return TooOld(text, early.parent, early.child, ns, first)
