"""Message and service types: those that ship, and those of users' packages.

A package of your own is found where it is installed with an entry point in the group `robo.packages` and has a
module `messages`, or in the group `robo.messages`, where ROBO_MESSAGES names its modules, and where a Python file
below the current folder says `@message("group/Type")`. A file is imported when one of its types is asked for, in this
process; `apart` tells of types and imports what users wrote in another.
"""

import ast
import contextlib
import functools
import importlib
import inspect
import math
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, get_origin, get_type_hints

import msgspec
from msgspec import inspect as shapes

import robo_messages
from robo.environment import MESSAGES_VARIABLE
from robo.errors import ContractError, UnreadableFile
from robo.interfaces.message_input import field_types
from robo.packages import announced
from robo.packages import find as packages
from robo.packages.folders import is_module_name, spec_of
from robo.packages.modules import module_of, python_files
from robo.text.brief import shown
from robo.text.docstrings import attribute_docs, first_sentence
from robo.text.files import read_bytes
from robo.text.import_errors import explained
from robo.text.suggestions import closest
from robo_messages import Message, UnknownType

_MOST_FILES = 2000
_REGISTERS = re.compile(rb"@(?:\w+\.)*message\(\s*[\"']([A-Za-z_]\w*/[A-Za-z_]\w*)[\"']")

Constant = bool | int | float | str
"""What a constant of a message type may be."""


class FieldInfo(msgspec.Struct, frozen=True):
    """One field of a message."""

    name: str
    type: str
    default: object
    """Plain data; None for one that is required."""
    description: str
    """Its docstring: what it means, its unit."""


class Interface(msgspec.Struct, frozen=True):
    """A message type."""

    name: str
    description: str
    fields: list[FieldInfo]
    constants: dict[str, Constant]
    module: str


Kind = Literal["message", "service", "action"]

PARTS: dict[Kind, tuple[str, ...]] = {
    "service": ("Request", "Response"),
    "action": ("Goal", "Result", "Feedback"),
}
"""The messages of which the other kinds are made, as their names end."""


class Listed(msgspec.Struct, frozen=True):
    """A type as a list shows it."""

    name: str
    kind: Kind
    description: str
    """Its first sentence; empty for a type of the current folder that was not imported for it."""
    source: str
    """Its module, or the file that says it."""


class Places(NamedTuple):
    """Modules that may define a type, each with what it is called in a message: `module arm.messages, which …,`."""

    own: dict[str, str]
    """Those that are called as its group, or whose file says it."""
    others: dict[str, str]
    """All others that are announced."""
    failed: dict[str, str]
    """What is announced and no module: by what it is called, a sentence."""


def known() -> list[str]:
    """The names of all types, the parts of services and actions included, without importing files for it."""
    _import_declared()
    return sorted({*robo_messages.type_names(), *said_in(os.getcwd())})


def listed() -> list[Listed]:
    """All types, sorted by name; the parts of a service or an action as one."""
    return together(map(listing, known()))


def together(types: Iterable[Listed]) -> list[Listed]:
    """Types sorted by name; of several with one name the first."""
    found: dict[str, Listed] = {}
    for one in types:
        found.setdefault(one.name, one)
    return [found[name] for name in sorted(found)]


def listing(name: str) -> Listed:
    """One type as a list shows it, part of a service as the service; nothing is imported for it."""
    whole, kind = whole_of(name)
    if name not in robo_messages.type_names():
        return Listed(whole, kind, "", str(said_in(os.getcwd())[name]))
    type_ = robo_messages.find_type(name)
    owner = _owner(type_) if kind != "message" else type_
    return Listed(whole, kind, first_sentence(owner.__doc__ or ""), type_.__module__)


def whole_of(name: str) -> tuple[str, Kind]:
    """The service or the action of which a message is a part, or the message itself; and which of them it is."""
    for kind, parts in PARTS.items():
        for part in parts:
            if name.endswith(f"_{part}"):
                return name.removesuffix(f"_{part}"), kind
    return name, "message"


def first_parts(name: str) -> list[str]:
    """The messages by one of which it shows that there is a type of a name."""
    return [name, *(f"{name}_{parts[0]}" for parts in PARTS.values())]


