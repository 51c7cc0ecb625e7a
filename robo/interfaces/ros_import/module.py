"""A Python module of message types, made of definitions of ROS's. Pure.

It is as ruff formats it, whether lines may have 88 letters or more: what would take more stands in several lines, each
of which ends with a comma.
"""

import math
from collections.abc import Iterable, Sequence

import robo_messages
from robo.errors import InterfaceError
from robo.interfaces.catalogue import PARTS, Constant, Kind
from robo.interfaces.ros_import import docs
from robo.interfaces.ros_import.definition import Definition, Element, Literal, Section, TypeName
from robo.interfaces.ros_import.imports import WIDTH, Imports
from robo.interfaces.ros_import.parse import python_name
from robo.interfaces.ros_import.resolve import base_of
from robo.interfaces.ros_names import robo_name
from robo.interfaces.ros_shape import FLOATS, TEXTS

MADE = "made by `robo interface import`"
"""What each module says of itself: only such a one is written over."""
_FIELDS = "robo_messages.fields"
_WIDTHS = {
    "byte": "Byte", "char": "Char", "int8": "Int8", "uint8": "UInt8", "int16": "Int16", "uint16": "UInt16",
    "int32": "Int32", "uint32": "UInt32", "int64": "Int64", "uint64": "UInt64", "float32": "Float32",
    "wstring": "WString",
}  # fmt: skip
_PLAIN = {"bool": "bool", "float64": "float", "string": "str"}
_BULK = {"uint8": "", "byte": "Bytes", "char": "Chars", "int8": "SignedBytes"}
"""Numbers of one byte: an array of them is bytes."""
_SHADOWED = frozenset(
    {"bool", "bytes", "field", "float", "inf", "int", "list", "memoryview", "nan", "range", "str", "tuple"}
)
"""Names that the body of a class uses: a field of such a name is called otherwise in Python."""
_AMBIGUOUS = ("l", "I", "O")
"""Names that linters take for numbers."""
_WIDEST = 120
"""A line that is longer is too long for the packages that robo makes, letters."""
_KIND_SUFFIX: dict[Kind, str] = {"message": "", "service": "Service", "action": "Action"}


def module_text(definitions: Sequence[Definition], elsewhere: Sequence[Definition] = ()) -> str:
    """The source of a module.

    Args:
        definitions: of the types in it, what is within another one before it.
        elsewhere: of types in modules beside it, which are called as their packages.

    Raises:
        InterfaceError: two of them would have one name.
    """
    return _Module(definitions, elsewhere).text()


def module_name(package: str) -> str:
    """What the module of a package is called."""
    return python_name(package)


def package_text(packages: Sequence[str]) -> str:
    """The source of the `__init__.py` of a folder with a module for each package."""
    names = sorted(map(module_name, packages))
    imported = f"from . import {', '.join(names)}"
    if len(imported) > WIDTH:
        imported = "\n".join(["from . import (", *(f"    {name}," for name in names), ")"])
    exported = f"__all__ = [{', '.join(map(_quoted, names))}]"
    if len(exported) > WIDTH:
        exported = "\n".join(["__all__ = [", *(f"    {_quoted(name)}," for name in names), "]"])
    return "\n".join([*docs.docstring([_about(packages)], ""), "", imported, "", exported, ""])


def class_names(definitions: Sequence[Definition]) -> dict[tuple[str, Kind], str]:
    """What the class of each definition is called, by its name in ROS and its kind.

    Raises:
        InterfaceError: two of them would have one name.
    """
    found: dict[tuple[str, Kind], str] = {}
    owners: dict[str, Definition] = {}
    kinds: dict[str, set[Kind]] = {}
    for one in definitions:
        kinds.setdefault(one.ros_name, set()).add(one.kind)
    for one in definitions:
        is_twice = len(kinds[one.ros_name]) > 1
        name = python_name(f"{one.name}{_KIND_SUFFIX[one.kind]}" if is_twice else one.name)
        other = owners.setdefault(name, one)
        if other is not one:
            text = f"{one.kind} {one.ros_name} and {other.kind} {other.ros_name} would have one name in one module"
            fix = (
                "have a module for each package: -o FOLDER"
                if other.package != one.package
                else "import one of the files by itself"
            )
            raise InterfaceError(f"{one.path}:1:1: {text}; {fix}")
        found[one.ros_name, one.kind] = name
    return found


