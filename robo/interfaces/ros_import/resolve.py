"""Definitions put together: which type each field has, what robo has already, what comes before what.

No file is touched: who calls has read them.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest
from typing import NamedTuple

import robo_messages
from robo.interfaces import catalogue
from robo.interfaces.catalogue import Kind
from robo.interfaces.ros_import.definition import Definition, Element, Fault, Place, TypeName, refuse
from robo.interfaces.ros_import.files import Source
from robo.interfaces.ros_import.literals import PRIMITIVE
from robo.interfaces.ros_import.parse import PACKAGE_NAME, TYPE_NAME, parse
from robo.interfaces.ros_names import robo_name, ros_name
from robo.interfaces.ros_shape import shape_of
from robo.interfaces.ros_text import ros_word
from robo.text.brief import shown
from robo.text.suggestions import closest


class Resolved(NamedTuple):
    """All that is to be made, and what it stands on."""

    definitions: list[Definition]
    """In such an order that what is within another one comes before it; else by name."""
    shipped: list[str]
    """Types, as robo calls them, that were among the files and that robo has already."""
    differing: list[str]
    """A sentence for each of these whose fields are others than robo's."""


def resolve(sources: Sequence[Source]) -> Resolved:
    """Read files and put together what they define.

    Raises:
        InterfaceError: all that is wrong with them, each with file, line and column.
    """
    read, faults = _read(sources)
    ours = _shipped()
    own: dict[str, Definition] = {}
    shipped: list[str] = []
    differing: list[str] = []
    for one in read:
        name = ours.get((one.ros_name, one.kind))
        if name is not None:
            shipped.append(name)
            if one.sections:  # else it cannot be read, which is told below
                differing += _difference(one, name)
        elif one.kind == "message":
            own[one.ros_name] = one
    new = [one for one in read if (one.ros_name, one.kind) not in ours]
    messages = {ros for ros, kind in ours if kind == "message"}
    for one in new:
        faults += _unknown(one, own, messages)
    if not faults:
        faults += _circles(own)
    refuse(faults)
    return Resolved(_ordered(new, own), sorted(shipped), sorted(differing))


def base_of(type_: TypeName, package: str) -> str | None:
    """The message that a field is of, as `package/Type`; None for one of ROS's own types."""
    if type_.base in PRIMITIVE:
        return None
    parts = type_.base.split("/")
    return f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else f"{package}/{type_.base}"


def _read(sources: Sequence[Source]) -> tuple[list[Definition], list[Fault]]:
    found: dict[tuple[str, str, Kind], tuple[Definition, Source]] = {}
    faults: list[Fault] = []
    for source in sources:
        place = Place(str(source.path), 1, 1)
        if TYPE_NAME.fullmatch(source.name) is None:
            faults.append(
                Fault(place, f"{shown(source.name)} is no name of a type: capitals first, letters and digits")
            )
            continue
        if PACKAGE_NAME.fullmatch(source.package) is None:
            text = f"{shown(source.package)} is no name of a package: lower case letters, digits and _"
            faults.append(Fault(place, text))
            continue
        name = f"{source.package}/{source.name}"
        if ros_name(robo_name(name)) != name:
            text = f"robo calls {ros_name(robo_name(name))} so; give package {source.package} another name"
            faults.append(Fault(place, text))
        key = source.package, source.name, source.kind
        if key in found:
            other = found[key][1]
            if other.text != source.text:
                faults.append(Fault(place, f"{name} is another one in {other.path}; name the folder that you want"))
            continue
        parsed = parse(source.text, str(source.path), source.kind)
        faults += parsed.faults
        definition = Definition(source.package, source.name, source.kind, str(source.path), parsed.sections)
        found[key] = definition, source
    return [definition for definition, _ in found.values()], faults


def _shipped() -> dict[tuple[str, Kind], str]:
    """What robo has, by name in ROS and kind: its name in robo."""
    found: dict[tuple[str, Kind], str] = {}
    for name in robo_messages.type_names():
        whole, kind = catalogue.whole_of(name)
        if robo_messages.find_type(name).__module__.partition(".")[0] == robo_messages.__name__:
            found[ros_name(whole), kind] = whole
    found["std_srvs/Empty", "service"] = "std/Empty"
    return found