def find(name: str) -> type[Message]:
    """The message class of a name, imported where that is needed.

    Raises:
        UnknownType: there is none; names what comes close.
        ContractError: the file or the module that should say it cannot be imported.
    """
    if is_there(name):
        return robo_messages.find_type(name)
    own_faults = []
    for module, what in places(name).own.items():
        if why := _imported(module):
            own_faults.append(f"{what} cannot be imported: {why}")
        elif is_there(name):
            return robo_messages.find_type(name)
    faults = _import_declared()
    if is_there(name):
        return robo_messages.find_type(name)
    raise missing(name, (one.name for one in listed()), own_faults, faults.values())


def is_there(name: str) -> bool:
    """Whether a type is known in this process, and not only what is left of a module that could not be imported."""
    return name in robo_messages.type_names() and robo_messages.find_type(name).__module__ in sys.modules


def missing(
    name: str, there: Iterable[str], own_faults: Sequence[str], faults: Iterable[str]
) -> UnknownType | ContractError:
    """What to say of a type that is not found.

    Args:
        name: what was asked for.
        there: the names of all types.
        own_faults: what is wrong with modules that should define it.
        faults: what is wrong with any that may.
    """
    if own_faults:
        return ContractError(own_faults[0])
    return UnknownType("\n".join([f"no message type is named {name!r}; {_suggest(name, there)}", *faults]))


@functools.lru_cache(1000)
def find_here(name: str) -> type[Message] | None:
    """The message class of a name; None where it is not known on this machine, or cannot be imported."""
    try:
        return find(name) if name else None
    except (UnknownType, ContractError):
        return None


def _suggest(name: str, there: Iterable[str]) -> str:
    """What may have been meant: a type whose last part it is, or one that is written alike."""
    there = list(there)
    by_last = {one.rpartition("/")[2].lower(): one for one in there}
    last = name.rpartition("/")[2].lower()
    meant = by_last.get(last) or closest(name, there)
    if meant is None and "/" not in name:
        near = closest(last, by_last)
        meant = by_last[near] if near is not None else None
    return f"did you mean {meant}?" if meant is not None else "robo interface list shows what there is"


def parts(name: str) -> list[str]:
    """The message types that a name stands for: itself, or those of a service or an action."""
    for there in (robo_messages.type_names, known):  # the second one may import
        if name in (names := there()):
            return [name]
        for suffixes in PARTS.values():
            if f"{name}_{suffixes[0]}" in names:
                return [f"{name}_{suffix}" for suffix in suffixes]
    return [name]


def describe(type_: type[Message]) -> Interface:
    """All that is known of a message type."""
    docs = _docs(type_)
    types = field_types(type_)
    fields = [
        FieldInfo(field.encode_name, types[field.encode_name], _default(field), docs.get(field.name, ""))
        for field in msgspec.structs.fields(type_)
    ]
    about = inspect.cleandoc(type_.__doc__ or "")
    return Interface(robo_messages.type_name(type_), about, fields, constants(type_), type_.__module__)


@functools.lru_cache(1024)  # to read and to parse source takes 8 ms, and a type that is within many is asked for often
def _docs(type_: type[Message]) -> Mapping[str, str]:
    return attribute_docs(type_)


def constants(type_: type[Message]) -> dict[str, Constant]:
    """The constants of a message type, in their order."""
    return {
        name: getattr(type_, name)
        for name, hint in get_type_hints(type_).items()
        if get_origin(hint) is ClassVar and isinstance(getattr(type_, name, None), Constant) and name.isupper()
    }


def inner_types(type_: type[Message]) -> dict[str, type[Message]]:
    """The fields of a message type that are messages or lists of messages."""
    info = shapes.type_info(type_)
    assert isinstance(info, shapes.StructType)
    found = {}
    for field in info.fields:
        inner: shapes.Type = field.type
        while not isinstance(inner, shapes.StructType):
            if isinstance(inner, shapes.Metadata):
                inner = inner.type
            elif isinstance(inner, (shapes.ListType, shapes.VarTupleType)):
                inner = inner.item_type
            else:
                break
        if isinstance(inner, shapes.StructType) and issubclass(inner.cls, Message):
            found[field.encode_name] = inner.cls
    return found


