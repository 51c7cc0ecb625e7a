"""A robot's links and joints as a tree, and where its links stand when its joints are somewhere. Pure; SI units."""

import math
from collections.abc import Iterable, Mapping, Sequence

import msgspec

from robo import RoboError
from robo.text.brief import shown
from robo.text.suggestions import suggest
from robo.text.tree import Position, Problem
from robo.tf.transform import Transform3
from robo_services import urdf_xml
from robo_services.urdf_xml import MOST, Joint, Link, Said

MOST_NAMED = 12
"""So many names stand in one message."""


class UrdfError(RoboError):
    """A URDF is missing or has mistakes; names all of them."""


class Model(msgspec.Struct, frozen=True):
    """A robot: links, each but the root held by one joint."""

    name: str
    root: str
    """The link that stands in none."""
    links: tuple[str, ...]
    fixed: tuple[Joint, ...]
    """The joints that do not move."""
    moving: Mapping[str, Joint]
    """Those with a position, by their names."""
    mimics: tuple[Joint, ...]
    """Those of them that follow another; each after the one that it follows."""
    warnings: tuple[str, ...]
    """What may not be meant so."""

    def positions(self, told: Mapping[str, float]) -> dict[str, float]:
        """The positions of joints, rad or m, from those that were told: without what is none, with what follows.

        A joint that mimics another one follows it, unless its own position was told.
        """
        known = {name: value for name, value in told.items() if name in self.moving and is_position(value)}
        for joint in self.mimics:
            mimic = joint.mimic
            if mimic is not None and joint.name not in known and mimic.joint in known:
                position = mimic.multiplier * known[mimic.joint] + mimic.offset
                if is_position(position):
                    known[joint.name] = position
        return known

    def transforms(self, told: Mapping[str, float]) -> dict[str, Transform3]:
        """Where links stand in their parents, by the names of the joints that hold them.

        Args:
            told: positions of joints, rad or m; the others are left out, and so are joints that do not move.
        """
        return {name: self.moving[name].at(position) for name, position in self.positions(told).items()}


def is_position(value: float) -> bool:
    """Whether a number can be the position of a joint: finite, and not absurd."""
    return math.isfinite(value) and abs(value) <= MOST


def parse(text: str, source: str = "robot_description") -> Model:
    """The model that a URDF describes.

    Args:
        text: of the file.
        source: its name, for what is wrong.

    Raises:
        UrdfError: it has mistakes; a line for each, with its place.
    """
    said = urdf_xml.read(text, source)
    _check_names(said)
    _check_mimics(said)
    root = _checked_root(said, source)
    if said.problems:
        said.problems.sort(key=lambda problem: problem.position[1:])
        raise UrdfError("\n".join(map(str, said.problems)))
    said.warnings.sort(key=lambda warning: warning.position[1:])
    for joint in said.joints:
        if joint.kind in ("floating", "planar"):
            text = f"joint {shown(joint.name)} is {joint.kind} and passed over: where {joint.child} stands, others say"
            said.warnings.append(Problem(joint.place, text))
    return Model(
        name=said.name,
        root=root,
        links=tuple(link.name for link in said.links),
        fixed=tuple(joint for joint in said.joints if joint.kind == "fixed"),
        moving={joint.name: joint for joint in said.joints if joint.moves},
        mimics=tuple(_in_order(said.joints)),
        warnings=tuple(map(str, said.warnings)),
    )


def _check_names(said: Said) -> None:
    """Refuse names that stand twice, and links that are none."""
    links = _first_of("link", said.links, said.problems)
    _first_of("joint", said.joints, said.problems)
    for joint in said.joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                text = f"joint {shown(joint.name)}: its {role} {shown(link)} is no link; {suggest(link, links)}"
                said.problems.append(Problem(joint.place, text))
                said.whole = False


