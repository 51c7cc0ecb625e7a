"""What makes a flight recorder keep what it has: reasons, and the windows of time that they ask for. Pure.

Times are ns since the epoch by this machine's clock.
"""

import re
import time
from collections.abc import Sequence
from typing import Literal

import msgspec

Kind = Literal["died", "degraded", "emergency stop", "asked", "run ended"]

_LONGEST_NAME = 80
"""Of a file, without its end, characters."""
CLOCKS_AGREE = 5_000_000_000
"""Whose time differs by more has another clock, ns."""
MOST_REASONS = 100
"""Of one window; more are counted."""


class Reason(msgspec.Struct, frozen=True):
    """Something that has happened."""

    time: int
    kind: Kind
    node: str
    """The full name of the node that it concerns; empty for none."""
    text: str
    """In words."""

    @property
    def word(self) -> str:
        """What a file's name says of it."""
        label = self.node.rpartition("/")[2]
        if self.kind == "asked":
            return self.text or "asked"
        return f"{label} {self.kind}" if label else self.kind

    @property
    def line(self) -> str:
        """For people."""
        who = f"{self.node} " if self.node and not self.text.startswith(self.node) else ""
        return f"{who}{self.text or self.kind}"


class Window(msgspec.Struct):
    """A time that is to be kept, and why."""

    begin: int
    due: int
    """Its end, when it is written."""
    latest: int
    """No reason puts the end off beyond this."""
    reasons: list[Reason]
    left_out: int = 0
    """Reasons for which there was no room."""

    @property
    def first(self) -> Reason:
        """What it is named after."""
        return self.reasons[0]

    @property
    def text(self) -> str:
        """All reasons in words."""
        more = len(self.reasons) - 1 + self.left_out
        return self.first.line + (f", and {more} more" if more else "")

    @property
    def nodes(self) -> list[str]:
        """The nodes that it concerns, each once."""
        return list(dict.fromkeys(one.node for one in self.reasons if one.node))


class Windows:
    """Reasons as they come, and the windows that they make: one at a time is open."""

    def __init__(self, before: float, after: float, again: float) -> None:
        """
        Args:
            before: how much is kept before the first reason, s.
            after: how much after the last one, s; together at most twice that after the first.
            again: the same of the same node opens no other window within so long, s; else what crashes again and
                again would take the place of what is worth keeping.
        """
        self.before = before
        self.after = after
        self.again = again
        self.open: Window | None = None
        """The one that is not due yet."""
        self._opened: dict[tuple[Kind, str], int] = {}
        """When what last opened one."""

    def add(self, reason: Reason) -> Window | None:
        """Something has happened; the window in which it is, None for none."""
        after = round(self.after * 1e9)
        window = self.open
        if window is None:
            what = reason.kind, reason.node
            last = self._opened.get(what)
            soon = last is not None and 0 <= reason.time - last < self.again * 1e9
            if soon and reason.kind != "asked":
                return None
            self._opened = {one: at for one, at in self._opened.items() if reason.time - at < self.again * 1e9}
            self._opened[what] = reason.time
            begin = reason.time - round(self.before * 1e9)
            window = self.open = Window(begin, reason.time + after, reason.time + 2 * after, [])
        if len(window.reasons) < MOST_REASONS:
            window.reasons.append(reason)
        else:
            window.left_out += 1
        window.due = min(max(window.due, reason.time + after), window.latest)
        return window

    def take(self, now: int, *, at_once: bool = False) -> Window | None:
        """The window that is due; where `at_once`, the open one in any case. It ends now at the latest."""
        window = self.open
        if window is None:
            return None
        if now < window.first.time - CLOCKS_AGREE:  # the clock was set back: what has come bears the old time
            self.open = None
            return window
        if window.due > now and not at_once:
            return None
        self.open = None
        window.due = min(window.due, now)
        return window


def file_name(robot: str, window: Window) -> str:
    """What its file is called: `r1_2026-11-23_20-15-03_safety_monitor_died`; times are the machine's own."""
    begin = f"{_slug(robot, 40) or 'robot'}_{stamp(window.first.time)}"
    word = _slug(window.first.word, _LONGEST_NAME - len(begin) - 1)
    return f"{begin}_{word}" if word else begin


def stamp(at: int) -> str:
    """A time within a file's name."""
    return time.strftime("%Y-%m-%d_%H-%M-%S", time.localtime(at / 1e9))


def _slug(text: str, most: int) -> str:
    """A text as a file's name may have it: letters, digits and `_`."""
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")[:most].rstrip("_")


def to_go(files: Sequence[tuple[int, int]], most: int, most_size: int) -> int:
    """How many of some files have to go, so that there are at most `most` and they take at most `most_size` bytes.

    The newest stays, whatever its size.

    Args:
        files: time and size in bytes of each, the oldest first.
        most: how many may be there.
        most_size: bytes.
    """
    gone, total = 0, sum(size for _, size in files)
    while len(files) - gone > 1 and (len(files) - gone > most or total > most_size):
        total -= files[gone][1]
        gone += 1
    return gone


def arrivals(published: Sequence[int | None], last: int, now: int) -> list[int]:
    """When messages came that were taken out of a channel together.

    Each came between the two looks at the channel. Where its publisher's clock is this machine's, it came when it was
    published, as far as anybody can tell; else its place among the others says when. Messages that were published in
    order come in order.

    Args:
        published: by the publishers' clocks, in the order in which they came; None where one does not say.
        last: the look before this one.
        now: this look.
    """
    count = len(published)
    span = max(now - last, 0)
    return [
        min(max(at, last), now)
        if at is not None and last - _LATE <= at <= now + _LATE
        else last + span * (number + 1) // count
        for number, at in enumerate(published)
    ]


_LATE = 1_000_000_000
"""A message is on its way for no longer, ns: whose clock says more has another one."""
