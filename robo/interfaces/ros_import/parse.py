"""The text of a `.msg`, `.srv` or `.action` file: its fields, constants and comments, or all that is wrong. Pure.

Which comments are whose follows ROS's own reader (`rosidl_adapter`): those at the head are the message's, one in a line
with a field, in an indented line below it or in lines above it is the field's. A notice of copyright is nobody's.
"""

import keyword
import re
from collections.abc import Iterator
from typing import NamedTuple

from robo.interfaces.catalogue import PARTS, Kind
from robo.interfaces.ros_import.definition import Element, Fault, Literal, Place, Section, TypeName
from robo.interfaces.ros_import.literals import PRIMITIVE, read_literal
from robo.interfaces.ros_shape import TEXTS
from robo.text.brief import shown

FIELD_NAME = re.compile(r"(?!.*__)(?!.*_$)[a-z][a-z0-9_]*")
CONSTANT_NAME = re.compile(r"(?!.*__)(?!.*_$)[A-Z][A-Z0-9_]*")
TYPE_NAME = re.compile(r"[A-Z][A-Za-z0-9]*")
PACKAGE_NAME = re.compile(r"(?!.*__)(?!.*_$)[a-z][a-z0-9_]*")
MOST_ELEMENTS = 2**24
"""Of a fixed array: each message has all of them."""
_LINE = re.compile(r"(?P<before>\s*)(?P<type>\S+)(?:\s+(?P<name>[^\s=]*)\s*(?P<equals>=)?\s*(?P<value>.*))?")
_TYPE = re.compile(r"(?P<base>[^<\[\s]*)(?:<=(?P<letters>[^\[]*))?(?P<array>\[(?P<size>.*)\])?")
_SIZE = re.compile(r"(?P<bound><=)?(?P<number>[0-9]{1,18})")
_NOTICE = re.compile(r"copyright|spdx-license|licensed under|all rights reserved", re.IGNORECASE)
_OPENS = re.compile(r"""(?:^|[\s=,\[])(?P<quote>["'])""")
_OLD = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}
"""Types that ROS 1 had."""


class Parsed(NamedTuple):
    """A file's sections, as far as they can be read, and its mistakes."""

    sections: list[Section]
    faults: list[Fault]


def parse(text: str, path: str, kind: Kind) -> Parsed:
    """What a file defines.

    Args:
        text: of the file.
        path: of the file, for what is said of its mistakes.
        kind: what it is a definition of, as its name ends.
    """
    lines = [line.rstrip() for line in text.removeprefix("\ufeff").split("\n")]
    borders = [number for number, line in enumerate(lines, 1) if line.strip() == "---"]
    faults = []
    wanted = len(PARTS.get(kind, ("",)))
    if len(borders) != wanted - 1:
        place = Place(path, borders[wanted - 1] if len(borders) >= wanted else len(lines), 1)
        faults.append(Fault(place, _borders_text(kind, len(borders))))
        return Parsed([], faults)
    sections = []
    for begin, end in zip([0, *borders], [*(border - 1 for border in borders), len(lines)], strict=True):
        reading = _Reading(path, begin)
        sections.append(reading.section(lines[begin:end]))
        faults += reading.faults
    return Parsed(sections, faults)


def _borders_text(kind: Kind, count: int) -> str:
    if kind == "message":
        return "a .msg file has no line ---; a service is an .srv file, an action an .action file"
    parts = [part.lower() for part in PARTS[kind]]
    article = "an" if kind == "action" else "a"
    return f"{article} {kind} has {' and '.join(parts)}: {len(parts) - 1} lines ---, not {count}"


class _Mistake(Exception):
    """Something in a line, and in which column it stands."""

    def __init__(self, column: int, text: str) -> None:
        super().__init__(text)
        self.column = column


class _Reading:
    """Goes through the lines of a section."""

    def __init__(self, path: str, begin: int) -> None:
        self._path = path
        self._begin = begin
        self.faults: list[Fault] = []
        self._constants: list[Element] = []
        self._fields: list[Element] = []
        self._last: Element | None = None
        self._seen: dict[str, int] = {}

    def section(self, lines: list[str]) -> Section:
        """A message."""
        docs, notice, rest = _head(lines)
        above: list[str] = []
        for number, line in enumerate(lines[rest:], self._begin + rest + 1):
            code, comment = _parted(line)
            if not code.strip():
                if comment is not None and line[0].isspace() and self._last is not None and not above:
                    self._last.docs.append(comment)
                elif comment is not None:
                    above.append(comment)
                continue
            try:
                self._element(number, code, [*above, *([comment] if comment else [])])
            except _Mistake as mistake:
                self.faults.append(Fault(Place(self._path, number, mistake.column), str(mistake)))
            above = []
        docs += ["", *above] if docs and above else above
        return Section(docs, notice, self._constants, self._fields)

    def _element(self, number: int, code: str, docs: list[str]) -> None:
        match = _LINE.fullmatch(code)
        assert match is not None
        column = match.start("type") + 1
        if not match["name"]:
            raise _Mistake(column, f"expected a type and a name, such as float64 x, not {shown(match['type'])}")
        type_ = _type(match["type"], column)
        name, at = match["name"], match.start("name") + 1
        is_constant = match["equals"] is not None
        _check_name(name, at, is_constant=is_constant)
        value = _value(type_, match["value"], match.start("value") + 1, is_constant=is_constant)
        if name in self._seen:
            raise _Mistake(at, f"{name} is there already, in line {self._seen[name]}")
        self._seen[name] = number
        self._last = Element(Place(self._path, number, column), type_, name, value, docs)
        (self._constants if is_constant else self._fields).append(self._last)