def _first_of(what: str, things: Sequence[Link] | Sequence[Joint], problems: list[Problem]) -> dict[str, int]:
    """The names of things with the lines where they are first."""
    lines: dict[str, int] = {}
    for thing in things:
        if thing.name in lines:
            text = f"{what} {shown(thing.name)} is there already, in line {lines[thing.name]}"
            problems.append(Problem(thing.place, text))
        lines.setdefault(thing.name, thing.place.line)
    return lines


def _check_mimics(said: Said) -> None:
    joints = {joint.name: joint for joint in reversed(said.joints)}
    for joint in said.joints:
        if joint.mimic is None:
            continue
        followed = joints.get(joint.mimic.joint)
        which = f"joint {shown(joint.name)} mimics {shown(joint.mimic.joint)}"
        if followed is None:
            others = [name for name, other in joints.items() if other.moves and other is not joint]
            if said.whole:  # else it may be one that could not be read
                text = f"{which}, which is no joint; {suggest(joint.mimic.joint, others)}"
                said.problems.append(Problem(joint.place, text))
        elif not followed.moves:
            said.problems.append(Problem(joint.place, f"{which}, which is {followed.kind} and has no position"))
    followed_by = {name: joint.mimic.joint for name, joint in joints.items() if joint.mimic is not None}
    for loop in _loops(followed_by):
        said.problems.append(Problem(joints[loop[0]].place, f"a loop: {listed(loop, ' mimics ')}"))


def _checked_root(said: Said, source: str) -> str:
    """The link that stands in none; with mistakes, any text.

    Where a joint or a link could not be read, more of them may look like roots than are: then nothing is said of it.
    """
    held: dict[str, Joint] = {}
    for joint in said.joints:
        other = held.setdefault(joint.child, joint)
        if other is not joint:
            text = (
                f"link {shown(joint.child)} has two parents: "
                f"joint {shown(joint.name)} here, and {shown(other.name)} in line {other.place.line}"
            )
            said.problems.append(Problem(joint.place, text))
    for loop in _loops({child: joint.parent for child, joint in held.items()}):
        said.problems.append(Problem(held[loop[0]].place, f"a loop: {listed(loop, ' stands in ')}"))
    roots = [link for link in said.links if link.name not in held]
    names = list(dict.fromkeys(root.name for root in roots))
    if not said.links and said.whole and not said.problems:
        said.problems.append(Problem(Position(source, 0, 0), "the robot has no link"))
    elif len(names) > 1 and said.whole:
        text = f"{len(names)} links are held by no joint: {listed(names)}; all but one have to be"
        said.problems.append(Problem(roots[1].place, text))
    return names[0] if names else ""


def _loops(after: Mapping[str, str]) -> list[list[str]]:
    """Each loop once, where names lead to others: its names, the first of them again at its end."""
    loops: list[list[str]] = []
    done: set[str] = set()
    for begin in after:
        path: dict[str, None] = {}
        name: str | None = begin
        while name is not None and name not in done and name not in path:
            path[name] = None
            name = after.get(name)
        if name is not None and name in path:
            way = list(path)
            loops.append([*way[way.index(name) :], name])
        done.update(path)
    return loops


def listed(names: Iterable[str], between: str = ", ") -> str:
    """Names as a message shows them: not too many, and none too long."""
    all_names = list(names)
    rest = f"{between}… ({len(all_names) - MOST_NAMED} more)" if len(all_names) > MOST_NAMED else ""
    return between.join(map(shown, all_names[:MOST_NAMED])) + rest


def _in_order(joints: Sequence[Joint]) -> list[Joint]:
    """The joints that mimic others, each after the one that it follows."""
    followers = {joint.name: joint for joint in joints if joint.moves and joint.mimic is not None}
    ordered: dict[str, Joint] = {}
    for begin in followers:
        chain: list[Joint] = []
        name = begin
        while name in followers and name not in ordered:
            chain.append(followers[name])
            mimic = followers[name].mimic
            name = mimic.joint if mimic is not None else ""
        ordered.update((joint.name, joint) for joint in reversed(chain))
    return list(ordered.values())
