"""Summing up what nodes say of how well they do: for each node, for each namespace, for all. Pure.

A status is named `/r1/base: battery`, node and check; it is summed up under the path `/r1/base/battery`, below
`/r1/base`, below `/r1`: what ROS's diagnostic_aggregator makes of it, and what viewers draw as a tree.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import msgspec

from robo_messages import DiagnosticStatus, KeyValue

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
LEVELS = ("OK", "WARN", "ERROR", "STALE")

MOST_STATUSES = 1000
"""No more are kept: anybody may publish any name."""

MOST_VALUES = 100
"""A status that sums up others names no more of them."""

WHOLE = frozenset({"topics", "callbacks"})
"""A report that has these checks of a node has all of its checks: those that it had before are no more."""


class Place(NamedTuple):
    """Whose check it is."""

    node: str
    """Its path: `/r1/base`."""
    check: str
    """Empty where a status speaks of the node as a whole."""

    @property
    def path(self) -> str:
        """The path of the check."""
        return f"{self.node}/{self.check}" if self.check else self.node


def place_of(name: str, namespace: str) -> Place:
    """The place of a status by its name.

    Args:
        name: `/r1/base: battery`, or what others write: `lidar: link`, `Battery`.
        namespace: where a name stands that does not begin with `/`, without outer slashes.
    """
    node, _, check = name.partition(": ")
    inner = "/".join(part for part in node.strip().split("/") if part) or "unnamed"
    around = "" if node.startswith("/") else namespace.strip("/")
    path = "/" + "/".join(part for part in (around, inner) if part)
    # A path has a slash where something stands below something else, and nowhere else.
    return Place(path, check.replace("/", " ").strip())


class _Kept(NamedTuple):
    status: DiagnosticStatus
    said: float
    """When, s by the receiver's monotonic clock."""


class Ledger:
    """What was said last of each check. Times are s by one monotonic clock."""

    def __init__(self) -> None:
        self._kept: dict[Place, _Kept] = {}
        self.left_out = 0
        """Statuses for which there was no room."""

    def take(self, statuses: Sequence[DiagnosticStatus], namespace: str, said: float) -> None:
        """Take in a report.

        Args:
            statuses: what it says.
            namespace: where it was said, for names that are not absolute.
            said: when; -inf where that is not known.
        """
        came = {place_of(one.name, namespace): one for one in statuses}
        checks: dict[str, set[str]] = {}
        for place in came:
            checks.setdefault(place.node, set()).add(place.check)
        whole = {node for node, there in checks.items() if there >= WHOLE}
        for gone in [place for place in self._kept if place.node in whole and place not in came]:
            del self._kept[gone]
        for place, status in came.items():
            before = self._kept.get(place)
            if before is None and len(self._kept) >= MOST_STATUSES:
                self.left_out += 1
            elif before is None or said >= before.said:
                self._kept[place] = _Kept(status, said)

    def forget(self, before: float) -> None:
        """Drop what was said before that time."""
        self._kept = {place: kept for place, kept in self._kept.items() if kept.said >= before}

    def present(self, now: float, timeout: float) -> dict[Place, DiagnosticStatus]:
        """All checks; those of which nothing was said for longer than `timeout` s are stale."""
        return {place: _judged(kept, now, timeout) for place, kept in self._kept.items()}


def _judged(kept: _Kept, now: float, timeout: float) -> DiagnosticStatus:
    silent = now - kept.said
    if silent <= timeout:
        return kept.status
    told = f"has said nothing for {silent:.0f} s" if silent < math.inf else "has said nothing of a known age"
    return msgspec.structs.replace(kept.status, level=STALE, message=told)


def summed_up(present: Mapping[Place, DiagnosticStatus]) -> list[DiagnosticStatus]:
    """Every check by its path, and above it every node and every namespace, sorted by path.

    What stands above others is as bad as the worst of them. It is stale only where all of them are, else what is stale
    counts as an error, as in ROS.
    """
    found = {place.path: msgspec.structs.replace(status, name=place.path) for place, status in present.items()}
    below: dict[str, dict[str, DiagnosticStatus]] = {above: {} for path in found for above in _above(path)}
    for path in sorted({*found, *below}, key=lambda path: (-path.count("/"), path)):
        children = below.get(path, {})
        if children:
            own = found.get(path)
            found[path] = _over(path, {"": own, **children} if own is not None else children)
        parent, _, label = path.rpartition("/")
        if parent in below:
            below[parent][label] = found[path]
    return [found[path] for path in sorted(found)]


def _above(path: str) -> Iterator[str]:
    while path := path.rpartition("/")[0]:
        yield path


def _over(path: str, children: Mapping[str, DiagnosticStatus]) -> DiagnosticStatus:
    level = together(child.level for child in children.values())
    worst_label = max(children, key=lambda label: children[label].level)
    worst = children[worst_label]
    message = "OK" if level == OK else f"{worst_label}: {worst.message}" if worst_label else worst.message
    values = [KeyValue(label, child.message or LEVELS[child.level]) for label, child in children.items()]
    return DiagnosticStatus(level, path, message, values=values[:MOST_VALUES])


def together(levels: Iterable[int]) -> int:
    """The level of several things together."""
    there = list(levels)
    if not there or min(there) == STALE:
        return STALE
    return ERROR if max(there) == STALE else max(there)


class State(NamedTuple):
    """What all checks come to."""

    level: int
    bad: tuple[tuple[str, int], ...]
    """The checks that are not well, by path, with their levels; where a whole node is silent, that one alone."""
    total: int
    """How many checks there are."""
    message: str
    """The worst of it."""


def state_of(present: Mapping[Place, DiagnosticStatus]) -> State:
    """What all checks come to."""
    if not present:
        return State(STALE, (), 0, "nobody has said anything")
    silent = {place.node for place in present} - {p.node for p, status in present.items() if status.level != STALE}
    bad: dict[str, DiagnosticStatus] = {}
    for place, status in sorted(present.items()):
        if status.level != OK:
            bad[place.node if place.node in silent else place.path] = status
    worst = max(bad, key=lambda path: bad[path].level) if bad else ""
    message = f"{worst}: {bad[worst].message}" if bad else "OK"
    level = together(status.level for status in present.values())
    return State(level, tuple((path, one.level) for path, one in bad.items()), len(present), message)


def told(state: State) -> str:
    """A line on what all checks come to."""
    if not state.bad:
        return f"{LEVELS[state.level]}: {state.message if state.level else f'all {state.total} checks'}"
    others = f", and {len(state.bad) - 1} more" if len(state.bad) > 1 else ""
    return f"{LEVELS[state.level]}: {state.message}{others}"
