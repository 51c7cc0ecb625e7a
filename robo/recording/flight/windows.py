"""What makes a flight recorder keep what it has: reasons, and the windows of time that they ask for. Pure.

Times are ns since the epoch, by the recorder's clock.
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
_MOST_OFF = 1_000_000_000
"""By how much what follows puts the end of a window off, ns: the file of what came first is there soon."""
_MOST_KNOWN = 1_000
"""Things that happened of which it is known when."""


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

    def later(self, by: int) -> "Reason":
        """The same by a clock that is so many ns ahead."""
        return msgspec.structs.replace(self, time=self.time + by)


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

    def later(self, by: int) -> "Window":
        """The same by a clock that is so many ns ahead."""
        reasons = [one.later(by) for one in self.reasons]
        return Window(self.begin + by, self.due + by, self.latest + by, reasons, self.left_out)


class Windows:
    """Reasons as they come, and the windows that they make: one at a time is open."""

    def __init__(self, before: float, after: float, again: float) -> None:
        """
        Args:
            before: how much is kept before the first reason, s.
            after: how much after the last one, s; what comes after the first one puts the end off by a second at most.
            again: the same of the same node opens a window only after it has not happened for so long, s; else what
                crashes again and again would take the place of what is worth keeping.
        """
        self.before = before
        self.after = after
        self.again = again
        self.open: Window | None = None
        """The one that is not due yet."""
        self._last: dict[tuple[Kind, str], int] = {}
        """When what happened last."""

    def add(self, reason: Reason) -> Window | None:
        """Something has happened; the window in which it is, None for none."""
        last = self.note(reason)
        after = round(self.after * 1e9)
        window = self.open
        if window is None:
            soon = last is not None and 0 <= reason.time - last < self.again * 1e9
            if soon and reason.kind != "asked":
                return None
            begin, due = reason.time - round(self.before * 1e9), reason.time + after
            window = self.open = Window(begin, due, due + min(after, _MOST_OFF), [])
        if len(window.reasons) < MOST_REASONS:
            window.reasons.append(reason)
        else:
            window.left_out += 1
        window.due = min(max(window.due, reason.time + after), window.latest)
        return window

    def note(self, reason: Reason) -> int | None:
        """Something has happened for which there is a file already; when the same did before."""
        what = reason.kind, reason.node
        last = self._last.pop(what, None)
        self._last[what] = reason.time if last is None else max(reason.time, last)
        if len(self._last) > _MOST_KNOWN:
            del self._last[next(iter(self._last))]
        return last

    def wait(self, now: int) -> None:
        """A file is being written: the window that is open stays so, and what happens meanwhile is in it."""
        if self.open is not None:
            self.open.latest = max(self.open.latest, now + round(self.after * 1e9))

    def take(self, now: int, *, at_once: bool = False) -> Window | None:
        """The window that is due; where `at_once`, the open one in any case. It ends now at the latest."""
        window = self.open
        if window is None or (window.due > now and not at_once):
            return None
        self.open = None
        window.due = min(window.due, now)
        return window


def file_name(robot: str, window: Window) -> str:
    """What its file is called: `r1_2026-11-23_20-15-03_safety_monitor_died`; times are the machine's own."""
    begin = f"{_robot_word(robot)}_{stamp(window.first.time)}"
    word = _slug(window.first.word, _LONGEST_NAME - len(begin) - 1) or _slug(window.first.kind, _LONGEST_NAME)
    return f"{begin}_{word}"


def names_of(robot: str) -> re.Pattern[str]:
    """What names the files have that `file_name` names, with their ends and a number where there are several."""
    return re.compile(rf"{_robot_word(robot)}_\d{{4}}-\d\d-\d\d_\d\d-\d\d-\d\d_[A-Za-z0-9_]+\.mcap")


def _robot_word(robot: str) -> str:
    return _slug(robot, 40) or "robot"


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
