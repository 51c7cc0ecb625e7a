"""The arguments of a manifest: what is given over what is declared, each with its type."""

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from robo.errors import InvalidName
from robo.launch.expression import as_text
from robo.launch.manifest import Arg, Manifest
from robo.launch.substitution import BROKEN, Complain, Scope, Word, settled, told
from robo.text.brief import shown
from robo.text.suggestions import hint, suggest
from robo.text.tree import Position
from robo.wire import names

ROBOT_NAME = "robot_name"
DEFAULT_ROBOT = "my_robot"
COMMAND_LINE = Position("command line", 0, 0)

_HINTS = {
    "bool": "write true or false",
    "int": "write a whole number, for example 3",
    "float": "write a number, for example 0.5",
}


class Given:
    """Values for arguments, from one place."""

    def __init__(
        self, values: Mapping[str, object], folder: Path, position: Position, places: Mapping[str, Position] = {}
    ) -> None:
        """
        Args:
            values: by name.
            folder: what relative paths among them are relative to.
            position: where they are given.
            places: where each is given, if known.
        """
        self.values = values
        self.folder = folder
        self._position = position
        self._places = places

    def place(self, name: str) -> Position:
        """Where a value is given."""
        return self._places.get(name, self._position)


def evaluate(
    manifest: Manifest, given: Given, scope: Scope, complain: Complain, *, stand_ins: bool = False
) -> dict[str, object]:
    """The value of every argument of a manifest.

    Args:
        manifest: declares them; an argument's default may use those before it.
        given: what is given.
        scope: the manifest's.
        complain: takes the mistakes.
        stand_ins: an argument that has to be given and is not gets a value of its type, for a check.
    """
    _refuse_unknown(manifest, given, complain)
    robot = given.values.get(ROBOT_NAME, DEFAULT_ROBOT)
    if robot is not BROKEN:
        robot = _robot_name(as_text(robot), given.place(ROBOT_NAME), complain)
    values: dict[str, object] = {ROBOT_NAME: robot}
    for arg in manifest.args:
        inner = scope.inner(values)
        choices = [told(inner.value(choice), complain) for choice in arg.choices]
        if arg.name == ROBOT_NAME and values[ROBOT_NAME] is BROKEN:
            continue
        if arg.name == ROBOT_NAME and arg.name in given.values:
            values[arg.name] = _typed(arg, values[ROBOT_NAME], choices, given.folder, given.place(arg.name), complain)
        elif arg.name in given.values:
            values[arg.name] = _typed(
                arg, given.values[arg.name], choices, given.folder, given.place(arg.name), complain
            )
        elif arg.default is not None:
            default = told(inner.raw(arg.default), complain)
            values[arg.name] = _typed(arg, default, choices, inner.folder, arg.default.position, complain)
            if arg.name == ROBOT_NAME and values[arg.name] is not BROKEN:
                values[arg.name] = _robot_name(as_text(values[arg.name]), arg.default.position, complain)
        elif stand_ins:
            values[arg.name] = _stand_in(arg, choices)
        else:
            about = f" ({arg.description})" if arg.description else ""
            text = f"{manifest.file.name} needs {arg.name}{about}; give it as {arg.name}:=VALUE"
            complain(arg.position, text)
            values[arg.name] = BROKEN
    return values


class PathArgument(msgspec.Struct, frozen=True):
    """A path that has to be there when something that is told of it starts."""

    name: str
    path: str
    """Absolute."""
    position: Position
    """Where it is given, or its default."""


def paths(manifest: Manifest, given: Given, values: Mapping[str, object]) -> list[PathArgument]:
    """The paths among the values of a manifest's arguments, but for those that are yet to be made."""
    found = []
    for arg in manifest.args:
        path = values[arg.name]
        if arg.type == "path" and arg.exists and isinstance(path, str) and os.path.isabs(path):
            default = arg.default
            place = given.place(arg.name) if default is None or arg.name in given.values else default.position
            found.append(PathArgument(arg.name, path, place))
    return found


class ArgumentInfo(msgspec.Struct, frozen=True):
    """What can be said of an argument without starting anything."""

    name: str
    type: str
    required: bool
    default: object
    """As written, substitutions included."""
    choices: tuple[object, ...]
    description: str


def describe(manifest: Manifest) -> list[ArgumentInfo]:
    """The arguments of a manifest; the robot's name is always one."""
    infos = [
        ArgumentInfo(
            arg.name,
            arg.type,
            arg.default is None,
            None if arg.default is None else arg.default.value,
            tuple(choice.value for choice in arg.choices),
            arg.description,
        )
        for arg in manifest.args
    ]
    if not any(info.name == ROBOT_NAME for info in infos):
        infos.insert(0, ArgumentInfo(ROBOT_NAME, "str", False, DEFAULT_ROBOT, (), "the robot's name"))
    return infos


def missing(manifest: Manifest, given: Mapping[str, object]) -> list[str]:
    """The names of the arguments that have to be given and are not."""
    return [arg.name for arg in manifest.args if arg.default is None and arg.name not in given]


def _refuse_unknown(manifest: Manifest, given: Given, complain: Complain) -> None:
    declared = [arg.name for arg in manifest.args]
    for name in given.values:
        if name not in declared and name != ROBOT_NAME:
            instead = suggest(name, declared, "it has")
            complain(given.place(name), f"{manifest.file.name} has no argument {shown(name)}; {instead}")


def _robot_name(name: str, position: Position, complain: Complain) -> object:
    """A robot's name without slashes around it; BROKEN, with a mistake, where it is not valid."""
    try:
        return names.robot_name(name)
    except InvalidName as error:
        complain(position, str(error))
        return BROKEN


def _typed(
    arg: Arg, value: object, choices: Sequence[object], folder: Path, position: Position, complain: Complain
) -> object:
    """A value as the type of its argument; BROKEN, with a mistake, where it does not fit."""
    if value is BROKEN:
        return BROKEN
    found = _convert(arg, value, folder)
    if found is BROKEN:
        complain(position, f"argument {arg.name}: {shown(value)} is no {arg.type}; {_HINTS[arg.type]}")
        return BROKEN
    if not choices:
        return found
    for choice in choices:
        if found == choice or as_text(found) == as_text(choice):
            return choice
    texts = [as_text(choice) for choice in choices]
    meant = hint(as_text(found), texts)
    complain(position, f"argument {arg.name}: {shown(value)} is none of {', '.join(texts)}{meant}")
    return BROKEN


def _convert(arg: Arg, value: object, folder: Path) -> object:
    if arg.type in ("str", "choice"):
        return str(value) if isinstance(value, Word) else as_text(value) if arg.type == "str" else value
    if arg.type == "path":
        text = as_text(value)
        if text.startswith("~/"):
            text = os.path.expanduser(text)
        return os.path.abspath(folder / text) if text else ""
    plain = settled(value)
    if arg.type == "bool":
        return plain if isinstance(plain, bool) else BROKEN
    if isinstance(plain, bool) or not isinstance(plain, (int, float)):
        return BROKEN
    if arg.type == "float":
        return float(plain) if isinstance(plain, float) or abs(plain) < sys.float_info.max else BROKEN
    return plain if isinstance(plain, int) else BROKEN


def _stand_in(arg: Arg, choices: Sequence[object]) -> object:
    if choices:
        return choices[0]
    return {"int": 1, "float": 1.0, "bool": False}.get(arg.type, f"<{arg.name}>")
