"""Curves over time as a picture: SVG without a library. Pure."""

import math
import unicodedata
from collections.abc import Iterator, Sequence
from html import escape
from typing import Literal, NamedTuple

Point = tuple[float, float]
"""Time (s) and value."""
Theme = Literal["auto", "light", "dark"]
"""Whether a picture is light or dark; auto is as whoever looks at it has their screen."""

LIGHT = ("#1668b8", "#c8281e", "#23863a", "#8a4fc4", "#b86a00", "#0b8494", "#8c564b", "#c2308f")
DARK = ("#6cb6ff", "#ff7b72", "#7ee787", "#c9a4ff", "#ffb454", "#4fd3e3", "#d8ab98", "#ff8fd0")
"""Of curves: each is readable on its paper."""

_WIDTH, _LEFT, _RIGHT = 800, 90, 24
"""Of the panels and beside them, pixels; more at the left where numbers are long."""
_LONGEST_LABEL = 13
"""Letters, of which shorter numbers are written out."""
_HEIGHTS = (260, 200, 160)
"""Of one of one panel, of two, of more."""
_LETTER = 7.2
"""Width of a letter, pixels: enough for most fonts."""
_LINE = 18
_MOST_NAME = 90
"""Letters of a name in the legend."""


class Curve(NamedTuple):
    """A line."""

    name: str
    points: Sequence[Point]
    """Those that are not finite leave a gap."""
    colour: int | None = None
    """Which one; None for the next."""


class Panel(NamedTuple):
    """Curves with one axis of values."""

    curves: Sequence[Curve]
    unit: str = ""


def plot(title: str, names: tuple[str, str], first: Sequence[Point], second: Sequence[Point], mark: float) -> str:
    """A picture of two series, and of their difference where both have a point of the same time.

    Args:
        title: of the picture.
        names: of the series.
        first, second: their points; those that are not finite leave a gap.
        mark: a time that is marked with a line, s.
    """
    others = dict(second)
    apart = [(time, others[time] - value) for time, value in first if time in others]
    both = Panel([Curve(names[0], first), Curve(names[1], second)])
    return curves(title, [both, Panel([Curve("difference", apart, 3)])], "s since the first message", mark=mark)


def curves(
    title: str,
    panels: Sequence[Panel],
    axis: str,
    *,
    span: tuple[float, float] | None = None,
    mark: float | None = None,
    theme: Theme = "auto",
) -> str:
    """A picture of panels one below the other, over the same time.

    Args:
        title: of the picture.
        panels: from the top.
        axis: what the times are: `s since 18:30:00`.
        span: the times at the left and the right edge, s; None for those of the first and the last point.
        mark: a time that is marked with a line, s.
        theme: its colours.
    """
    if span is None:
        times = [time for panel in panels for curve in panel.curves for time, _ in curve.points] or [0.0]
        span = min(times), max(times)
    if not span[0] < span[1]:
        span = span[0] - 0.5, span[0] + 0.5  # one point stands in the middle
    limits = [_limits(panel) for panel in panels]
    longest = max((len(label) for one in limits for label in labels(ticks(*one, 4))), default=0)
    left = max(_LEFT, round(longest * _LETTER) + 14)
    height = _HEIGHTS[min(len(panels), len(_HEIGHTS)) - 1] if panels else 0
    top: float = 34
    parts: list[str] = []
    for panel, values in zip(panels, limits, strict=True):
        legend = list(_legend(panel, left, top + 12))
        top = legend[-1][0] + 8 if legend else top
        parts += [text for _, text in legend]
        parts += _panel(_Area(left, top, height, span, values), panel, mark)
        top += height + 30
    parts.append(_text(left + _WIDTH, top + 4, axis, anchor="end"))
    return document(title, left + _WIDTH + _RIGHT, top + 16, parts, theme)


