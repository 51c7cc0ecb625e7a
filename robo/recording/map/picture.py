"""A way and what was hit, drawn: SVG or PNG. Pure."""

import base64
import math
from collections.abc import Callable
from typing import NamedTuple

from robo.recording.map.cells import Grid
from robo.recording.map.walk import Walk
from robo.text.canvas import Canvas
from robo.text.png import Colour, png
from robo.text.svg import DARK, LIGHT, Theme, document, in_themes, words

_SIDE = 900
"""Of the drawing's longer side, pixels, about."""
_LEAST_WIDTH = 480
_LEFT, _TOP, _BELOW = 20, 40, 64
_SHADES = 8
_START, _END = ("#23863a", "#7ee787"), ("#c8281e", "#ff7b72")
"""Of the first and the last place, on light and on dark paper."""


class _Shape(NamedTuple):
    """How places become pixels of the drawing."""

    grid: Grid
    scale: float
    """Pixels of a cell."""

    @property
    def width(self) -> float:
        return self.grid.width * self.scale

    @property
    def height(self) -> float:
        return self.grid.height * self.scale

    def at(self, x: float, y: float) -> tuple[float, float]:
        per = self.scale / self.grid.resolution
        return (x - self.grid.left) * per, (self.grid.top - y) * per

    @property
    def bar(self) -> float:
        """Length of the scale bar, m: round, and at most a quarter of the drawing."""
        metres = max(self.width, _LEAST_WIDTH) * self.grid.resolution / self.scale / 4
        power = 10.0 ** math.floor(math.log10(metres))
        return next(n * power for n in (5, 2, 1) if n * power <= metres)


def as_svg(walk: Walk, title: str, theme: Theme) -> str:
    """The picture as SVG: what was hit is a picture of few colours within it, so that its size is bounded."""
    grid = walk.cells.grid(walk.track)
    shape = _Shape(grid, _SIDE / max(grid.width, grid.height, 1))
    palette: list[Colour] = [(0, 0, 0, 0), *((30, 41, 54, 70 + 185 * n // (_SHADES - 1)) for n in range(_SHADES))]
    pixels = bytearray(grid.width * grid.height)
    _shade(grid, lambda column, row, shade: pixels.__setitem__(row * grid.width + column, shade + 1))
    data = base64.b64encode(png(grid.width, grid.height, pixels, palette)).decode()
    width = max(shape.width, _LEAST_WIDTH)
    parts = [
        f'<g transform="translate({_LEFT} {_TOP})">',
        f'<image class="hits" width="{shape.width:.1f}" height="{shape.height:.1f}"'
        f' href="data:image/png;base64,{data}"/>',
        *_track_as_svg(walk, shape),
        "</g>",
        *_foot_as_svg(walk, shape, _TOP + shape.height),
    ]
    dark = f".hits{{filter:invert(1) hue-rotate(180deg)}}.begin{{fill:{_START[1]}}}.finish{{fill:{_END[1]}}}"
    light = f".begin{{fill:{_START[0]}}}.finish{{fill:{_END[0]}}}"
    style = ".hits{image-rendering:pixelated}" + in_themes(theme, light, dark)
    return document(title, width + 2 * _LEFT, _TOP + shape.height + _BELOW, parts, theme, style)


def as_png(walk: Walk, theme: Theme) -> bytes:
    """The picture in pixels, without words; `auto` is light."""
    grid = walk.cells.grid(walk.track)
    each = max(1, _SIDE // max(grid.width, grid.height, 1))
    shape = _Shape(grid, each)
    paper, ink, which = ("#12161c", "#e6edf3", 1) if theme == "dark" else ("#ffffff", "#24292f", 0)
    shades = [_mixed(paper, ink, 0.28 + 0.72 * n / (_SHADES - 1)) for n in range(_SHADES)]
    line = (LIGHT, DARK)[which][0]
    palette = [_opaque(one) for one in (paper, ink, line, _START[which], _END[which])] + shades
    margin, below = 12, 40
    canvas = Canvas(max(int(shape.width), 200) + 2 * margin, int(shape.height) + margin + below)
    _shade(grid, lambda x, y, shade: canvas.block(margin + x * each, margin + y * each, each, each, 5 + shade))
    places = [(margin + x, margin + y) for x, y in (shape.at(*place) for place in walk.track)]
    canvas.lines(places, 2, 2)
    if places:
        canvas.disc(*places[0], 8, 3)
        canvas.disc(*places[-1], 5, 4)
    bar, y = shape.bar, canvas.height - 18
    canvas.block(margin, y, round(bar / grid.resolution * each), 3, 1)
    canvas.text(margin + round(bar / grid.resolution * each) + 10, y - 7, _metres(bar), 1)
    return png(canvas.width, canvas.height, canvas.pixels, palette)


def facts(walk: Walk) -> str:
    """What is drawn, in words."""
    seen = f"{walk.scans:,} scan{'' if walk.scans == 1 else 's'}, {walk.cells.hits:,} points; " if walk.scans else ""
    return f"{seen}{walk.length:,.1f} m driven, {walk.frames.poses or f'in frame {walk.frames.fixed}'}"


def _track_as_svg(walk: Walk, shape: _Shape) -> list[str]:
    if not walk.track:
        return []
    places = [shape.at(*place) for place in walk.track]
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
    (x0, y0), (x1, y1) = places[0], places[-1]
    return [
        f'<path class="line c0" d="{path}" stroke-linecap="round"/>',
        f'<circle class="begin" cx="{x0:.1f}" cy="{y0:.1f}" r="8"/>',  # seen around the end, where both are one place
        f'<circle class="finish" cx="{x1:.1f}" cy="{y1:.1f}" r="5"/>',
    ]


def _foot_as_svg(walk: Walk, shape: _Shape, top: float) -> list[str]:
    length = shape.bar / shape.grid.resolution * shape.scale
    x, y = float(_LEFT), top + 22
    middle = x + length + 10 + 10 * len(_metres(shape.bar)) + 16
    return [
        f'<path class="mark" d="M{x:.1f} {y - 5:.1f}v5h{length:.1f}v-5" fill="none" stroke-width="2"/>',
        f'<text class="ink" x="{x + length + 10:.1f}" y="{y:.1f}">{_metres(shape.bar)}</text>',
        f'<circle class="begin" cx="{middle:.1f}" cy="{y - 4:.1f}" r="8"/>',
        f'<text class="ink" x="{middle + 13:.1f}" y="{y:.1f}">start</text>',
        f'<circle class="finish" cx="{middle + 65:.1f}" cy="{y - 4:.1f}" r="5"/>',
        f'<text class="ink" x="{middle + 75:.1f}" y="{y:.1f}">end</text>',
        f'<text class="ink" x="{x:.1f}" y="{y + 24:.1f}">{words(facts(walk))}</text>',
    ]


def _shade(grid: Grid, draw: Callable[[int, int, int], None]) -> None:
    """Tell for each place that was hit how dark it is, from 0: by how often, for walls are hit again and again."""
    often = sorted(grid.counts.values())
    most = math.log1p(often[len(often) * 9 // 10]) if often else 1.0
    for (column, row), count in grid.counts.items():
        draw(column, row, min(round(math.log1p(count) / most * (_SHADES - 1)), _SHADES - 1))


def _metres(length: float) -> str:
    return f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"


def _opaque(text: str) -> Colour:
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16), 255


def _mixed(first: str, second: str, part: float) -> Colour:
    a, b = _opaque(first), _opaque(second)
    red, green, blue = (round(x + (y - x) * part) for x, y in zip(a[:3], b[:3], strict=True))
    return red, green, blue, 255
