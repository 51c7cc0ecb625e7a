"""`robo tf`: frames and where they stand, as text and as JSON."""

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import zenoh

from robo.cli.connection import connect_to_robot
from robo.cli.link import watched
from robo.cli.printing import clear_screen, hint, note, paint, print_json, print_line
from robo.cli.reach import Reach
from robo.errors import TransformError
from robo.text import colours
from robo.tf import FrameInfo, Transform3
from robo.tools.transforms import Frames, namespace_of

STALE = 1.0
"""A frame that moves and of which nothing came for so long is red, s."""


def print_tree(reach: Reach, duration: float, *, json: bool) -> None:
    """Listen, and print the frames as a tree.

    Raises:
        RoboError: no node publishes transforms, or those of several robots do.
    """
    with connect_to_robot(reach) as session, _frames(session, reach) as frames:
        frames.follow(time.monotonic() + duration)
        if json:
            print_json(frames.buffer.frames())
        else:
            _show(frames, duration)


def monitor(reach: Reach, *, interval: float, json: bool) -> None:
    """Show the frames as a tree again and again.

    Raises:
        RoboError: as `print_tree`.
    """
    with connect_to_robot(reach) as session, watched(session, reach), _frames(session, reach) as frames:
        while True:
            frames.follow(time.monotonic() + interval)
            if json:
                print_json(frames.buffer.frames())
                continue
            clear_screen()
            _show(frames, interval)


def echo(
    target: str,
    source: str,
    reach: Reach,
    *,
    interval: float,
    once: bool,
    duration: float | None,
    json: bool,
) -> int:
    """Print where a frame stands in another, again and again.

    Returns:
        1 where it was never known.

    Raises:
        RoboError: no node publishes transforms, or those of several robots do.
    """
    end = math.inf if duration is None else time.monotonic() + duration
    with connect_to_robot(reach) as session, watched(session, reach), _frames(session, reach) as frames:
        told, known = "", False
        due = known_last = time.monotonic()
        while due <= end:
            try:
                at = frames.buffer.newest(target, source)
                found = frames.buffer.lookup(target, source, at)
            except TransformError as error:
                now = time.monotonic()
                if now > end:
                    break
                if now > known_last + _PATIENCE and told != (told := str(error)):
                    note(told)
                frames.follow(now + _LOOK)
                continue
            _print_transform(found, at, json=json)
            if once:
                return 0
            told, known, known_last = "", True, time.monotonic()
            due = known_last + interval
            frames.follow(min(due, end))
        return 0 if known else 1


_LOOK = 0.05
"""How often it is looked whether a transform is known by now, s."""
_PATIENCE = 0.5
"""After how long it is said that it is not, s."""


@contextmanager
def _frames(session: zenoh.Session, reach: Reach) -> Iterator[Frames]:
    frames = Frames(session, namespace_of(session, reach.robot, reach.timeout), reach.timeout)
    try:
        yield frames
    finally:
        frames.close()


def _show(frames: Frames, duration: float) -> None:
    infos = frames.buffer.frames()
    for line in tree_lines(infos):
        print_line(line)
    for warning in frames.buffer.warnings():
        note(warning.text)
    if frames.malformed:
        note(f"{frames.malformed} messages could not be read as tf2/TFMessage")
    if not infos:
        hint(f"no transform has come on {' and '.join(frames.keys)} for {duration:g} s")


def tree_lines(infos: Sequence[FrameInfo]) -> list[str]:
    """Frames as a tree, a line each; those that stand in no other come first.

    Args:
        infos: in the order in which a buffer lists them: each is followed by those that stand in it.
    """
    lines: list[tuple[str, FrameInfo | None]] = []
    bars: list[bool] = []
    for number, info in enumerate(infos):
        if info.depth == 1 and (number == 0 or _root(infos, number - 1) != info.parent):
            lines.append((info.parent, None))
        del bars[info.depth - 1 :]
        last = not _has_sibling_below(infos, number)
        trunk = "".join("│  " if bar else "   " for bar in bars)
        lines.append((f"{trunk}{'└─ ' if last else '├─ '}{info.child}", info))
        bars.append(not last)
    width = max((len(text) for text, info in lines if info is not None), default=0)
    return [text if info is None else f"{text:<{width}}  {_about(info)}" for text, info in lines]


def _root(infos: Sequence[FrameInfo], number: int) -> str:
    """The root of the tree in which a frame stands."""
    return next(infos[i].parent for i in range(number, -1, -1) if infos[i].depth == 1)


def _has_sibling_below(infos: Sequence[FrameInfo], number: int) -> bool:
    """Whether another frame that stands in the same one comes later."""
    own = infos[number]
    for info in infos[number + 1 :]:
        if info.depth < own.depth or (info.depth == own.depth and info.parent != own.parent):
            return False
        if info.depth == own.depth:
            return True
    return False


def _about(info: FrameInfo) -> str:
    if info.static:
        facts = "static"
    elif info.age is None:
        facts = paint("nothing has come", colours.RED)
    else:
        rate = f"{info.rate:.1f} Hz, " if info.rate is not None else ""
        facts = f"{rate}{info.age:.2f} s old"
        facts = paint(facts, colours.RED) if info.age > STALE else facts
    return f"{facts}, by {info.source}" if info.source else facts


def _print_transform(found: Transform3, at: int | None, *, json: bool) -> None:
    stamp = None if at is None else at * 1e-9
    roll, pitch, yaw = found.rpy()
    rpy = {"roll": roll, "pitch": pitch, "yaw": yaw}
    if json:
        place = {"x": found.x, "y": found.y, "z": found.z}
        turn = {"x": found.qx, "y": found.qy, "z": found.qz, "w": found.qw}
        print_json({"stamp": stamp, "translation": place, "rotation": turn} | rpy)
        return
    print_line(f"at {stamp:.3f} s" if stamp is not None else "at all times")
    print_line(f"  translation  x {found.x:z.4f}  y {found.y:z.4f}  z {found.z:z.4f} m")
    print_line(f"  rotation     x {found.qx:z.4f}  y {found.qy:z.4f}  z {found.qz:z.4f}  w {found.qw:z.4f}")
    angles = "  ".join(f"{name} {math.degrees(angle):z.2f}°" for name, angle in rpy.items())
    print_line(f"               {angles}")
