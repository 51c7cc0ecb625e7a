"""The arguments of a manifest: what is given over what is declared, each with its type."""

import os
from collections.abc import Mapping
from pathlib import Path

import pytest

from robo.launch.arguments import (
    COMMAND_LINE,
    ArgumentInfo,
    Given,
    PathArgument,
    describe,
    evaluate,
    missing,
    paths,
)
from robo.launch.manifest import Manifest
from robo.launch.reader import read
from robo.launch.substitution import BROKEN, Scope, Shared, Word
from robo.text.tree import Position, Problem


def declared(args: str) -> Manifest:
    problems: list[Problem] = []
    found = read(f"args: {{{args}}}", Path("dir/m.yaml"), problems)
    assert found is not None
    assert not problems
    return found


def values(
    args: str, given: Mapping[str, object] | None = None, *, stand_ins: bool = False
) -> tuple[dict[str, object], list[str]]:
    """The values of declared arguments but for the robot's name, and the mistakes."""
    told: list[str] = []
    manifest = declared(args)
    scope = Scope(manifest.file, {}, Shared())
    found = evaluate(
        manifest,
        Given(given or {}, Path("/here"), COMMAND_LINE),
        scope,
        lambda where, text: told.append(f"{where}: {text}"),
        stand_ins=stand_ins,
    )
    return {name: value for name, value in found.items() if name != "robot_name" or "robot_name" in args}, told


# -- types -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("form", "given", "value"),
    [
        ("{type: str}", "1.10", "1.10"),
        ("{type: str}", "true", "true"),
        ("{type: int}", "7", 7),
        ("{type: int}", "0x10", 16),
        ("{type: float}", "1e-3", 0.001),
        ("{type: float}", "2", 2.0),
        ("{type: bool}", "true", True),
        ("{type: bool}", "False", False),
        ("{type: path}", "x/y", "/here/x/y"),
        ("{type: path}", "../y", "/y"),
        ("{type: path}", "/abs", "/abs"),
        ("{type: path}", "~/z", os.path.expanduser("~/z")),
        ("{type: path}", "", ""),
        ("{choices: [slow, fast]}", "fast", "fast"),
        ("{choices: [1, 2], type: int}", "2", 2),
        ("{choices: [1.0, true]}", "true", True),
    ],
)
def test_a_word_of_the_command_line_is_what_its_argument_is(form: str, given: str, value: object) -> None:
    found, told = values(f"a: {form}", {"a": Word(given)})
    assert not told
    assert found == {"a": value}
    assert type(found["a"]) is type(value)


@pytest.mark.parametrize(
    ("form", "given", "message"),
    [
        ("{type: int}", "2.5", "argument a: '2.5' is no int; write a whole number, for example 3"),
        ("{type: int}", "true", "argument a: 'true' is no int"),
        ("{type: float}", "fast", "argument a: 'fast' is no float; write a number, for example 0.5"),
        ("{type: float}", "9" * 400, "argument a: "),
        ("{type: bool}", "yes", "argument a: 'yes' is no bool; write true or false"),
        ("{choices: [slow, fast]}", "fats", "argument a: 'fats' is none of slow, fast; did you mean fast?"),
        ("{choices: [1, 2], type: int}", "3", "argument a: '3' is none of 1, 2"),
    ],
)
def test_a_value_of_another_type_is_a_mistake_of_the_command_line(form: str, given: str, message: str) -> None:
    found, told = values(f"a: {form}", {"a": Word(given)})
    assert found == {"a": BROKEN}
    (mistake,) = told
    assert mistake.startswith(f"command line: {message}")


# -- defaults ----------------------------------------------------------------------------------------------


def test_a_default_may_use_arguments_before_it() -> None:
    found, told = values("speed: 2, twice: {type: str, default: '${speed}${speed}'}, path: {type: path, default: x}")
    assert not told
    assert found == {"speed": 2, "twice": "22", "path": f"{Path.cwd()}/dir/x"}, "a path is beside the manifest"


def test_a_default_with_a_mistake_is_told_once() -> None:
    found, told = values("a: '${b}', b: '${a}', c: {type: int, default: '${a}'}")
    assert found == {"a": BROKEN, "b": BROKEN, "c": BROKEN}
    (mistake,) = told
    assert mistake.startswith("dir/m.yaml:1:12: ${b} is not defined")


def test_a_choice_with_a_mistake_is_told() -> None:
    _, told = values("a: {choices: [x, '${q}'], default: x}")
    assert len(told) == 1