def _head(lines: list[str]) -> tuple[list[str], list[str], int]:
    """The comments that are the message's own, a notice of copyright before them, and where the rest begins."""
    notice: list[str] = []
    at = 0
    while True:
        begin = next((i for i in range(at, len(lines)) if lines[i]), len(lines))
        end = next((i for i in range(begin, len(lines)) if not lines[i].startswith("#")), len(lines))
        block = [_comment(line) for line in lines[begin:end]]
        if block and any(map(_NOTICE.search, block)):
            notice += ["", *block] if notice else block
            at = end
            continue
        if begin and end < len(lines) and lines[end]:
            return [], notice, begin  # it stands above a field
        return block, notice, end


def _comment(text: str) -> str:
    """Without its signs, and one space behind them."""
    return text.lstrip("#").removeprefix(" ").rstrip()


def _parted(line: str) -> tuple[str, str | None]:
    """What a line says, and its comment; a # within quotes begins none."""
    for at in _hashes(line):
        return line[:at].rstrip(), _comment(line[at:])
    return line, None


def _hashes(line: str) -> Iterator[int]:
    """Where a comment may begin."""
    at = 0
    while True:
        begin = line.find("#", at)
        if begin < 0:
            return
        quoted = _OPENS.search(line, at, begin)
        if quoted is None:
            yield begin
            return
        close = re.compile(rf"(?<!\\){quoted['quote']}").search(line, quoted.end())
        if close is None:
            yield begin
            return
        at = close.end()


def _type(text: str, column: int) -> TypeName:
    match = _TYPE.fullmatch(text)
    if match is None:
        raise _Mistake(column, f"{shown(text)} is no type; write float64, float64[], float64[3], float64[<=3]")
    base, letters = match["base"], None
    if base in _OLD:
        raise _Mistake(column, f"{base} is of ROS 1; did you mean {_OLD[base]}?")
    if base not in PRIMITIVE:
        _check_base(base, column)
    if match["letters"] is not None:
        if base not in TEXTS:
            raise _Mistake(column, f"{base} takes no bound; string and wstring do")
        if re.fullmatch("[0-9]{1,18}", match["letters"]) is None or not int(match["letters"]):
            raise _Mistake(
                match.start("letters") + column, f"a bound is a number from 1, not {shown(match['letters'])}"
            )
        letters = int(match["letters"])
    if match["array"] is None:
        return TypeName(base, letters)
    if not match["size"]:
        return TypeName(base, letters, is_array=True)
    size = _SIZE.fullmatch(match["size"])
    at = match.start("size") + column
    if size is None or not int(size["number"]):
        raise _Mistake(at, f"in brackets stands nothing, 3 or <=3, and not {shown(match['size'])}")
    number = int(size["number"])
    if size["bound"]:
        return TypeName(base, letters, is_array=True, most=number)
    if number > MOST_ELEMENTS:
        raise _Mistake(at, f"at most {MOST_ELEMENTS:,} elements are taken, not {number:,}")
    return TypeName(base, letters, is_array=True, length=number)


def _check_base(base: str, column: int) -> None:
    *package, name = base.split("/")
    if len(package) == 2 and package[1] == "msg":
        package = package[:1]
    if len(package) > 1 or (TYPE_NAME.fullmatch(name) is None and not package and "/" in base):
        raise _Mistake(column, f"{shown(base)} is no type; write it as package/Type")
    if package and PACKAGE_NAME.fullmatch(package[0]) is None:
        raise _Mistake(column, f"{shown(package[0])} is no name of a package: lower case letters, digits and _")


def _check_name(name: str, column: int, *, is_constant: bool) -> None:
    if is_constant and CONSTANT_NAME.fullmatch(name) is None:
        raise _Mistake(
            column, f"{shown(name)} is no name of a constant: capitals, digits and _, as {_as_constant(name)}"
        )
    if not is_constant and FIELD_NAME.fullmatch(name) is None:
        raise _Mistake(
            column, f"{shown(name)} is no name of a field: lower case letters, digits and _, as {_as_field(name)}"
        )


def _as_field(name: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()
    found = re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", words)).strip("_")
    return found if FIELD_NAME.fullmatch(found) else "front_left"


def _as_constant(name: str) -> str:
    found = _as_field(name).upper()
    return found if CONSTANT_NAME.fullmatch(found) else "FRONT_LEFT"


def _value(type_: TypeName, text: str, column: int, *, is_constant: bool) -> Literal | None:
    if not text and not (is_constant and type_.base in TEXTS):
        if is_constant:
            raise _Mistake(column, "a constant has a value")
        return None
    if type_.base not in PRIMITIVE:
        raise _Mistake(column, f"a {type_.base} takes no value here; only ROS's own types do")
    if is_constant and type_.is_array:
        raise _Mistake(column, "a constant is one value and no array")
    try:
        return read_literal(type_, text)
    except ValueError as error:
        raise _Mistake(column, str(error)) from None


def python_name(name: str, taken: frozenset[str] = frozenset()) -> str:
    """A name of ROS's as Python can have it: `from` is `from_`."""
    return f"{name}_" if keyword.iskeyword(name) or name in taken else name