def _said(one: Definition, section: Section) -> list[str]:
    """What a message says of itself; that it begins with its name, as robo writes it, is no news."""
    lines = docs.cleaned(section.docs)
    return docs.cleaned(lines[1:]) if lines[:1] == [one.ros_name] else lines


def _about(packages: Iterable[str]) -> str:
    return f"Message types of {', '.join(packages)}; {MADE}."


class _Module:
    """The lines of a module, while it goes through the definitions."""

    def __init__(self, definitions: Sequence[Definition], elsewhere: Sequence[Definition]) -> None:
        self._definitions = definitions
        self._classes = class_names(definitions)
        self._elsewhere = {one.ros_name: one for one in elsewhere if one.kind == "message"}
        constants = {one.name for each in definitions for section in each.sections for one in section.constants}
        self._imports = Imports({*self._classes.values(), *constants})
        self._aliases: dict[tuple[str, str, str], str] = {}
        """Types with bounds that have a name of their own, by what they are."""
        self._body: list[str] = []

    def text(self) -> str:
        for one in self._definitions:
            self._definition(one)
        packages = dict.fromkeys(one.package for one in self._definitions)
        head = docs.docstring([_about(packages)], "")
        # Behind the imports isort has one blank line before a statement, and two before a class, as elsewhere.
        body = self._body if self._body[2].startswith(("@", "class ", "#")) else self._body[1:]
        return "\n".join([*head, "", *self._imports.lines(), *body, ""])

    def _definition(self, one: Definition) -> None:
        aliases = len(self._aliases)
        name = self._classes[one.ros_name, one.kind]
        if one.kind == "message":
            lines = self._message(one, one.sections[0], name, "", "")
        else:
            about = _said(one, one.sections[0]) or [f"ROS's {one.kind} {one.ros_name}."]
            lines = [f"class {name}:", *docs.docstring(about, "    ")]
            for part, section in zip(PARTS[one.kind], one.sections, strict=True):
                lines += ["", *self._message(one, section, part, f"_{part}", "    ")]
        new = [line for alias in [*self._aliases.items()][aliases:] for line in _alias_lines(*alias)]
        notice = [f"# {line}".rstrip() for line in docs.cleaned(one.sections[0].notice)]
        self._body += ["", "", *new] if new else []
        self._body += ["", "", *notice, *lines]

    def _message(self, one: Definition, section: Section, name: str, part: str, indent: str) -> list[str]:
        decorator = self._imports.name(robo_messages.__name__, "message")
        base = self._imports.name(robo_messages.__name__, "Message")
        inner = f"{indent}    "
        # What the first part of a service says at its head is said of the service.
        own = [] if part and section is one.sections[0] else _said(one, section)
        about = own or [f"ROS's {one.kind} {one.ros_name}{f': {part[1:].lower()}' if part else ''}."]
        mark = "  # noqa: N801" if name.endswith("_") else ""
        lines = [f'{indent}@{decorator}("{robo_name(one.ros_name)}{part}")', f"{indent}class {name}({base}):{mark}"]
        lines += docs.docstring(about, inner)
        constants = [line for each in section.constants for line in self._constant(each, inner)]
        fields = [line for each in section.fields for line in self._field(each, one.package, inner)]
        # A constant that is called as a type would stand in the way of the fields of that type.
        names = {constant.name for constant in section.constants}
        parts = [fields, constants] if names & {*self._classes.values()} else [constants, fields]
        return lines + [line for found in parts if found for line in ("", *found)]

    def _constant(self, constant: Element, indent: str) -> list[str]:
        hint = self._imports.name("typing", "ClassVar")
        line = f"{indent}{constant.name}: {hint}[{self._single(constant.type.base)}] = "
        assert constant.value is not None
        line += self._literal(constant.value)
        return [_noted(line, constant.name), *_documented(constant, indent)]

    def _field(self, field: Element, package: str, indent: str) -> list[str]:
        name = python_name(field.name, _SHADOWED)
        annotation, default, is_factory = self._typed(field, package)
        begin = f"{indent}{name}: {annotation} = "
        mark = "  # noqa: E741" if name in _AMBIGUOUS else ""
        renamed = [] if name == field.name else [f"name={_quoted(field.name)}"]
        is_long = len(default) == 1 and len(begin + default[0]) > WIDTH
        if is_factory or renamed or is_long:
            begin += self._imports.name("msgspec", "field")
            given = [f"{'default_factory' if is_factory else 'default'}={default[0]}", *default[1:]]
            lines = _called(begin, given, renamed, indent)
        else:
            lines = [f"{begin}{default[0]}", *(f"{indent}{line}" for line in default[1:])]
        return [f"{lines[0]}{mark}", *lines[1:], *_documented(field, indent)]

    def _typed(self, field: Element, package: str) -> tuple[str, list[str], bool]:
        """A field's type, its default in lines, and whether that is a function that makes it."""
        type_ = field.type
        message = base_of(type_, package)
        values = field.value if isinstance(field.value, list) else None
        length = type_.length
        if type_.is_array and type_.base in _BULK and not (length is not None and type_.base == "int8"):
            return self._bulk(type_.base, length, type_.most, values)
        if message is not None:
            item = self._part(message)
        elif type_.letters is not None:
            word = ', extra={"ros": "wstring"}' if type_.base == "wstring" else ""
            item = self._alias(_stem(type_, None), "str", f"max_length={type_.letters}{word}")
        else:
            item = self._single(type_.base)
        if not type_.is_array:
            if message is not None:
                return item, [item], True
            assert not isinstance(field.value, list)
            return item, [self._literal(_zero(type_.base) if field.value is None else field.value)], False
        stem = _stem(type_, message)
        if length is not None:
            hint = self._alias(f"{stem}x{length}", f"tuple[{item}, ...]", f"min_length={length}, max_length={length}")
            return hint, *self._fixed(item, message is not None, length, values, type_.base)
        hint = f"list[{item}]"
        if type_.most is not None:
            hint = self._alias(f"{stem}UpTo{type_.most}", hint, f"max_length={type_.most}")
        return (hint, self._row("lambda: [", values, "]"), True) if values else (hint, ["list"], True)

    def _fixed(
        self, item: str, is_message: bool, length: int, values: list[Constant] | None, base: str
    ) -> tuple[list[str], bool]:
        if is_message:
            return [f"lambda: tuple({item}() for _ in range({length}))"], True
        if values is not None:
            return (self._row("(", values, ")") if length > 1 else [f"({self._literal(values[0])},)"]), False
        zero = self._literal(_zero(base))
        return [f"({zero},) * {length}" if length > 1 else f"({zero},)"], False

    def _bulk(
        self, base: str, length: int | None, most: int | None, values: list[Constant] | None
    ) -> tuple[str, list[str], bool]:
        """An array of bytes."""
        extra = "" if base == "uint8" else f', extra={{"ros": "{base}[]"}}'
        stem = {"uint8": "Bytes", "byte": "ByteBytes", "char": "CharBytes", "int8": "SignedBytes"}[base]
        numbers = bytes(int(value) % 256 for value in values or ())
        said = _quoted_bytes(numbers)
        if length is not None:
            hint = self._alias(f"{stem}x{length}", "bytes", f"min_length={length}, max_length={length}{extra}")
            return hint, [said if numbers.strip(b"\0") else f"bytes({length})"], False
        hint = self._imports.name(_FIELDS, _BULK[base]) if _BULK[base] else "memoryview"
        if most is not None:
            hint = self._alias(f"{stem}UpTo{most}", "memoryview", f"max_length={most}{extra}")
        return hint, [f"memoryview({said})"], False

    def _single(self, base: str) -> str:
        return _PLAIN[base] if base in _PLAIN else self._imports.name(_FIELDS, _WIDTHS[base])

    def _part(self, message: str) -> str:
        """What the type of a field that is a message is called."""
        if (message, "message") in self._classes:
            return self._classes[message, "message"]
        other = self._elsewhere.get(message)
        if other is not None:
            return self._imports.name(f".{module_name(other.package)}", python_name(other.name))
        return self._imports.message(robo_messages.find_type(robo_name(message)))

    def _alias(self, stem: str, hint: str, bounds: str) -> str:
        """The name of a type with bounds."""
        parts = (
            self._imports.name("typing", "Annotated"),
            hint,
            f"{self._imports.name('msgspec', 'Meta')}({bounds})",
        )
        if parts not in self._aliases:
            name = f"_{stem}"
            while name in self._aliases.values():
                name += "_"
            self._aliases[parts] = name
        return self._aliases[parts]

    def _row(self, begin: str, values: Sequence[Constant], end: str) -> list[str]:
        """Several values in one line where they are few, else each in a line of its own."""
        said = [self._literal(value) for value in values]
        whole = f"{begin}{', '.join(said)}{end}"
        return [whole] if len(whole) <= _SHORT_ROW else [begin, *(f"    {one}," for one in said), end]

    def _literal(self, value: Literal) -> str:
        """A value as Python writes it."""
        assert not isinstance(value, list)
        if isinstance(value, float) and not math.isfinite(value):
            module = self._imports.name("math", "nan" if math.isnan(value) else "inf")
            return f"-{module}" if value < 0 else module
        return _quoted(value) if isinstance(value, str) else repr(value).replace("e+", "e")


