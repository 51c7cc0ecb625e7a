"""`robo topic plot`: numbers of a topic over time, in the terminal and as a picture."""

import math
import sys
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Group
from rich.live import Live
from rich.text import Text

from robo.bag.look.series import Series
from robo.cli.connection import connect_to_robot
from robo.cli.ending import ended_by_signals
from robo.cli.link import watched
from robo.cli.printing import amount, note, write_file
from robo.cli.reach import Reach
from robo.cli.views.pictures import check_picture, check_theme, panels_of
from robo.cli.views.screen import Screen
from robo.cli.views.waiting import complain_of_few, tell_who_is_waited_for
from robo.errors import UsageError
from robo.interfaces import catalogue
from robo.interfaces.parts import Field, Missing
from robo.interfaces.units import unit_of
from robo.samples.records import Received, read
from robo.samples.stream import Stream
from robo.text.chart import Chart, Point
from robo.text.dates import date
from robo.text.svg import Theme
from robo.text.svg import curves as svg_of
from robo.text.terminal import visible
from robo.text.thinning import Thinned
from robo.tools.fields import flattened

_COLOURS = ("cyan", "yellow", "magenta", "green", "red", "blue")
_PERIOD = 0.1
"""How often the picture is drawn, s."""
_MOST_SERIES = len(_COLOURS)
_MOST_POINTS = 20_000
_MOST_WITHOUT = 10
"""Messages in which a field may be missing before it is an error, where none has had it."""


class Asked(NamedTuple):
    """What is asked for."""

    window: float
    """How far back the terminal shows, s."""
    duration: float | None
    """When it ends, s; None for Ctrl-C."""
    svg: Path | None = None
    """Where all that has come is written as a picture, at the end."""
    theme: Theme = "auto"
    """Of the picture."""


def plot(name: str, fields: Sequence[str], reach: Reach, asked: Asked) -> int:
    """Draw until Ctrl-C or until the time is over; once, where the output is no terminal.

    Args:
        name: of the topic.
        fields: which numbers; none for all.
        reach: the network.
        asked: for how long, and where.

    Returns:
        1 where nothing came.

    Raises:
        UsageError: many topics are named, or the one has no such field, or no number in it, or the picture cannot be
            written.
    """
    check_theme(asked.theme, asked.svg)
    if asked.svg is not None:
        check_picture(str(asked.svg), (".svg",), standard=False)
    key = reach.one_key(name, "plot")
    curves = _Curves(key, [Field(path) for path in dict.fromkeys(fields)])
    with ended_by_signals():
        try:
            return _draw(curves, key, reach, asked)
        finally:  # Ctrl-C is the usual end
            for text in curves.notes():
                note(visible(text))
            if asked.svg is not None and curves.any:
                write_file(curves.svg(asked.theme), asked.svg)
                note(visible(f"{asked.svg} is written"))


def _draw(curves: "_Curves", key: str, reach: Reach, asked: Asked) -> int:
    live = sys.stdout.isatty()
    window, duration = asked.window, asked.duration
    with connect_to_robot(reach) as session, watched(session, reach):
        stream = Stream(session, [key])
        tell_who_is_waited_for(session, [key], reach)
        end = time.monotonic() + (duration if duration is not None else math.inf if live else window)
        if live:
            _show(curves, stream, window, end)
        else:
            window = duration or window
            for arrival in stream.until(end):
                curves.add(read(arrival))
            if curves.any:
                Screen().print(curves.picture(window, 80, 20))
    return complain_of_few([key], int(curves.any), None, duration if live else window)


def _show(curves: "_Curves", stream: Stream, window: float, end: float) -> None:
    console = Screen()
    with Live(console=console, auto_refresh=False, transient=False) as display:
        due = 0.0
        while time.monotonic() < end:
            came = stream.get(min(end, time.monotonic() + _PERIOD))
            if came is not None:
                curves.add(read(came))
            now = time.monotonic()
            if now >= due and curves.any:
                due = now + _PERIOD
                height = max(console.height - 4, 5)
                display.update(curves.picture(window, console.width, min(height, 24)), refresh=True)


