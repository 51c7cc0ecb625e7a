"""`robo top`: a live view in the terminal."""

import math
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from rich import box
from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from robo.cli.connection import connect_to_robot
from robo.cli.link import Link, watched
from robo.cli.printing import data_size, print_json
from robo.cli.reach import Reach
from robo.cli.views.screen import Screen
from robo.text.durations import duration
from robo.text.terminal import visible
from robo.tools.top import NodeFigures, Snapshot, TopicFigures, Watch

T = TypeVar("T")

_STATES = {"ready": "green", "completed": "green", "starting": "cyan", "standby": "cyan", "failed": "bold red"}
_HEALTH = {"ok": "green", "warn": "yellow", "error": "bold red", "stale": "magenta"}
_WIDE = 110
"""From how many columns on there is room for everything."""
_WIDEST = 140
"""Beyond it numbers would stand too far from their names."""
_LOOK = 0.1
"""How often keys are looked at, s."""


def watch(reach: Reach, *, once: bool, json: bool, interval: float) -> None:
    """Show what runs until Ctrl-C or q; once, where that is asked."""
    with connect_to_robot(reach) as session:
        system = Watch(session, reach.namespace, max(reach.timeout, 0.2))
        try:
            if once:
                system.look()  # from here on processors are measured
                system.take_in(time.monotonic() + interval)
                _print(system.look(), json=json)
            elif json or not sys.stdout.isatty():
                with watched(session, reach):
                    while True:
                        system.take_in(time.monotonic() + interval)
                        _print(system.look(), json=json)
            else:
                _show(system, Link(session, reach), interval)
        finally:
            system.close()


def _print(snapshot: Snapshot, *, json: bool) -> None:
    if json:
        print_json(snapshot)
    else:
        console = Screen()
        console.print(render(snapshot, console.width, height=None))


def _show(system: Watch, link: Link, interval: float) -> None:
    console = Screen()
    with _keys() as pressed, Live(console=console, screen=True, auto_refresh=False) as display:
        snapshot = system.look()
        due = time.monotonic() + interval / 2  # something to see soon
        while True:
            link.look()
            display.update(render(snapshot, console.width, console.height, link.lost), refresh=True)
            while time.monotonic() < due:
                system.take_in(min(due, time.monotonic() + _LOOK))
                if next(pressed) in ("q", "Q"):
                    return
            snapshot = system.look()
            due = time.monotonic() + interval