def document(title: str, width: float, height: float, parts: Sequence[str], theme: Theme, style: str = "") -> str:
    """A picture with its title, on its paper.

    Args:
        title: above it, and what is read to those who cannot see.
        width, height: pixels.
        parts: elements.
        theme: its colours.
        style: more rules of CSS.
    """
    shown = shortened(title, round((width - 30) / 9.6))
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}"'
        f' height="{height:.0f}" role="img" font-family="sans-serif" font-size="13">',
        f"<title>{escape(_clean(title))}</title>",
        f"<style>{_style(theme)}{style}</style>",
        '<rect class="paper" width="100%" height="100%"/>',
        f'<text class="ink" x="16" y="24" font-size="16">{escape(_clean(shown))}</text>',
        *parts,
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def in_themes(theme: Theme, light: str, dark: str) -> str:
    """Rules of CSS for a theme, of those for light and for dark paper."""
    if theme == "auto":
        return f"{light}@media (prefers-color-scheme:dark){{{dark}}}"
    return dark if theme == "dark" else light


def words(text: str) -> str:
    """Words as an element of SVG holds them: escaped, and without what XML forbids."""
    return escape(_clean(text))


def columns(text: str) -> int:
    """How many letters wide a text is: Chinese and Japanese ones are as wide as two."""
    return len(text) if text.isascii() else sum(2 if unicodedata.east_asian_width(one) in "WF" else 1 for one in text)


def shortened(text: str, most: int) -> str:
    """A text of at most so many letters, of which wide ones, as Chinese has them, count twice."""
    if columns(text) <= most:
        return text
    room = most - 1
    kept = 0
    for letter in text:
        room -= columns(letter)
        if room < 0:
            break
        kept += 1
    return f"{text[:kept]}…"


def labels(marks: Sequence[float]) -> list[str]:
    """Numbers of an axis, with as many digits as tell them apart.

    Args:
        marks: at even steps.
    """
    step = abs(marks[1] - marks[0]) if len(marks) > 1 else 0.0
    if not 0.0 < step < math.inf:
        return [f"{mark:.6g}" for mark in marks]
    widest, last = math.floor(math.log10(max(map(abs, marks)))), math.floor(math.log10(step) + 1e-9)
    if last > -7 and max(widest, 0) + max(-last, 0) < _LONGEST_LABEL:
        written = [f"{mark:.{max(-last, 0)}f}" for mark in marks]
    else:
        written = [f"{mark:.{min(max(widest - last, 0), 16)}e}" for mark in marks]
    return [text if round(mark / step) else "0" for mark, text in zip(marks, written, strict=True)]


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Round numbers from `low` to `high`, at most `most` and one more: steps of 1, 2 or 5 and zeros."""
    rough = high / most - low / most
    if not 0.0 < rough < math.inf:
        return [low]
    power = math.floor(math.log10(rough))
    step = next((n * 10.0**power for n in (1, 2, 5) if n * 10.0**power >= rough), 10.0 ** (power + 1))
    if not (0.0 < step < math.inf and abs(low / step) < 1e15):
        return [low, high]
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)]


def _style(theme: Theme) -> str:
    def rules(paper: str, ink: str, faint: str, colours: Sequence[str]) -> str:
        lines = "".join(f".c{n}{{stroke:{c}}}.t{n}{{fill:{c}}}" for n, c in enumerate(colours))
        return (
            f".paper{{fill:{paper}}}.ink{{fill:{ink}}}.faint{{stroke:{faint}}}.mark{{stroke:{ink}}}"
            f".line{{fill:none;stroke-width:1.5;stroke-linejoin:round;stroke-linecap:round}}"
            f".dot{{stroke-width:4}}{lines}"
        )

    return in_themes(theme, rules("#ffffff", "#24292f", "#d0d7de", LIGHT), rules("#12161c", "#e6edf3", "#3d444d", DARK))


class _Area(NamedTuple):
    """Where a panel is, pixels, and what it shows."""

    left: float
    top: float
    height: float
    span: tuple[float, float]
    """s"""
    limits: tuple[float, float]
    """Of the values."""

    def x(self, time: float) -> float:
        return self.left + (time - self.span[0]) / (self.span[1] - self.span[0]) * _WIDTH

    def y(self, value: float) -> float:
        low, high = self.limits
        # halves: the range itself may be too large
        return self.top + (high / 2 - value / 2) / (high / 2 - low / 2) * self.height


def _legend(panel: Panel, left: float, y: float) -> Iterator[tuple[float, str]]:
    """The names of a panel's curves, in as many lines as they take: where each stands, and it."""
    x = left
    if panel.unit:
        yield y, _text(left - 6, y, panel.unit, anchor="end")
    for number, curve in enumerate(panel.curves):
        name = shortened(curve.name, _MOST_NAME)
        width = columns(name) * _LETTER + 24
        if x > left and x + width > left + _WIDTH:
            x, y = left, y + _LINE
        yield y, _text(x, y, name, style=f"t{_colour(curve, number)}")
        x += width


