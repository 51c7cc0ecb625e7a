"""Which process comes after which: `needs`, from names as written to full names, without circles."""

import graphlib
from collections.abc import Collection, Mapping, Sequence

import msgspec

from robo.launch.forms import text_of
from robo.launch.manifest import Need
from robo.launch.plan import Until
from robo.launch.substitution import Complain
from robo.text.brief import shown
from robo.text.suggestions import closest
from robo.text.tree import Position
from robo.wire import names


class Dependent(msgspec.Struct, frozen=True):
    """A process and all that it needs."""

    full_name: str
    namespace: str
    needs: Sequence[Need]
    """As written, filled."""


def resolve(
    waiting: Sequence[Dependent],
    by_key: Mapping[tuple[str, str], Sequence[str]],
    left_out: Collection[str],
    complain: Complain,
) -> dict[str, dict[str, Until]]:
    """What each process needs, by full names.

    A need of a node that a condition leaves out is void; one of a node with replicas means all of them.

    Args:
        waiting: the processes.
        by_key: full names by namespace and key in the manifest.
        left_out: keys of nodes that do not run.
        complain: takes needs of unknown nodes, and circles.
    """
    known = dict.fromkeys(one.full_name for one in waiting)  # in the order of the manifest, as hints are
    resolved: dict[str, dict[str, Until]] = {one.full_name: {} for one in waiting}
    places: dict[tuple[str, str], Position] = {}
    for one in waiting:
        for need in one.needs:
            text = text_of(need.node, complain)
            if text is None:
                continue
            full = text if text.startswith("/") else "/" + names.join(one.namespace, text)
            namespace, _, key = full.strip("/").rpartition("/")
            found = [full] if full in known else by_key.get((namespace, key), ())
            if not found and key not in left_out:
                what = f"needs {shown(text)}: there is no node {full}{_hint(full, known)}"
                complain(need.node.position, what)
            for name in found:
                resolved[one.full_name][name] = need.until
                places[one.full_name, name] = need.node.position
    for circle in _circles(resolved):
        complain(places[circle[0], circle[1]], f"needs go in a circle: {' → '.join(circle)}")
    return resolved


def _hint(full: str, known: Collection[str]) -> str:
    name = full.rpartition("/")[2]
    same = [other for other in known if other.rpartition("/")[2] == name]
    close = same[0] if same else closest(full, known)
    if close is None:
        return ""
    folder = full.rpartition("/")[0]
    return f"; did you mean {close.removeprefix(f'{folder}/')}?"


def _circles(needs: Mapping[str, Mapping[str, Until]]) -> list[list[str]]:
    """Circles, each as the names along it, from the one that comes first; cutting one edge of each leaves none."""
    left = {name: dict.fromkeys(needed) for name, needed in needs.items()}
    order = {name: index for index, name in enumerate(needs)}
    found = []
    while True:
        try:
            graphlib.TopologicalSorter(left).prepare()
        except graphlib.CycleError as error:
            circle: list[str] = error.args[1][:0:-1]  # each needs the next
            first = circle.index(min(circle, key=order.__getitem__))
            circle = circle[first:] + circle[:first]
            found.append([*circle, circle[0]])
            del left[circle[-1]][circle[0]]
        else:
            return found
