"""Message and service types: those that ship, and those of users' packages.

A package of your own is found where it is installed with an entry point in the group `robo.packages` and has a
module `messages`, or in the group `robo.messages`, where ROBO_MESSAGES names its modules, and where a Python file
below the current folder says `@message("group/Type")`. A file is imported when one of its types is asked for.
"""

import ast
import contextlib
import functools
import importlib
import importlib.util
import inspect
import math
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, Literal, get_origin, get_type_hints

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
    constants: dict[str, int]
    module: str


class Listed(msgspec.Struct, frozen=True):
    """A type as a list shows it."""

    name: str
    kind: Literal["message", "service"]
    description: str
    """Its first sentence; empty for a type of the current folder that was not imported for it."""
    source: str
    """Its module, or the file that says it."""


def known() -> list[str]:
    """The names of all types, messages first halves of services included, without importing files for it."""
    _import_declared()
    return sorted({*robo_messages.type_names(), *_in_folder(os.getcwd())})


def broken() -> list[str]:
    """What cannot be imported of the modules that are announced: a sentence for each. The others work."""
    return list(_import_declared().values())


def listed() -> list[Listed]:
    """All types, sorted by name; the two halves of a service as one."""
    found: dict[str, Listed] = {}
    for name in known():
        service = name.removesuffix("_Request").removesuffix("_Response")
        kind: Literal["message", "service"] = "service" if service != name else "message"
        if name in robo_messages.type_names():
            type_ = robo_messages.find_type(name)
            owner = _owner(type_) if kind == "service" else type_
            about, source = first_sentence(owner.__doc__ or ""), type_.__module__
        else:
            about, source = "", str(_in_folder(os.getcwd())[name])
        found.setdefault(service, Listed(service, kind, about, source))
    return [found[name] for name in sorted(found)]


def find(name: str) -> type[Message]:
    """The message class of a name, imported where that is needed.

    Raises:
        UnknownType: there is none; names what comes close.
        ContractError: the file or the module that should say it cannot be imported.
    """
    try:
        return robo_messages.find_type(name)
    except UnknownType:
        pass
    failed = _import_declared()
    if name not in robo_messages.type_names():
        file = _in_folder(os.getcwd()).get(name)
        if file is not None:
            _import_file(file)
        elif (group := name.partition("/")[0]) and "/" in name:
            for module, why in failed.items():
                if module.partition(".")[0] in (group, f"{group}_messages"):
                    raise ContractError(why)
            _import_group(group)
    if name in robo_messages.type_names():
        return robo_messages.find_type(name)
    raise UnknownType("\n".join([f"no message type is named {name!r}; {_suggest(name)}", *failed.values()]))


@functools.lru_cache(1000)
def find_here(name: str) -> type[Message] | None:
    """The message class of a name; None where it is not known on this machine, or cannot be imported."""
    try:
        return find(name) if name else None
    except (UnknownType, ContractError):
        return None


def _suggest(name: str) -> str:
    """What may have been meant: a type whose last part it is, or one that is written alike."""
    there = dict.fromkeys(one.name for one in listed())
    by_last = {one.rpartition("/")[2].lower(): one for one in there}
    last = name.rpartition("/")[2].lower()
    meant = by_last.get(last) or closest(name, there)
    if meant is None and "/" not in name:
        near = closest(last, by_last)
        meant = by_last[near] if near is not None else None
    return f"did you mean {meant}?" if meant is not None else "robo interface list shows what there is"


def halves(name: str) -> list[str]:
    """The message types that a name stands for: itself, or the request and the response of a service."""
    both = [f"{name}_Request", f"{name}_Response"]
    return both if name not in known() and both[0] in known() else [name]


def describe(type_: type[Message]) -> Interface:
    """All that is known of a message type."""
    docs = attribute_docs(type_)
    types = field_types(type_)
    fields = [
        FieldInfo(field.encode_name, types[field.encode_name], _default(field), docs.get(field.name, ""))
        for field in msgspec.structs.fields(type_)
    ]
    about = inspect.cleandoc(type_.__doc__ or "")
    return Interface(robo_messages.type_name(type_), about, fields, constants(type_), type_.__module__)


def constants(type_: type[Message]) -> dict[str, int]:
    """The constants of a message type, in their order."""
    return {
        name: getattr(type_, name)
        for name, hint in get_type_hints(type_).items()
        if get_origin(hint) is ClassVar and isinstance(getattr(type_, name, None), int) and name.isupper()
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
    """The class that a service's two halves stand in; a half itself where they stand alone."""
    outer = getattr(sys.modules[type_.__module__], type_.__qualname__.rpartition(".")[0], None)
    return outer if isinstance(outer, type) else type_


@functools.cache
def _import_declared() -> dict[str, str]:
    """Import the modules that are announced; those that cannot be, each with a sentence that says why."""
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
    for module, by in modules.items():
        if not is_module_name(module):
            failed[module] = f"{shown(module)}, which {by} names, is no name of a module"
            continue
        try:
            _import(module, f"module {module}, which {by} names,")
        except ContractError as error:
            failed[module] = str(error)
    return failed


@functools.cache
def _import_group(group: str) -> None:
    """`my_robot/Gripper` may be in `my_robot`, `my_robot.messages` or `my_robot_messages`."""
    _make_importable(os.getcwd())
    for module in (group, f"{group}.messages", f"{group}_messages"):
        with contextlib.suppress(ModuleNotFoundError, ValueError):  # there is none, or its parent is no package
            if importlib.util.find_spec(module) is not None:
                _import(module, f"module {module}, where {group}/… may be,")


def _import_file(file: Path) -> None:
    _import(module_of(file, Path()), f"{file}, which says it,")


def _import(module: str, what: str) -> None:
    _make_importable(os.getcwd())
    with contextlib.redirect_stdout(sys.stderr):
        try:
            importlib.import_module(module)
        except (Exception, SystemExit) as error:  # a user's module may raise anything while it is imported
            raise ContractError(f"{what} cannot be imported: {explained(error)}") from None


def _make_importable(folder: str) -> None:
    """From now on: what a module imports later, while it runs, is found there too."""
    if folder not in sys.path:
        sys.path.insert(0, folder)


@functools.cache
def _in_folder(folder: str) -> dict[str, Path]:
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