@contextmanager
def _keys() -> Iterator[Iterator[str]]:
    """The keys that were pressed, one at a time and without waiting; empty where there was none."""
    if not sys.stdin.isatty():
        yield iter(lambda: "", None)
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield iter(lambda: sys.stdin.read(1) if select.select([descriptor], [], [], 0)[0] else "", None)
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def render(snapshot: Snapshot, width: int, height: int | None, lost: str = "") -> RenderableType:
    """A picture of a look, as wide and, where a height is given, no higher than a terminal; `lost` stands first."""
    stale = sum(topic.stale for topic in snapshot.topics)
    head = Text(no_wrap=True, overflow="ellipsis")
    if lost:
        head.append(f"{lost}  ", style="bold red")
    head.append(time.strftime("%H:%M:%S", time.localtime(snapshot.time / 1e9)), style="bold")
    head.append(f"  {len(snapshot.nodes)} nodes  {len(snapshot.topics)} topics")
    head.append(f"  {sum(topic.rate for topic in snapshot.topics):.0f} messages/s")
    head.append(f"  {data_size(sum(topic.bandwidth for topic in snapshot.topics), 'B/s')}")
    if stale:
        head.append(f"  {stale} stale", style="bold red")
    node_rows, topic_rows = len(snapshot.nodes), len(snapshot.topics)
    troubled = [node for node in snapshot.nodes if node.trouble]
    if height is not None:
        told = min(len(troubled), max(height // 5, 1))
        troubled = _worst_first(troubled)[:told]
        node_rows, topic_rows = shares(height - 5 - told, node_rows, topic_rows)
    width = min(width, _WIDEST)
    nodes, topics = _nodes(snapshot.nodes, node_rows, width), _topics(snapshot.topics, topic_rows, width)
    return Group(head, nodes, *map(_trouble, troubled), topics)


def _worst_first(nodes: Sequence[NodeFigures]) -> list[NodeFigures]:
    """Those with something wrong before the others; of as much, in their order."""
    worst = ["stale", "error", "warn"]
    return sorted(nodes, key=lambda node: worst.index(node.health) if node.health in worst else len(worst))


def _trouble(node: NodeFigures) -> Text:
    """A line on the worst check of a node, cut where there is no room."""
    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(f"{(node.health or '').upper()} ", style=_HEALTH.get(node.health or "", ""))
    text.append(visible(f"{node.node}  {node.trouble}"))
    return text


def shares(lines: int, first: int, second: int) -> tuple[int, int]:
    """How many lines two tables get: each at most what it needs, half of all where both need more."""
    lines = max(lines, 2)
    if first + second <= lines:
        return first, second
    half = lines // 2
    if first <= half:
        return first, lines - first
    return (lines - second, second) if second <= lines - half else (half, lines - half)


def _table(width: int, *columns: str) -> Table:
    """The first column gives way where there is little room; the others are numbers and short words."""
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, width=width, padding=(0, 1, 0, 0))
    for number, name in enumerate(columns):
        if number == 0:
            table.add_column(name, no_wrap=True, overflow="ellipsis", ratio=1)
        else:
            table.add_column(name, no_wrap=True, justify="left" if name in ("STATE", "HEALTH", "TYPE") else "right")
    return table


def _rows(table: Table, rows: Sequence[tuple[RenderableType, ...]], most: int) -> Table:
    cut = len(rows) > most
    for row in rows[: max(most - 1, 0)] if cut else rows:
        table.add_row(*row)
    if cut:
        table.add_row(Text(f"… {len(rows) - max(most - 1, 0)} more", style="dim"))
    return table


def _nodes(nodes: Sequence[NodeFigures], most: int, width: int) -> Table:
    wide = width >= _WIDE
    more = ("UPTIME", "PID", "HOST") if wide else ()
    table = _table(width, "NODE", "STATE", "HEALTH", "CPU", "MEMORY", "RESTARTS", *more)
    rows: list[tuple[RenderableType, ...]] = []
    # Where not all have room, those with something wrong come first.
    if len(nodes) > most:
        nodes = sorted(_worst_first(nodes), key=lambda node: node.state == "ready" and not node.running)
    for node in nodes:
        held = f", in {node.running} for {duration(node.running_for)}" if node.running else ""
        state = Text(node.state + held, style="yellow" if held else _STATES.get(node.state, "yellow"))
        health = Text((node.health or "-").upper(), style=_HEALTH.get(node.health or "", "dim"))
        restarts = Text(_or_dash(node.restarts, str), style="yellow" if node.restarts else "")
        figures = (_or_dash(node.uptime, duration), _or_dash(node.pid, str), _word(node.host)) if wide else ()
        cpu = _or_dash(node.cpu, lambda value: f"{value:.1f}%")
        rows.append((_word(node.node), state, health, cpu, _or_dash(node.memory, data_size), restarts, *figures))
    return _rows(table, rows, most)


def _topics(topics: Sequence[TopicFigures], most: int, width: int) -> Table:
    wide = width >= _WIDE
    table = _table(width, "TOPIC", *(("TYPE", "PUB", "SUB") if wide else ()), "RATE", "AGE", "BANDWIDTH", "LOST")
    rows: list[tuple[RenderableType, ...]] = []
    for topic in sorted(topics, key=lambda topic: not topic.stale) if len(topics) > most else topics:
        kind = Text(visible(" ≠ ".join(topic.types)) or "-", style="red" if len(topic.types) > 1 else "")
        more = (kind, str(topic.publishers), str(topic.subscribers)) if wide else ()
        age = Text(_or_dash(topic.age, _age), style="bold red" if topic.stale else "")
        lost = Text(str(topic.lost), style="yellow" if topic.lost else "dim")
        rows.append((_word(topic.key), *more, f"{topic.rate:.1f} Hz", age, data_size(topic.bandwidth, "B/s"), lost))
    return _rows(table, rows, most)


def _word(text: str) -> Text:
    """What others say: in one line, and with brackets as they are."""
    return Text(visible(text))


def _age(seconds: float) -> str:
    return f"{seconds * 1e3:.0f} ms" if seconds < 1 else duration(math.floor(seconds * 10) / 10)


def _or_dash(value: T | None, show: Callable[[T], str]) -> str:
    return "-" if value is None else show(value)
