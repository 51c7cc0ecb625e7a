"""The graph of nodes, topics, services and actions as a picture: SVG without a library. Pure."""

from collections.abc import Iterator
from typing import NamedTuple

from robo.text.graph import Graph
from robo.text.layers import Box, Name, layout
from robo.text.svg import Theme, columns, document, in_themes, shortened, words

_LETTER, _SMALL = 7.6, 6.4
"""Width of a letter of a name and of a type, pixels: enough for most fonts."""
_MARGIN, _TOP = 20.0, 44.0
_MOST = 48
"""Letters of a line."""


class _Thing(NamedTuple):
    """A node, a topic, a service or an action."""

    kind: str
    name: str
    lines: list[str]
    """Below its name."""
    problems: list[str]


def graph_svg(graph: Graph, title: str, theme: Theme = "auto") -> str:
    """The graph as a picture; what is wrong is red, and said."""
    things = {(thing.kind, thing.name): thing for thing in _things(graph)}
    lines = list(_lines(graph))
    sizes: dict[Name, tuple[float, float]] = {key: _size(thing) for key, thing in things.items()}
    placed = layout(sizes, [(first, last) for first, last, _ in lines])
    parts = [
        '<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8"'
        ' orient="auto-start-reverse"><path class="arrowhead" d="M0 0L8 4L0 8z"/></marker></defs>',
        f'<g transform="translate({_MARGIN:.0f} {_TOP:.0f})">',
        *(_arrow(route, style) for route, (_, _, style) in zip(placed.arrows, lines, strict=True)),
        *(_drawn(things[key], box) for key, box in placed.boxes.items() if isinstance(key, tuple)),
        "</g>",
    ]
    width, height = max(placed.width, 240.0) + 2 * _MARGIN, placed.height + _TOP + _MARGIN
    return document(title, width, height, parts, theme, _style(theme))


def _things(graph: Graph) -> Iterator[_Thing]:
    known = {node.name for node in graph.nodes}
    for node in graph.nodes:
        yield _Thing("node", node.name, [(node.class_name or "a command").rpartition(":")[2]], [])
    ends = [name for topic in graph.topics for name in (*topic.publishers, *topic.subscribers)]
    ends += [name for served in (*graph.services, *graph.actions) for name in (*served.servers, *served.clients)]
    for name in sorted({*ends} - known):
        yield _Thing("node", name, [], [])
    for topic in graph.topics:
        yield _Thing("topic", topic.key, [" / ".join(topic.types)], topic.problems)
    for kind, several in (("service", graph.services), ("action", graph.actions)):
        for one in several:
            yield _Thing(kind, one.key, [" / ".join(one.types)], one.problems)


_End = tuple[str, str]


def _lines(graph: Graph) -> Iterator[tuple[_End, _End, str]]:
    """Each arrow: from where to where, and what it looks like."""
    for topic in graph.topics:
        here = ("topic", topic.key)
        for name in topic.publishers:
            yield ("node", name), here, "data"
        for name in topic.subscribers:
            yield here, ("node", name), "data"
    for kind, several in (("service", graph.services), ("action", graph.actions)):
        for one in several:
            for name in one.clients:
                yield ("node", name), (kind, one.key), kind
            for name in one.servers:
                yield (kind, one.key), ("node", name), kind


def _size(thing: _Thing) -> tuple[float, float]:
    below = [line for line in (*thing.lines, *thing.problems) if line]
    width = max(60.0, columns(_cut(thing.name)) * _LETTER, *(columns(_cut(line)) * _SMALL for line in below))
    return width + 24, 22.0 + 14.0 * len(below)


def _drawn(thing: _Thing, box: Box) -> str:
    style = f"{thing.kind} wrong" if thing.problems else thing.kind
    round_ = {"node": 4.0, "topic": min(box.height / 2, 16.0), "service": 0.0, "action": 0.0}[thing.kind]
    middle = box.x + box.width / 2
    parts = [
        f"<g><title>{words(thing.name)}</title>",
        f'<rect class="{style}" x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" height="{box.height:.1f}"'
        f' rx="{round_:.0f}"/>',
        f'<text class="ink" x="{middle:.1f}" y="{box.y + 15:.1f}" text-anchor="middle">'
        f"{words(_cut(thing.name))}</text>",
    ]
    y = box.y + 29
    for lines, look in ((thing.lines, "small"), (thing.problems, "small said")):
        for line in filter(None, lines):
            parts.append(
                f'<text class="{look}" x="{middle:.1f}" y="{y:.1f}" text-anchor="middle">{words(_cut(line))}</text>'
            )
            y += 14
    return "".join(parts) + "</g>"


def _arrow(route: list[tuple[float, float]], style: str) -> str:
    """A line that leaves and arrives level, and is straight where it passes through its places."""
    x, y = route[0]
    path = f"M{x:.1f} {y:.1f}"
    for number, (to_x, to_y) in enumerate(route[1:]):
        if number % 2 == 0:
            middle = (x + to_x) / 2
            path += f"C{middle:.1f} {y:.1f} {middle:.1f} {to_y:.1f} {to_x:.1f} {to_y:.1f}"
        else:
            path += f"L{to_x:.1f} {to_y:.1f}"
        x, y = to_x, to_y
    return f'<path class="arrow {style}" d="{path}" marker-end="url(#head)"/>'


def _cut(text: str) -> str:
    return shortened(text, _MOST)


def _style(theme: Theme) -> str:
    def rules(node: str, topic: str, rim: str, line: str, small: str, red: str) -> str:
        return (
            f"rect.node{{fill:{node};stroke:{rim}}}rect.topic,rect.service,rect.action{{fill:{topic};stroke:{rim}}}"
            f".arrow{{fill:none;stroke:{line}}}.arrowhead{{fill:{line}}}.small{{fill:{small}}}"
            f"rect.wrong{{stroke:{red};stroke-width:2}}.said{{fill:{red}}}"
        )

    both = ".small{font-size:11px}.arrow.service{stroke-dasharray:5 3}.arrow.action{stroke-width:2}"
    light = rules("#dbe7ff", "#ffffff", "#57606a", "#6e7781", "#57606a", "#c8281e")
    dark = rules("#1f3a63", "#12161c", "#8b949e", "#8b949e", "#9aa4af", "#ff7b72")
    return both + in_themes(theme, light, dark)
