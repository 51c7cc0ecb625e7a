"""Curves over time as a picture: SVG without a library. Pure."""

import math
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
"""Of the panels and beside them, pixels."""
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
    span = span[0], max(span[1], span[0] + 1e-9)
    height = _HEIGHTS[min(len(panels), len(_HEIGHTS)) - 1] if panels else 0
    top: float = 34
    parts: list[str] = []
    for panel in panels:
        legend = list(_legend(panel, top + 12))
        top = legend[-1][0] + 8 if legend else top
        parts += [text for _, text in legend]
        parts += _panel(top, height, panel, span, mark)
        top += height + 30
    parts.append(_text(_LEFT + _WIDTH, top + 4, axis, anchor="end"))
    return document(title, _LEFT + _WIDTH + _RIGHT, top + 16, parts, theme)


def document(title: str, width: float, height: float, parts: Sequence[str], theme: Theme, style: str = "") -> str:
    """A picture with its title, on its paper.

    Args:
        title: above it, and what is read to those who cannot see.
        width, height: pixels.
        parts: elements.
        theme: its colours.
        style: more rules of CSS.
    """
    room = round((width - 30) / 9.6)
    shown = title if len(title) <= room else f"{title[: room - 1]}…"
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
            f".line{{fill:none;stroke-width:1.5;stroke-linejoin:round}}{lines}"
        )

    return in_themes(theme, rules("#ffffff", "#24292f", "#d0d7de", LIGHT), rules("#12161c", "#e6edf3", "#3d444d", DARK))


def _legend(panel: Panel, y: float) -> Iterator[tuple[float, str]]:
    """The names of a panel's curves, in as many lines as they take: where each stands, and it."""
    x: float = _LEFT
    if panel.unit:
        yield y, _text(_LEFT - 6, y, panel.unit, anchor="end")
    for number, curve in enumerate(panel.curves):
        name = curve.name if len(curve.name) <= _MOST_NAME else f"{curve.name[: _MOST_NAME - 1]}…"
        width = len(name) * _LETTER + 24
        if x > _LEFT and x + width > _LEFT + _WIDTH:
            x, y = _LEFT, y + _LINE
        yield y, _text(x, y, name, style=f"t{_colour(curve, number)}")
        x += width


def _panel(top: float, height: float, panel: Panel, span: tuple[float, float], mark: float | None) -> Iterator[str]:
    low, high = _limits([value for curve in panel.curves for _, value in curve.points if math.isfinite(value)])

    def x(time: float) -> float:
        return _LEFT + (time - span[0]) / (span[1] - span[0]) * _WIDTH

    def y(value: float) -> float:
        return top + (high / 2 - value / 2) / (high / 2 - low / 2) * height  # halves: the range itself may be too large

    yield f'<rect class="faint" x="{_LEFT}" y="{top:.1f}" width="{_WIDTH}" height="{height}" fill="none"/>'
    for value in ticks(low, high, 4):
        yield f'<line class="faint" x1="{_LEFT}" x2="{_LEFT + _WIDTH}" y1="{y(value):.1f}" y2="{y(value):.1f}"/>'
        yield _text(_LEFT - 6, y(value) + 4, _number(value), anchor="end")
    for time in ticks(*span, 8):
        yield f'<line class="faint" x1="{x(time):.1f}" x2="{x(time):.1f}" y1="{top:.1f}" y2="{top + height:.1f}"/>'
        yield _text(x(time), top + height + 16, _number(time), anchor="middle")
    if mark is not None and span[0] <= mark <= span[1]:
        yield f'<path class="mark" d="M{x(mark):.1f} {top:.1f}v{height}" stroke-dasharray="4"/>'
    for number, curve in enumerate(panel.curves):
        path = _path([(x(time), y(value)) for time, value in curve.points])
        if path:
            # A point alone is a line of no length, which round ends make a dot.
            yield f'<path class="line c{_colour(curve, number)}" d="{path}" stroke-linecap="round"/>'


def _colour(curve: Curve, number: int) -> int:
    return (number if curve.colour is None else curve.colour) % len(LIGHT)


def _limits(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values, default=0.0), max(values, default=0.0)
    room = max(high / 2 - low / 2, 0.0) * 0.08 or max(abs(high) * 0.05, 0.5)
    return max(low - room, -1.7e308), min(high + room, 1.7e308)


def _path(points: Sequence[Point]) -> str:
    words, begun = [], False
    for number, (x, y) in enumerate(points):
        if math.isfinite(y):
            words.append(f"{'L' if begun else 'M'}{x:.1f} {y:.1f}")
            alone = not begun and not (number + 1 < len(points) and math.isfinite(points[number + 1][1]))
            words += ["h0"] if alone else []
        begun = math.isfinite(y)
    return "".join(words)


def _text(x: float, y: float, text: str, *, anchor: str = "start", style: str = "ink") -> str:
    where = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return f'<text class="{style}" x="{x:.1f}" y="{y:.1f}"{where}>{words(text)}</text>'


def _number(value: float) -> str:
    return f"{value:.6g}" if abs(value) < 1e6 else f"{value:.3g}"


def _clean(text: str) -> str:
    return "".join(letter if letter.isprintable() else "\ufffd" for letter in text)
