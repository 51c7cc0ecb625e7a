"""Where the boxes of a drawing stand, in columns, so that none lies on another and arrows go round them. Pure.

Boxes are put into columns so that most arrows go to the right; an arrow over several columns has a place of its own in
each; the order within columns is that of the neighbours, again and again (after Sugiyama).
"""

from bisect import bisect_right, insort
from collections import Counter, deque
from collections.abc import Hashable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

_SWEEPS = 12
_ROW_GAP, _COLUMN_GAP = 14.0, 64.0
_LANE = 6.0
"""Height of the place of an arrow that passes by."""
_PORTS = 8.0
"""From the middle of a side to where arrows begin or end that go both ways."""

Name = Hashable


class Box(NamedTuple):
    """Where something stands: its left upper corner and its size, pixels."""

    x: float
    y: float
    width: float
    height: float


class Layout(NamedTuple):
    """A drawing."""

    boxes: dict[Name, Box]
    arrows: list[list[tuple[float, float]]]
    """For each arrow, in their order, the points through which it goes; at the last one is its head."""
    width: float
    height: float


class _Lane(NamedTuple):
    """The place of an arrow in a column where it passes by."""

    arrow: int
    column: int


def layout(sizes: Mapping[Name, tuple[float, float]], arrows: Sequence[tuple[Name, Name]]) -> Layout:
    """Place boxes and arrows.

    Args:
        sizes: width and height of each box, pixels.
        arrows: from which box to which; both are in `sizes`.
    """
    forward = _without_cycles(list(sizes), arrows)
    column_of = _columns(list(sizes), forward)
    columns: list[list[Name]] = [[] for _ in range(max(column_of.values(), default=-1) + 1)]
    for name in sizes:
        columns[column_of[name]].append(name)
    chains: list[list[Name]] = []
    for number, (first, last) in enumerate(forward):
        passed: list[Name] = [_Lane(number, column) for column in range(column_of[first] + 1, column_of[last])]
        for lane in passed:
            assert isinstance(lane, _Lane)
            columns[lane.column].append(lane)
        chains.append([first, *passed, last])
    columns = _ordered(columns, chains)
    every = dict(sizes)
    every.update((one, (0.0, _LANE)) for column in columns for one in column if isinstance(one, _Lane))
    boxes = _placed(columns, every, chains)
    backwards = [chain[0] != begin for (begin, _), chain in zip(arrows, chains, strict=True)]
    ports = _ports(chains, backwards, boxes)
    routes = []
    for chain, back in zip(chains, backwards, strict=True):
        points = _route(chain, back, boxes, ports)
        routes.append(points[::-1] if back else points)
    shown = {name: boxes[name] for name in sizes}
    width = max((box.x + box.width for box in boxes.values()), default=0.0)
    height = max((box.y + box.height for box in boxes.values()), default=0.0)
    return Layout(shown, routes, width, height)


def _without_cycles(names: Sequence[Name], arrows: Sequence[tuple[Name, Name]]) -> list[tuple[Name, Name]]:
    """The same arrows; those that close a circle are turned round."""
    after: dict[Name, list[tuple[int, Name]]] = {name: [] for name in names}
    for number, (first, last) in enumerate(arrows):
        after[first].append((number, last))
    incoming = Counter(last for _, last in arrows)
    turned: set[int] = set()
    state: dict[Name, int] = {}
    for root in sorted(names, key=lambda name: incoming[name]):  # a source of data is at the left
        if root in state:
            continue
        state[root] = 1
        stack = [(root, iter(after[root]))]
        while stack:
            here, rest = stack[-1]
            step = next(rest, None)
            if step is None:
                state[here] = 2
                stack.pop()
                continue
            number, there = step
            if state.get(there) == 1:
                turned.add(number)
            elif there not in state:
                state[there] = 1
                stack.append((there, iter(after[there])))
    return [(last, first) if number in turned else (first, last) for number, (first, last) in enumerate(arrows)]


def _columns(names: Sequence[Name], arrows: Sequence[tuple[Name, Name]]) -> dict[Name, int]:
    """For each box its column: behind all from which arrows come, and not further left of its next than need be."""
    before: dict[Name, list[Name]] = {name: [] for name in names}
    after: dict[Name, list[Name]] = {name: [] for name in names}
    for first, last in arrows:
        if first != last:
            before[last].append(first)
            after[first].append(last)
    found: dict[Name, int] = {}
    left = {name: len(before[name]) for name in names}
    ready = deque(name for name in names if not left[name])
    order = []
    while ready:
        name = ready.popleft()
        order.append(name)
        found[name] = max((found[one] + 1 for one in before[name]), default=0)
        for one in after[name]:
            left[one] -= 1
            if not left[one]:
                ready.append(one)
    for name in reversed(order):
        if after[name] and not before[name]:
            found[name] = max(found[name], min(found[one] for one in after[name]) - 1)
    return found