def _difference(one: Definition, name: str) -> list[str]:
    """Where a file defines something else than robo has under its name."""
    parts = catalogue.parts(name) if name != "std/Empty" else [name] * len(one.sections)
    for section, part in zip(one.sections, parts, strict=True):
        there = [(ros_word(field.kind), field.name) for field in shape_of(robo_messages.find_type(part)).fields]
        here = [(_whole(field.type, one.package), field.name) for field in section.fields]
        for theirs, ours in zip_longest(here, there):
            if theirs is None or ours is None or _alike(theirs) != _alike(ours):
                return [
                    f"{one.path}: robo's {name} is used, which has {_said(ours)} where the file has {_said(theirs)}"
                ]
    return []


def _alike(field: tuple[str, str]) -> tuple[str, str]:
    """A char is a uint8 in ROS."""
    word, name = field
    return f"uint8{word[4:]}" if word == "char" or word.startswith("char[") else word, name


def _said(field: tuple[str, str] | None) -> str:
    return " ".join(field) if field is not None else "nothing"


def _whole(type_: TypeName, package: str) -> str:
    """A field's type with its package, as ROS writes it."""
    word = base_of(type_, package) or type_.base
    if type_.letters is not None:
        word += f"<={type_.letters}"
    if not type_.is_array:
        return word
    return f"{word}[{type_.length if type_.length is not None else '' if type_.most is None else f'<={type_.most}'}]"


def _fields(one: Definition) -> list[Element]:
    return [field for section in one.sections for field in section.fields]


def _unknown(one: Definition, own: Mapping[str, Definition], shipped: set[str]) -> list[Fault]:
    faults = []
    for field in _fields(one):
        name = base_of(field.type, one.package)
        if name is not None and name not in own and name not in shipped:
            faults.append(Fault(field.place, _unknown_text(field.type.base, name, one.package, own, shipped)))
    return faults


def _unknown_text(base: str, name: str, package: str, own: Mapping[str, Definition], shipped: set[str]) -> str:
    known = [*own, *sorted(shipped)]
    if "/" not in base:
        # Those of its own package come first, then ROS's own types, then what stands in other packages.
        short = {one.partition("/")[2]: one for one in reversed(known)} | {one: one for one in PRIMITIVE}
        short |= {one.partition("/")[2]: one.partition("/")[2] for one in own if one.startswith(f"{package}/")}
        near = closest(base, short)
        instead = f"did you mean {short[near]}?" if near is not None else "write it as package/Type"
        return f"there is no type {shown(base)} in {package}; {instead}"
    near = closest(name, known, _ALIKE)
    instead = (
        f"did you mean {near}?" if near is not None else f"add the folder of {name.partition('/')[0]} to the paths"
    )
    return f"{shown(name)} is neither below the paths nor in robo; {instead}"


_ALIKE = 0.85
"""Names of one package are alike for that alone."""
_MOST_DEEP = 100
"""Messages within each other: more than any robot has, and less than Python's stack takes."""


def _circles(own: Mapping[str, Definition]) -> list[Fault]:
    """Messages that hold themselves, and those that stand too deep in each other."""
    faults: list[Fault] = []
    depths: dict[str, int] = {}

    def depth(name: str, above: tuple[str, ...]) -> int:
        """How many messages stand in each other."""
        if name in depths:
            return depths[name]
        deepest = 0
        for field in _fields(own[name]):
            inner = base_of(field.type, own[name].package)
            if inner is None or inner not in own:
                continue
            if inner in (*above, name):
                faults.append(Fault(field.place, f"{inner} holds itself, which no message can"))
            elif len(above) == _MOST_DEEP or (below := depth(inner, (*above, name))) >= _MOST_DEEP:
                faults.append(Fault(field.place, f"more than {_MOST_DEEP} messages stand in each other"))
            else:
                deepest = max(deepest, below)
        depths[name] = deepest + 1
        return depths[name]

    for name in own:
        depth(name, ())
    return faults


def _ordered(new: Iterable[Definition], own: Mapping[str, Definition]) -> list[Definition]:
    found: dict[tuple[str, Kind], Definition] = {}

    def add(one: Definition) -> None:
        if (one.ros_name, one.kind) in found:
            return
        for name in sorted({base_of(field.type, one.package) or "" for field in _fields(one)}):
            if name in own:
                add(own[name])
        found[one.ros_name, one.kind] = one

    for one in sorted(new, key=lambda one: (one.package, _KIND_ORDER[one.kind], one.name)):
        add(one)
    return list(found.values())


_KIND_ORDER: dict[Kind, int] = {"message": 0, "service": 1, "action": 2}
