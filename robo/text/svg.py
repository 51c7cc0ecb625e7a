"""Two lines over time as a picture, and how far they are apart below: SVG without a library. Pure."""

import math
from collections.abc import Sequence
from html import escape

Point = tuple[float, float]
"""Time (s) and value."""

_WIDTH, _HEIGHT, _GAP = 800, 260, 70
_LEFT, _TOP = 90, 50
_COLOURS = ("#1f77b4", "#d62728", "#555555")


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
    times = [time for time, _ in (*first, *second)] or [0.0]
    span = min(times), max(max(times), min(times) + 1e-9)
    height = _TOP + 2 * _HEIGHT + _GAP + 50
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_LEFT + _WIDTH + 20} {height}"'
        ' font-family="sans-serif" font-size="13">',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<text x="{_LEFT}" y="20" font-size="16">{escape(title)}</text>',
        *(
            f'<text x="{_LEFT + 200 * number}" y="40" fill="{_COLOURS[number]}">{escape(name)}</text>'
            for number, name in enumerate(names)
        ),
        *_panel(_TOP, [first, second], _COLOURS[:2], span, mark),
        f'<text x="{_LEFT}" y="{_TOP + _HEIGHT + _GAP - 10}" fill="{_COLOURS[2]}">difference</text>',
        *_panel(_TOP + _HEIGHT + _GAP, [apart], _COLOURS[2:], span, mark),
        f'<text x="{_LEFT + _WIDTH}" y="{height - 10}" text-anchor="end">s since the first message</text>',
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _panel(
    top: int, series: Sequence[Sequence[Point]], colours: Sequence[str], span: tuple[float, float], mark: float
) -> list[str]:
    values = [value for points in series for _, value in points if math.isfinite(value)] or [0.0]
    low, high = min(values), max(values)
    if high - low < 1e-300:
        low, high = low - max(abs(low) * 0.05, 0.5), high + max(abs(high) * 0.05, 0.5)

    def x(time: float) -> float:
        return _LEFT + (time - span[0]) / (span[1] - span[0]) * _WIDTH

    def y(value: float) -> float:
        return top + (high - value) / (high - low) * _HEIGHT

    drawn = [f'<rect x="{_LEFT}" y="{top}" width="{_WIDTH}" height="{_HEIGHT}" fill="none" stroke="#bbbbbb"/>']
    for value in (high, (high + low) / 2, low):
        drawn.append(f'<text x="{_LEFT - 6}" y="{y(value) + 4:.1f}" text-anchor="end">{value:.5g}</text>')
    for time in (span[0], (span[0] + span[1]) / 2, span[1]):
        drawn.append(f'<text x="{x(time):.1f}" y="{top + _HEIGHT + 16}" text-anchor="middle">{time:.5g}</text>')
    if span[0] <= mark <= span[1]:
        drawn.append(f'<path d="M{x(mark):.1f} {top}v{_HEIGHT}" stroke="#999999" stroke-dasharray="4"/>')
    for points, colour in zip(series, colours, strict=True):
        path = _path([(x(time), y(value)) for time, value in points])
        if path:
            drawn.append(f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
    return drawn


def _path(points: Sequence[Point]) -> str:
    words, begun = [], False
    for x, y in points:
        if math.isfinite(y):
            words.append(f"{'L' if begun else 'M'}{x:.1f} {y:.1f}")
        begun = math.isfinite(y)
    return "".join(words)