def _ordered(columns: list[list[Name]], chains: Sequence[Sequence[Name]]) -> list[list[Name]]:
    left: dict[Name, list[Name]] = {}
    right: dict[Name, list[Name]] = {}
    for chain in chains:
        for first, second in pairwise(chain):
            right.setdefault(first, []).append(second)
            left.setdefault(second, []).append(first)
    best, least = columns, _crossings(columns, right)
    for sweep in range(_SWEEPS):
        beside = left if sweep % 2 == 0 else right
        now = [list(column) for column in columns]
        for index in range(len(now)) if sweep % 2 == 0 else reversed(range(len(now))):
            other = index - 1 if sweep % 2 == 0 else index + 1
            if 0 <= other < len(now):
                places = {name: place for place, name in enumerate(now[other])}
                now[index] = _by_neighbours(now[index], places, beside)
        columns = now
        crossed = _crossings(columns, right)
        if crossed < least:
            best, least = columns, crossed
    return best


def _by_neighbours(
    column: Sequence[Name], places: Mapping[Name, int], beside: Mapping[Name, Sequence[Name]]
) -> list[Name]:
    def middle(item: tuple[int, Name]) -> float:
        own, name = item
        there = [places[one] for one in beside.get(name, ()) if one in places]
        return sum(there) / len(there) if there else own * len(places) / max(len(column), 1)

    return [name for _, name in sorted(enumerate(column), key=middle)]


def _crossings(columns: Sequence[Sequence[Name]], right: Mapping[Name, Sequence[Name]]) -> int:
    """How many pairs of arrows cross."""
    count = 0
    for first, second in pairwise(columns):
        places = {name: place for place, name in enumerate(second)}
        ends: list[int] = []
        for name in first:
            ends += sorted(places[one] for one in right.get(name, ()) if one in places)
        seen: list[int] = []
        for end in ends:
            count += len(seen) - bisect_right(seen, end)
            insort(seen, end)
    return count


def _placed(
    columns: Sequence[Sequence[Name]], sizes: Mapping[Name, tuple[float, float]], chains: Sequence[Sequence[Name]]
) -> dict[Name, Box]:
    beside: dict[Name, list[Name]] = {}
    for chain in chains:
        for first, second in pairwise(chain):
            beside.setdefault(first, []).append(second)
            beside.setdefault(second, []).append(first)
    middles: dict[Name, float] = {}
    for column in columns:
        at = 0.0
        for name in column:
            middles[name] = at + sizes[name][1] / 2
            at += sizes[name][1] + _ROW_GAP
    for _ in range(_SWEEPS):
        for column in columns:
            _pull(column, sizes, middles, beside)
    top = min((middles[name] - sizes[name][1] / 2 for name in middles), default=0.0)
    boxes: dict[Name, Box] = {}
    x = 0.0
    for column in columns:
        width = max((sizes[name][0] for name in column), default=0.0)
        for name in column:
            own, height = sizes[name]
            wide = width if isinstance(name, _Lane) else own
            boxes[name] = Box(x + (width - wide) / 2, middles[name] - height / 2 - top, wide, height)
        x += width + _COLUMN_GAP
    return boxes


def _pull(
    column: Sequence[Name],
    sizes: Mapping[Name, tuple[float, float]],
    middles: dict[Name, float],
    beside: Mapping[Name, Sequence[Name]],
) -> None:
    """Move the boxes of a column towards their neighbours, as far as those above and below let them."""
    wanted = []
    for name in column:
        there = [middles[one] for one in beside.get(name, ())]
        wanted.append(sum(there) / len(there) if there else middles[name])
    down: list[float] = []
    for name, middle in zip(column, wanted, strict=True):
        least = down[-1] + _apart(column[len(down) - 1], name, sizes) if down else middle
        down.append(max(middle, least))
    up: list[float] = []
    for back in range(len(column) - 1, -1, -1):
        most = up[-1] - _apart(column[back], column[back + 1], sizes) if up else wanted[back]
        up.append(min(wanted[back], most))
    for name, low, high in zip(column, down, reversed(up), strict=True):
        middles[name] = (low + high) / 2  # both keep the distances, and so does what is between them


def _apart(first: Name, second: Name, sizes: Mapping[Name, tuple[float, float]]) -> float:
    return sizes[first][1] / 2 + _ROW_GAP + sizes[second][1] / 2


_Port = tuple[Name, int, bool]
"""Of a box, its left (0) or right (1) side; whether arrows there run backwards."""


def _ports(
    chains: Sequence[Sequence[Name]], backwards: Sequence[bool], boxes: Mapping[Name, Box]
) -> dict[_Port, float]:
    """At which heights arrows begin and end: where some of a side run backwards, these have their own.

    Else the head of one lay on the tail of another, and both looked like one arrow with two heads.
    """
    used: set[_Port] = set()
    for chain, back in zip(chains, backwards, strict=True):
        used |= {(chain[0], 1, back), (chain[-1], 0, back)}
    found: dict[_Port, float] = {}
    for name, side, back in used:
        box = boxes[name]
        apart = min(box.height / 4, _PORTS) if (name, side, not back) in used else 0.0
        found[name, side, back] = box.y + box.height / 2 + (apart if back else -apart)
    return found


def _route(
    chain: Sequence[Name], back: bool, boxes: Mapping[Name, Box], ports: Mapping[_Port, float]
) -> list[tuple[float, float]]:
    points = []
    for place, name in enumerate(chain):
        box = boxes[name]
        middle = box.y + box.height / 2
        if place > 0:
            points.append((box.x, ports.get((name, 0, back), middle)))
        if place < len(chain) - 1:
            points.append((box.x + box.width, ports.get((name, 1, back), middle)))
    return points