_SHORT_ROW = 40
"""A list that fits beside any name, letters."""


def _stem(type_: TypeName, message: str | None) -> str:
    """How the name of a type with bounds begins."""
    if message is not None:
        return message.rpartition("/")[2]
    letters = "" if type_.letters is None else str(type_.letters)
    return _WIDTHS.get(type_.base, _PLAIN.get(type_.base, "").capitalize()) + letters


def _zero(base: str) -> Constant:
    if base in FLOATS:
        return 0.0
    return False if base == "bool" else "" if base in TEXTS else 0


def _called(begin: str, first: list[str], rest: list[str], indent: str) -> list[str]:
    """A call, in one line where that is short.

    Args:
        begin: what stands before the bracket.
        first: its first argument, in lines.
        rest: its other arguments.
        indent: of its first line.
    """
    short = f"{begin}({', '.join([*first, *rest])})"
    if len(first) == 1 and len(short) <= WIDTH:
        return [short]
    inner = [f"{indent}    {line}" for line in (*first[:-1], f"{first[-1]},", *(f"{one}," for one in rest))]
    return [f"{begin}(", *(f"{line}  # noqa: E501" if len(line) > _WIDEST else line for line in inner), f"{indent})"]


def _alias_lines(parts: tuple[str, str, str], name: str) -> list[str]:
    annotated, hint, meta = parts
    line = f"{name} = {annotated}[{hint}, {meta}]"
    return [line] if len(line) <= WIDTH else [f"{name} = {annotated}[", f"    {hint},", f"    {meta},", "]"]


def _documented(element: Element, indent: str) -> list[str]:
    lines = docs.cleaned(element.docs)
    return docs.docstring(lines, indent) if lines else []


def _noted(line: str, name: str) -> str:
    """A line that cannot be broken, with what keeps tools from trying to, and from complaining."""
    skipped = "  # fmt: skip" if len(line) > WIDTH else ""
    rules = [*(["E501"] if len(line) > _WIDEST else []), *(["E741"] if name in _AMBIGUOUS else [])]
    return line + (f"  # noqa: {', '.join(rules)}" if rules else "") + skipped


def _quoted(text: str) -> str:
    """With double quotes, unless single ones need fewer escapes."""
    mark = "'" if text.count('"') > text.count("'") else '"'
    body = "".join(
        f"\\{letter}" if letter == mark else repr(letter)[1:-1] if letter not in "'\"" else letter for letter in text
    )
    return f"{mark}{body}{mark}"


def _quoted_bytes(data: bytes) -> str:
    said = repr(data)
    return f'b"{said[2:-1]}"' if said[1] == "'" and '"' not in said else said