def test_what_has_to_be_given() -> None:
    found, told = values("speed: {type: float, description: of the base}, world: ")
    assert found == {"speed": BROKEN, "world": BROKEN}
    assert told == [
        "dir/m.yaml:1:8: m.yaml needs speed (of the base); give it as speed:=VALUE",
        "dir/m.yaml:1:56: m.yaml needs world; give it as world:=VALUE",
    ]
    manifest = declared("speed: {type: float}, world: , n: 1")
    assert missing(manifest, {}) == ["speed", "world"]
    assert missing(manifest, {"world": "x"}) == ["speed"]


@pytest.mark.parametrize(
    ("form", "value"),
    [
        ("{type: int}", 1), ("{type: float}", 1.0), ("{type: bool}", False), ("{type: str}", "<a>"),
        ("{type: path}", "<a>"), ("{choices: [slow, fast]}", "slow"),
    ],
)  # fmt: skip
def test_for_a_check_a_value_of_its_type_stands_in(form: str, value: object) -> None:
    assert values(f"a: {form}", stand_ins=True) == ({"a": value}, [])


def test_an_argument_that_is_not_declared_is_a_mistake() -> None:
    _, told = values("speed: 1", {"sped": Word("2")})
    assert told == ["command line: m.yaml has no argument 'sped'; did you mean speed?"]
    assert values("speed: 1", {"robot_name": Word("r1")})[1] == [], "which every manifest has"


# -- the robot's name ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("args", "given", "robot"),
    [
        ("n: 1", {}, "my_robot"),
        ("n: 1", {"robot_name": "/site/r1/"}, "site/r1"),
        ("robot_name: r5", {}, "r5"),
        ("robot_name: r5", {"robot_name": "r7"}, "r7"),
        ("robot_name: {choices: [r5, r7], default: r5}", {"robot_name": "/r7"}, "r7"),
    ],
)
def test_the_robots_name_is_always_an_argument(args: str, given: dict[str, object], robot: str) -> None:
    manifest = declared(args)
    told: list[str] = []
    found = evaluate(
        manifest,
        Given(given, Path(), COMMAND_LINE),
        Scope(manifest.file, {}, Shared()),
        lambda _where, text: told.append(text),
    )
    assert not told
    assert found["robot_name"] == robot


@pytest.mark.parametrize("robot", [Word("r-1"), "", "a//b"])
def test_a_robots_name_that_is_not_valid_is_told_once(robot: object) -> None:
    found, told = values("robot_name: r1", {"robot_name": robot})
    assert found["robot_name"] is BROKEN
    assert len(told) == 1
    assert told[0].startswith("command line: robot name ")


def test_a_robots_name_that_is_broken_elsewhere_is_not_told_again() -> None:
    assert values("robot_name: r1", {"robot_name": BROKEN}) == ({"robot_name": BROKEN}, [])


# -- paths, and what can be said of arguments ------------------------------------------------------------------


def test_paths_that_have_to_be_there() -> None:
    manifest = declared("log: {type: path, default: x.log}, out: {type: path, default: y, exists: false}, n: 1")
    given = Given({"log": "z.log"}, Path("/here"), COMMAND_LINE, {"log": Position("outer.yaml", 3, 4)})
    told: list[str] = []
    found = evaluate(manifest, given, Scope(manifest.file, {}, Shared()), lambda _where, text: told.append(text))
    assert paths(manifest, given, found) == [PathArgument("log", "/here/z.log", Position("outer.yaml", 3, 4))]
    by_default = Given({}, Path("/here"), COMMAND_LINE)
    found = evaluate(manifest, by_default, Scope(manifest.file, {}, Shared()), lambda _where, text: told.append(text))
    (path,) = paths(manifest, by_default, found)
    assert (path.path, path.position.file) == (f"{Path.cwd()}/dir/x.log", "dir/m.yaml")
    assert not told


def test_what_is_said_of_arguments() -> None:
    manifest = declared("speed: {type: float, description: of the base}, mode: {choices: [a, b], default: '${x}'}")
    assert describe(manifest) == [
        ArgumentInfo("robot_name", "str", False, "my_robot", (), "the robot's name"),
        ArgumentInfo("speed", "float", True, None, (), "of the base"),
        ArgumentInfo("mode", "choice", False, "${x}", ("a", "b"), ""),
    ]
    assert [info.name for info in describe(declared("n: 1, robot_name: r1"))] == ["n", "robot_name"]