def _panel(area: _Area, panel: Panel, mark: float | None) -> Iterator[str]:
    left, top, height, x, y = area.left, area.top, area.height, area.x, area.y
    yield f'<rect class="faint" x="{left}" y="{top:.1f}" width="{_WIDTH}" height="{height}" fill="none"/>'
    values = ticks(*area.limits, 4)
    for value, label in zip(values, labels(values), strict=True):
        yield f'<line class="faint" x1="{left}" x2="{left + _WIDTH}" y1="{y(value):.1f}" y2="{y(value):.1f}"/>'
        yield _text(left - 6, y(value) + 4, label, anchor="end")
    times = ticks(*area.span, 8)
    for time, label in zip(times, labels(times), strict=True):
        yield f'<line class="faint" x1="{x(time):.1f}" x2="{x(time):.1f}" y1="{top:.1f}" y2="{top + height:.1f}"/>'
        yield _text(x(time), top + height + 16, label, anchor="middle")
    if mark is not None and area.span[0] <= mark <= area.span[1]:
        yield f'<path class="mark" d="M{x(mark):.1f} {top:.1f}v{height}" stroke-dasharray="4"/>'
    for number, curve in enumerate(panel.curves):
        line, dots = _paths([(x(time), y(value)) for time, value in curve.points])
        colour = f"c{_colour(curve, number)}"
        if line:
            yield f'<path class="line {colour}" d="{line}"/>'
        if dots:
            yield f'<path class="line dot {colour}" d="{dots}"/>'


def _colour(curve: Curve, number: int) -> int:
    return (number if curve.colour is None else curve.colour) % len(LIGHT)


def _limits(panel: Panel) -> tuple[float, float]:
    values = [value for curve in panel.curves for _, value in curve.points if math.isfinite(value)]
    low, high = min(values, default=0.0), max(values, default=0.0)
    room = max(high / 2 - low / 2, 0.0) * 0.08 or max(abs(high) * 0.05, 0.5)
    return max(low - room, -1.7e308), min(high + room, 1.7e308)


def _paths(points: Sequence[Point]) -> tuple[str, str]:
    """A line through points, and those that stand alone: lines of no length, which round ends make dots."""
    line, dots, begun = [], [], False
    for number, (x, y) in enumerate(points):
        if math.isfinite(y):
            alone = not begun and not (number + 1 < len(points) and math.isfinite(points[number + 1][1]))
            if alone:
                dots.append(f"M{x:.1f} {y:.1f}h0")
            else:
                line.append(f"{'L' if begun else 'M'}{x:.1f} {y:.1f}")
        begun = math.isfinite(y)
    return "".join(line), "".join(dots)


def _text(x: float, y: float, text: str, *, anchor: str = "start", style: str = "ink") -> str:
    where = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return f'<text class="{style}" x="{x:.1f}" y="{y:.1f}"{where}>{words(text)}</text>'


def _clean(text: str) -> str:
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in text)