class _Curves:
    def __init__(self, key: str, fields: Sequence[Field]) -> None:
        self._key = key
        self._fields = list(fields)
        self._points: dict[str, deque[Point]] = {}
        self._whole: dict[str, Thinned] = {}
        """All that has come, for a picture."""
        self._begin = 0.0
        self._type = ""
        self._unreadable, self._reason = 0, ""
        self._lacking: dict[str, int] = {}
        """How many messages had no such field."""

    @property
    def any(self) -> bool:
        return bool(self._points)

    def add(self, received: Received) -> None:
        """Take the numbers of a message."""
        if received.error:
            self._unreadable += 1
            self._reason = self._reason or received.error
            return
        self._type = received.type
        if not self._fields:
            self._fields = self._choose(received)
        at = received.time * 1e-9
        self._begin = self._begin or at
        for field in self._fields:
            try:
                value = field.of(received.message)
            except Missing as error:
                self._lacks(field, error)
                continue
            if isinstance(value, str) and value in ("nan", "inf", "-inf"):
                value = math.nan
            if not isinstance(value, (int, float)):
                raise UsageError(f"{self._key}: {field.path} is no number but {type(value).__name__}")
            self._points.setdefault(field.path, deque(maxlen=_MOST_POINTS)).append((at, float(value)))
            self._whole.setdefault(field.path, Thinned()).add(at - self._begin, float(value))

    def _lacks(self, field: Field, error: Missing) -> None:
        """A message has no such field: a list may be longer another time, and a name that is none never comes."""
        lacking = self._lacking[field.path] = self._lacking.get(field.path, 0) + 1
        if field.path not in self._points and (not error.may_come or lacking >= _MOST_WITHOUT):
            raise UsageError(f"{self._key} ({self._type or 'no type'}): {error}")

    def notes(self) -> list[str]:
        """What was left out."""
        found = []
        if self._unreadable:
            found.append(f"{amount(self._unreadable, 'message')} could not be read; the first: {self._reason}")
        if self._lacking:
            told = ", ".join(f"{path} of {amount(count, 'message')}" for path, count in self._lacking.items())
            found.append(f"not there: {told}")
        return found

    def _choose(self, received: Received) -> list[Field]:
        """All numbers but stamps and flags, as many as have a colour."""
        paths = [
            path
            for path, value in flattened(received.message)
            if isinstance(value, (int, float)) and not isinstance(value, bool) and not path.startswith("header.")
        ]
        if not paths:
            raise UsageError(f"{self._key} ({received.type or 'no type'}) has no numbers outside of lists; say --field")
        return [Field(path) for path in paths[:_MOST_SERIES]]

    def svg(self, theme: Theme) -> str:
        """All that has come as a picture."""
        type_ = catalogue.find_here(self._type) if self._type else None
        found = [
            Series(self._key, path, unit_of(type_, path) if type_ is not None else "", line.points, line.count)
            for path, line in self._whole.items()
        ]
        return svg_of(
            f"{self._key}  {self._type}", panels_of(found), f"s since {date(round(self._begin * 1e9))}", theme=theme
        )

    def picture(self, window: float, width: int, height: int) -> Group:
        """The chart with a legend above it."""
        end = max((points[-1][0] for points in self._points.values()), default=time.time())
        for points in self._points.values():
            while points and points[0][0] < end - window:
                points.popleft()
        chart = Chart(
            {path: list(points) for path, points in self._points.items()},
            begin=end - window,
            end=end,
            width=width,
            height=height,
        )
        legend = Text(visible(f"{self._key}  {self._type}  "), overflow="ellipsis", no_wrap=True)
        for number, (path, points) in enumerate(self._points.items()):
            last = f" {points[-1][1]:.4g}" if points else ""
            legend.append(visible(f"{path}{last}  "), style=_COLOURS[number % len(_COLOURS)])
        rows = []
        for row in chart.rows:
            line = Text(no_wrap=True)
            for character, owner in row:
                line.append(character, style="" if owner is None else _COLOURS[owner % len(_COLOURS)])
            rows.append(line)
        return Group(legend, *rows, Text(f"{f'-{window:g} s':<{max(width - 4, 8)}}now", no_wrap=True))
