"""What a URDF says of links and joints, element by element, with the lines where it says so.

Of the format (wiki.ros.org/urdf/XML) this is what tells where frames stand: names, parents, origins, axes, mimics.
Shapes, masses and limits are passed over.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Literal, get_args
from xml.parsers import expat

import msgspec

from robo.errors import InvalidTransform
from robo.text.brief import shown
from robo.text.suggestions import closest, suggest
from robo.text.tree import Position, Problem
from robo.tf.transform import IDENTITY, Transform3

Kind = Literal["fixed", "revolute", "continuous", "prismatic", "floating", "planar"]
KINDS: tuple[Kind, ...] = get_args(Kind)

MOST = 1e9
"""A length in m, an angle in rad or a factor beyond it is a mistake, and keeps every sum of some of them finite."""

_LEAST_AXIS = 1e-9
"""An axis that is shorter has no direction."""

_PARTS: dict[str, tuple[str, ...]] = {
    "origin": ("xyz", "rpy", "quat_xyzw"),
    "axis": ("xyz",),
    "parent": ("link",),
    "child": ("link",),
    "mimic": ("joint", "multiplier", "offset"),
}
"""The elements of a joint that are read, with their attributes."""
_OTHERS = ("calibration", "dynamics", "limit", "safety_controller")


class Mimic(msgspec.Struct, frozen=True):
    """A joint's position follows from that of another: multiplier * position + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0
    """rad or m."""


class Joint(msgspec.Struct, frozen=True):
    """What holds a link on its parent."""

    name: str
    kind: Kind
    parent: str
    """A link, as the child is."""
    child: str
    origin: Transform3 = IDENTITY
    """Where it stands in its parent at position 0."""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Along or about what it moves, of length 1, in its own frame."""
    mimic: Mimic | None = None
    place: Position = Position("", 0, 0)

    @property
    def moves(self) -> bool:
        """Whether it has one position."""
        return self.kind in ("revolute", "continuous", "prismatic")

    def at(self, position: float) -> Transform3:
        """Where the child stands in the parent.

        A turn by q about the axis a is the quaternion (a sin(q/2), cos(q/2)): Diebel 2006, Representing attitude.

        Args:
            position: rad about the axis, or m along it, finite; that of a joint which does not move is left out.
        """
        x, y, z = self.axis
        if self.kind == "prismatic":
            return self.origin @ Transform3(x * position, y * position, z * position)
        if not self.moves:
            return self.origin
        s, c = math.sin(position / 2), math.cos(position / 2)
        return self.origin @ Transform3(0.0, 0.0, 0.0, s * x, s * y, s * z, c)


class Link(msgspec.Struct, frozen=True):
    """A frame."""

    name: str
    place: Position


class Said(msgspec.Struct):
    """What a URDF says, and what is wrong with it."""

    name: str = ""
    """The robot's."""
    links: list[Link] = msgspec.field(default_factory=list)
    joints: list[Joint] = msgspec.field(default_factory=list)
    """Those that can be read."""
    problems: list[Problem] = msgspec.field(default_factory=list)
    """What makes it none."""
    warnings: list[Problem] = msgspec.field(default_factory=list)
    """What may not be meant so."""
    whole: bool = True
    """Whether all joints and links could be read."""


class _Element(msgspec.Struct, frozen=True):
    tag: str
    attributes: dict[str, str]
    place: Position
    children: list["_Element"] = msgspec.field(default_factory=list)


def read(text: str, source: str) -> Said:
    """The links and joints of a URDF.

    Args:
        text: of the file.
        source: its name, for what is wrong.
    """
    said = Said()
    root = _parsed(text, source, said)
    if root is None:
        return said
    if root.tag != "robot":
        said.problems.append(Problem(root.place, f"a URDF begins with <robot>, not with <{root.tag}>"))
        return said
    said.name = root.attributes.get("name", "").strip()
    if not said.name:
        said.problems.append(Problem(root.place, 'the robot has no name: <robot name="…">'))
    for element in root.children:
        if element.tag.startswith("xacro:"):
            text = "it holds xacro: give its file a name that ends with .xacro, or make a URDF of it with `xacro FILE`"
            said.problems.append(Problem(element.place, text))
            said.whole = False
            break
        if element.tag == "link":
            _add_link(element, said)
        elif element.tag == "joint":
            _add_joint(element, said)
    return said