def default_text(value: object) -> str:
    """A default as JSON has it, but for NaN and infinities, which stand as they are."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return msgspec.json.encode(value).decode()


def _default(field: Any) -> object:
    if field.default is not msgspec.NODEFAULT:
        return msgspec.to_builtins(field.default)
    if field.default_factory is not msgspec.NODEFAULT:
        return msgspec.to_builtins(field.default_factory())
    return None


def _owner(type_: type[Message]) -> type[Any]:
    """The class that the parts of a service or an action stand in; a part itself where they stand alone."""
    outer = getattr(sys.modules[type_.__module__], type_.__qualname__.rpartition(".")[0], None)
    return outer if isinstance(outer, type) else type_


def places(*names: str) -> Places:
    """Where a type of one of these names may be defined; they are of one group. Nothing is imported."""
    announced_modules, failed = _declared()
    group, slash, _ = names[0].partition("/") if names else ("", "", "")
    own: dict[str, str] = {}
    if slash:
        named = (group, f"{group}_messages")
        own |= {module: what for module, what in announced_modules.items() if module.partition(".")[0] in named}
        said = said_in(os.getcwd())
        for file in (said[name] for name in names if name in said):
            own.setdefault(module_of(file, Path()), f"{file}, which says it,")
        for module in (group, f"{group}.messages", f"{group}_messages"):
            if is_module_name(module) and spec_of(module) is not None:
                own.setdefault(module, f"module {module}, where {group}/… may be,")
    others = {module: what for module, what in announced_modules.items() if module not in own}
    return Places(own, others, failed)


@functools.cache
def _declared() -> tuple[dict[str, str], dict[str, str]]:
    """The modules that are announced, with what each is called; and a sentence for what is none."""
    there, failed = packages.known()
    modules = {
        f"{package.module}.messages": f"the package {package.name}"
        for package in there.values()
        if spec_of(f"{package.module}.messages") is not None
    }
    for entry in announced.installed(announced.MESSAGES):
        group = f"the entry point group {announced.MESSAGES} of {entry.distribution}"
        modules.setdefault(entry.value.partition(":")[0].strip(), group)
    for name in os.environ.get(MESSAGES_VARIABLE, "").split(","):
        if name.strip():
            modules.setdefault(name.strip(), MESSAGES_VARIABLE)
    found = {}
    for module, by in modules.items():
        if is_module_name(module):
            found[module] = f"module {module}, which {by} names,"
        else:
            failed[module] = f"{shown(module)}, which {by} names, is no name of a module"
    return found, failed


@functools.cache
def _import_declared() -> dict[str, str]:
    """Import the modules that are announced; those that cannot be, each with a sentence that says why."""
    modules, failed = _declared()
    faults = dict(failed)
    for module, what in modules.items():
        if why := _imported(module):
            faults[module] = f"{what} cannot be imported: {why}"
    return faults


@functools.cache
def _imported(module: str) -> str:
    """Import a module; why that cannot be done, or nothing."""
    _make_importable(os.getcwd())
    with contextlib.redirect_stdout(sys.stderr):
        try:
            importlib.import_module(module)
        except (Exception, SystemExit) as error:  # a user's module may raise anything while it is imported
            return explained(error)
    return ""


def _make_importable(folder: str) -> None:
    """From now on: what a module imports later, while it runs, is found there too."""
    if folder not in sys.path:
        sys.path.insert(0, folder)


@functools.cache
def said_in(folder: str) -> dict[str, Path]:
    """Types by name with the files below a folder that say them; found by reading, not by importing."""
    found: dict[str, Path] = {}
    for number, file in enumerate(python_files(Path(folder))):
        if number >= _MOST_FILES:
            break
        with contextlib.suppress(UnreadableFile):
            source = read_bytes(file)
            for name in _registered(source) if _REGISTERS.search(source) else ():
                found.setdefault(name, file.relative_to(folder))
    return found


def _registered(source: bytes) -> Iterator[str]:
    """The types that a file's classes are decorated with; in a file that is no Python, what looks like it."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError):
        yield from (match[1].decode() for match in _REGISTERS.finditer(source))
        return
    for node in ast.walk(tree):
        for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else ():
            match = _REGISTERS.match(b"@" + ast.unparse(decorator).encode())
            if match is not None:
                yield match[1].decode()