def _parsed(text: str, source: str, said: Said) -> _Element | None:
    """The first element with what stands in it and in those."""
    parser = expat.ParserCreate("utf-8")  # whatever it declares: it was read as that
    root: list[_Element] = []
    path: list[_Element | None] = []

    def here() -> Position:
        return Position(source, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = None
        if len(path) < 2 or (len(path) == 2 and path[1] is not None and path[1].tag == "joint"):
            element = _Element(tag, attributes, here())
            above = path[-1] if path else None
            (root if above is None else above.children).append(element)
        path.append(element)

    def end(_tag: str) -> None:
        path.pop()

    def refuse_entity(name: str, *_others: object) -> None:
        # A URDF needs none, and they can be made to grow without end.
        raise _EntityError(Problem(here(), f"it declares an entity, {shown(name)}, and may not"))

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.EntityDeclHandler = refuse_entity
    try:
        parser.Parse(text.encode("utf-8", "replace"), True)
    except expat.ExpatError as error:
        what = expat.ErrorString(error.code) or "it cannot be read"
        said.problems.append(Problem(Position(source, error.lineno, error.offset + 1), f"this is no XML: {what}"))
        return None
    except _EntityError as error:
        said.problems.append(error.problem)
        return None
    return root[0]


class _EntityError(Exception):
    def __init__(self, problem: Problem) -> None:
        super().__init__(str(problem))
        self.problem = problem


def _add_link(element: _Element, said: Said) -> None:
    name = element.attributes.get("name", "")
    if name:
        said.links.append(Link(name, element.place))
    else:
        said.problems.append(Problem(element.place, 'a link has no name: <link name="…">'))
        said.whole = False


def _add_joint(element: _Element, said: Said) -> None:
    name = element.attributes.get("name", "")
    which = f"joint {shown(name)}" if name else "a joint"
    reader = _JointReader(element, which)
    if not name:
        reader.complain(element, 'has no name: <joint name="…" type="…">')
    joint = reader.joint(name)
    said.problems += reader.problems
    said.warnings += reader.warnings
    if joint is not None and name:
        said.joints.append(joint)
    else:
        said.whole = False


class _JointReader:
    """Reads one joint, and collects all that is wrong with it."""

    def __init__(self, element: _Element, which: str) -> None:
        self.problems: list[Problem] = []
        self.warnings: list[Problem] = []
        self._element = element
        self._which = which
        self._parts: dict[str, _Element] = {}
        for part in element.children:
            if part.tag in self._parts:
                self._warn(part, f"has a second <{part.tag}>; the first one counts")
            self._parts.setdefault(part.tag, part)

    def complain(self, element: _Element, text: str) -> None:
        """Note a mistake."""
        self.problems.append(Problem(element.place, f"{self._which} {text}"))

    def joint(self, name: str) -> Joint | None:
        """The joint, unless something that it needs is missing or wrong."""
        kind = self._kind()
        parent, child = self._link("parent"), self._link("child")
        origin = self._origin()
        axis = self._axis(kind)
        mimic = self._mimic() if kind != "fixed" else None
        self._warn_of_misspelt()
        if self.problems and (kind is None or parent is None or child is None):
            return None
        assert kind is not None
        assert parent is not None
        assert child is not None
        return Joint(name, kind, parent, child, origin, axis, mimic, self._element.place)

    def _kind(self) -> Kind | None:
        text = self._element.attributes.get("type")
        kind = next((kind for kind in KINDS if kind == text), None)
        if text is None:
            self.complain(self._element, f"has no type; there are {', '.join(KINDS)}")
        elif kind is None:
            self.complain(self._element, f"has the type {shown(text)}; {suggest(text, KINDS, 'there are')}")
        return kind

    def _link(self, tag: str) -> str | None:
        part = self._parts.get(tag)
        if part is None:
            self.complain(self._element, f'has no {tag}: <{tag} link="…"/>')
            return None
        link = part.attributes.get("link", "")
        if not link:
            self.complain(part, f'names no {tag}: <{tag} link="…"/>')
        return link or None

    def _origin(self) -> Transform3:
        part = self._parts.get("origin")
        if part is None:
            return IDENTITY
        x, y, z = self._numbers(part, "xyz", (0.0, 0.0, 0.0))
        if "quat_xyzw" in part.attributes:
            if "rpy" in part.attributes:
                self.complain(part, "turns its origin by rpy and by quat_xyzw; one of them is enough")
            qx, qy, qz, qw = self._numbers(part, "quat_xyzw", (0.0, 0.0, 0.0, 1.0))
            try:
                return Transform3(x, y, z, qx, qy, qz, qw)
            except InvalidTransform as error:
                self.complain(part, f"has an origin that is none: {error}")
                return IDENTITY
        roll, pitch, yaw = self._numbers(part, "rpy", (0.0, 0.0, 0.0))
        return Transform3.from_rpy(x, y, z, roll, pitch, yaw)

    def _axis(self, kind: Kind | None) -> tuple[float, float, float]:
        x_axis = (1.0, 0.0, 0.0)
        if kind not in ("revolute", "continuous", "prismatic"):
            return x_axis
        part = self._parts.get("axis")
        if part is None:
            self._warn(self._element, "has no axis; URDF takes that of x, 1 0 0")
            return x_axis
        if "xyz" not in part.attributes:
            self.complain(part, 'has an axis without a direction: <axis xyz="0 0 1"/>')
            return x_axis
        x, y, z = self._numbers(part, "xyz", x_axis)
        length = math.hypot(x, y, z)
        if length < _LEAST_AXIS:
            self.complain(part, "has an axis of length 0, which has no direction")
            return x_axis
        return (x / length, y / length, z / length)

    def _mimic(self) -> Mimic | None:
        part = self._parts.get("mimic")
        if part is None:
            return None
        joint = part.attributes.get("joint", "")
        (multiplier,) = self._numbers(part, "multiplier", (1.0,))
        (offset,) = self._numbers(part, "offset", (0.0,))
        if not joint:
            self.complain(part, 'mimics no joint: <mimic joint="…"/>')
            return None
        return Mimic(joint, multiplier, offset)

    def _numbers(self, part: _Element, attribute: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """As many numbers as the default has; that one where they are missing or wrong."""
        text = part.attributes.get(attribute)
        if text is None:
            return default
        values = tuple(_number(word) for word in text.split())
        wanted = "a number" if len(default) == 1 else f"{len(default)} numbers"
        where = f"{attribute} of <{part.tag}>"
        if len(values) != len(default) or not all(map(math.isfinite, values)):
            self.complain(part, f"has {shown(text)} as {where}, which takes {wanted}")
            return default
        if any(abs(value) > MOST for value in values):
            self.complain(part, f"has {shown(text)} as {where}: beyond {MOST:g} is a mistake")
            return default
        return values

    def _warn(self, element: _Element, text: str) -> None:
        self.warnings.append(Problem(element.place, f"{self._which} {text}"))

    def _warn_of_misspelt(self) -> None:
        """A misspelt element or attribute is passed over as any that is unknown, and what it says is lost."""
        for part in self._element.children:
            for tag in _misspelt([part.tag], (*_PARTS, *_OTHERS)):
                self._warn(part, f"has <{part.tag}>, which is passed over; did you mean <{tag}>?")
            known = _PARTS.get(part.tag)
            for attribute in _misspelt(part.attributes, known) if known is not None else ():
                self._warn(part, f"has an unknown attribute in <{part.tag}>; did you mean {attribute}?")


def _misspelt(names: Iterable[str], known: tuple[str, ...]) -> Iterator[str]:
    for name in names:
        if name not in known and (meant := closest(name, known)) is not None:
            yield meant


def _number(word: str) -> float:
    """A number, NaN for what is none; Python's own `1_000` is none here."""
    try:
        return math.nan if "_" in word else float(word)
    except ValueError:
        return math.nan
