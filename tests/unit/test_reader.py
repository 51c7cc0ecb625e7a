"""From the text of a manifest to a typed tree: each part with its place, each mistake once."""

from pathlib import Path
from typing import Any

import pytest

from robo.launch.manifest import Group, Manifest, NodeEntry
from robo.launch.reader import read
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar, Tree, plain


def manifest(text: str) -> tuple[Manifest, list[str]]:
    problems: list[Problem] = []
    found = read(text, Path("m.yaml"), problems)
    assert found is not None
    return found, [f"{problem.position.line}:{problem.position.column}: {problem.text}" for problem in problems]


def group(text: str) -> tuple[Group, list[str]]:
    found, mistakes = manifest(f"groups: {{g: {{nodes: {{}}, {text}}}}}")
    return found.groups[0], mistakes


def node(text: str) -> tuple[NodeEntry, list[str]]:
    found, mistakes = manifest(f"groups: {{g: {{nodes: {{a: {{run: x, {text}}}}}}}}}")
    return found.groups[0].nodes[0], mistakes


def shown(tree: Tree | None) -> Any:
    return plain(tree) if tree is not None else None


def pairs(entries: tuple[Entry, ...]) -> dict[str, object]:
    return {entry.key: shown(entry.value) for entry in entries}


# -- whole manifests -------------------------------------------------------------------------------------


def test_a_manifest_with_everything() -> None:
    found, mistakes = manifest(
        """\
description: all of it
args: {a: 1}
include: [other.yaml, {file: third.yaml}]
topics: {odom: nav/Odometry}
groups:
  g:
    groups: {inner: {nodes: {b: {service: s}}}}
    nodes: {a: {run: x}}
"""
    )
    assert not mistakes
    assert found.description == "all of it"
    assert [arg.name for arg in found.args] == ["a"]
    assert [include.file.value for include in found.includes] == ["other.yaml", "third.yaml"]
    assert found.topics[0].promise["type"] == Scalar("nav/Odometry", Position("m.yaml", 4, 16))
    (outer,) = found.groups
    assert (outer.key, outer.position) == ("g", Position("m.yaml", 6, 3))
    assert (outer.groups[0].nodes[0].key, outer.nodes[0].key) == ("b", "a")


def test_an_empty_manifest_and_one_that_is_no_map() -> None:
    assert manifest("") == (Manifest(file=Path("m.yaml")), [])
    found, mistakes = manifest("- a")
    assert found == Manifest(file=Path("m.yaml"))
    assert mistakes == ["1:1: a manifest is a map, not a list"]


def test_what_is_no_yaml_is_no_manifest() -> None:
    problems: list[Problem] = []
    assert read("groups: [", Path("m.yaml"), problems) is None
    assert len(problems) == 1


def test_all_mistakes_of_a_file_are_told_at_once() -> None:
    _, mistakes = manifest(
        """\
descripton: x
args: [a]
groups:
  1st: {nodes: {}}
  g:
    restart: allways
    nodes:
      a: {run: x, needz: b, log: {levle: info}}
      b: 5
"""
    )
    assert {line.split(" ")[0] for line in mistakes} == {"1:1:", "2:7:", "4:3:", "6:14:", "8:19:", "8:35:", "9:10:"}
    assert len(mistakes) == 7


# -- arguments -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "type_", "default", "choices"),
    [
        ("3", "int", 3, []),
        ("0.5", "float", 0.5, []),
        ("true", "bool", True, []),
        ("x", "str", "x", []),
        ("", "str", None, []),
        ("{}", "str", None, []),
        ("{default: 2, type: float}", "float", 2, []),
        ("{choices: [a, b]}", "choice", None, ["a", "b"]),
        ("{choices: [1, 2], type: int, default: 1}", "int", 1, [1, 2]),
        ("{type: path, default: x, exists: false}", "path", "x", []),
        ("{required: true}", "str", None, []),
        ("{default: 1, required: false}", "int", 1, []),
    ],
)
def test_arguments(text: str, type_: str, default: object, choices: list[object]) -> None:
    found, mistakes = manifest(f"args: {{a: {text}}}")
    (arg,) = found.args
    assert not mistakes
    assert (arg.type, shown(arg.default)) == (type_, default)
    assert [choice.value for choice in arg.choices] == choices
    assert arg.exists is ("exists" not in text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{a-b: 1}", "1:8: 'argument a-b': use letters, digits and _, not starting with a digit"),
        ("{index: 1}", "1:8: argument index: this name is taken, ${index} has a meaning of its own"),
        ("{a: [1]}", "1:11: argument a: expected a default value or a map, not a list"),
        (
            "{a: {required: false}}",
            "1:22: argument a has no default, so it has to be given: required: false contradicts",
        ),
        ("{a: {type: path, exists: maybe, default: x}}", "1:32: argument a: exists is true or false, not 'maybe'"),
        ("{a: {choices: x, type: choice, default: x}}", ""),
        ("{a: {choices: [], default: x}}", "1:21: choices: expected a text or a list of words, not a list"),
        ("{a: {descripton: x}}", "1:12: unknown key 'descripton' in argument a; did you mean description?"),
        ("{a: {default: [1]}}", "1:21: default: expected a single value, not a list"),
    ],
)
def test_mistakes_in_arguments(text: str, message: str) -> None:
    _, mistakes = manifest(f"args: {text}")
    assert len(mistakes) == (1 if message else 0)
    assert "".join(mistakes).startswith(message)


# -- groups and nodes ------------------------------------------------------------------------------------


def test_plain_keys_stay_trees_in_their_form() -> None:
    found, mistakes = node(
        "restart: always, stop: {timeout: 3}, cpus: [0, 1], watchdog: '${w}', required: on > 1, log: debug"
    )
    assert not mistakes
    assert {name: shown(tree) for name, tree in found.plain.items()} == {
        "run": "x",
        "restart": {"policy": "always"},
        "stop": {"timeout": 3},
        "cpus": [0, 1],
        "watchdog": "${w}",
        "required": "on > 1",
        "log": {"level": "debug"},
    }
    restart = found.plain["restart"]
    assert isinstance(restart, Map)
    assert restart.entries[0].position.column == restart.position.column, "a short form stands where it is written"


@pytest.mark.parametrize(
    ("text", "log"),
    [
        ("file", {"output": "file"}),
        ("warn", {"level": "warn"}),
        ("'${where}'", {"output": "${where}"}),
        ("{level: warn, output: file}", {"level": "warn", "output": "file"}),
        ("{}", {}),
    ],
)
def test_a_short_form_of_several_keys_is_told_by_its_word(text: str, log: dict[str, str]) -> None:
    found, mistakes = group(f"log: {text}")
    assert not mistakes
    assert shown(found.plain["log"]) == log


def test_a_group_has_those_keys_alone_that_are_for_all_in_it() -> None:
    found, mistakes = group("restart: never, log: file, namespace: r1, hosts: [a, b]")
    assert not mistakes
    assert set(found.plain) == {"restart", "log"}
    assert found.namespace is not None
    assert shown(found.hosts) == ["a", "b"]
    _, mistakes = group("watchdog: 5")
    assert mistakes[0].startswith("1:25: unknown key 'watchdog' in group 'g'; it may hold args, bridges, env")


def test_a_node_that_is_no_map_is_there_all_the_same() -> None:
    found, mistakes = manifest("groups: {g: {nodes: {a: 5, b: {run: x, needs: a}}}}")
    assert [one.key for one in found.groups[0].nodes] == ["a", "b"]
    assert len(mistakes) == 1


def test_a_misspelt_program_is_one_mistake() -> None:
    _, mistakes = manifest("groups: {g: {nodes: {a: {servce: x}}}}")
    assert len(mistakes) == 1
    assert "did you mean service?" in mistakes[0]


@pytest.mark.parametrize(
    ("text", "needs"),
    [
        ("b", [("b", "ready")]),
        ("[b, c]", [("b", "ready"), ("c", "ready")]),
        ("{b: started, c: completed}", [("b", "started"), ("c", "completed")]),
        ("{}", []),
    ],
)
def test_needs(text: str, needs: list[tuple[str, str]]) -> None:
    found, mistakes = node(f"needs: {text}")
    assert not mistakes
    assert found.needs is not None
    assert [(need.node.value, need.until) for need in found.needs] == needs


def test_loops() -> None:
    counted, mistakes = node("replicas: 3")
    assert not mistakes
    assert counted.looped
    assert shown(counted.replicas) == 3
    each, mistakes = node("for_each: {robot: [r1, {name: r2}]}")
    assert not mistakes
    assert each.for_each is not None
    assert (each.for_each.variable, plain(each.for_each.items)) == ("robot", ["r1", {"name": "r2"}])
    assert not node("if: on")[0].looped


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("replicas: 2, for_each: {r: [1]}", "replicas and for_each exclude each other; keep one"),
        ("replicas: 2, for_each: 5", "replicas and for_each exclude each other; keep one"),
        ("for_each: {a: [1], b: [2]}", "for_each: expected one name with its list: {robot: [r1, r2]}"),
        ("for_each: [a]", "for_each: expected a map, not a list"),
        ("for_each: {index: [1]}", "for_each: 'index' cannot be a name for its items"),
        ("for_each: {r: 5}", "for_each r: expected a list, not 5"),
        ("replicas: [2]", "replicas: expected a single value, not a list"),
    ],
)
def test_a_loop_with_a_mistake_is_none(text: str, message: str) -> None:
    found, mistakes = node(text)
    assert not found.looped
    (mistake,) = mistakes
    assert mistake.endswith(message)


# -- includes, parameters, environment -------------------------------------------------------------------


def test_arguments_of_a_group_are_for_its_includes_whose_own_come_over_them() -> None:
    found, mistakes = group("args: {a: 1, b: 2}, include: [x.yaml, {file: y.yaml, args: {b: 3}}]")
    assert not mistakes
    assert [pairs(include.args) for include in found.includes] == [{"a": 1, "b": 2}, {"a": 1, "b": 3}]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[a]]", "include: expected a file or a map, not a list"),
        ("{args: {}}", "an include names its file: {file: robot.yaml, args: {…}}"),
        ("{file: [a]}", "file: expected a single value, not a list"),
        ("{fiel: a.yaml}", "unknown key 'fiel' in an include; did you mean file?"),
        ("{file: a, args: {b: [1]}}", "args b: expected a single value, not a list"),
        ("{file: a, override: {n: 5}}", "override of 'n': expected a map, not 5"),
    ],
)
def test_mistakes_in_includes(text: str, message: str) -> None:
    _, mistakes = manifest(f"include: {text}")
    assert mistakes[0].endswith(message)


def test_an_override_is_a_node_that_need_not_say_what_it_runs() -> None:
    found, mistakes = manifest("include: {file: a, override: {n: {required: true, params: {x: 1}}}}")
    assert not mistakes
    (changed,) = found.includes[0].override
    assert (changed.key, set(changed.plain)) == ("n", {"required"})


@pytest.mark.parametrize(
    ("text", "sources"),
    [
        ("p.yaml", [("p.yaml", None)]),
        ("{speed: 1}", [(None, {"speed": 1})]),
        ("[p.yaml, {speed: 1}]", [("p.yaml", None), (None, {"speed": 1})]),
        ("{file: 1}", [(None, {"file": 1})]),
        ("{if: on, file: p.yaml}", [("p.yaml", {})]),
        ("{if: on, speed: 1}", [(None, {"speed": 1})]),
        ("{unless: on, file: p.yaml, values: {speed: 1}, more: 2}", [("p.yaml", {"speed": 1, "more": 2})]),
    ],
)
def test_parameters(text: str, sources: list[tuple[object, object]]) -> None:
    found, mistakes = node(f"params: {text}")
    assert not mistakes
    assert [(shown(source.file), shown(source.values)) for source in found.params] == sources
    guarded = "if:" in text or "unless:" in text
    assert all((source.when or source.unless) is not None for source in found.params) is guarded


def test_the_environment() -> None:
    found, mistakes = node("env: {A: b, C: 3, D: {value: e, if: on}}")
    assert not mistakes
    assert [(one.name, one.value.value, shown(one.when)) for one in found.env] == [
        ("A", "b", None), ("C", 3, None), ("D", "e", "on"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("env: {A=B: c}", "'env A=B' is no name of a variable"),
        ("env: {A: [b]}", "env A: expected a single value, not a list"),
        ("env: {A: {if: on}}", "env A: add value: …"),
        ("env: {A: {vlue: 1}}", "unknown key 'vlue' in env A; did you mean value?"),
        ("remap: {a: [b]}", "remap a: expected a single value, not a list"),
        ("publishes: odom", "publishes: expected a map, not 'odom'"),
        ("params: [[p]]", "params: expected a file or a map of values, not a list"),
        ("params: {if: on, values: 5}", "values: expected a map, not 5"),
        ("if: [on]", "if: expected a single value, not a list"),
        ("prefix: {a: b}", "prefix: expected a text or a list of words, not a map"),
        ("args: [a, [b]]", "args: expected a single value, not a list"),
        ("ready: {probe: []}", "probe: expected a text or a list of words, not a list"),
        ("needs: [[a]]", "needs: expected a single value, not a list"),
        ("needs: {a: [b]}", "needs a: expected a single value, not a list"),
    ],
)
def test_what_has_not_the_form_of_its_key_is_left_out(text: str, message: str) -> None:
    found, mistakes = node(text)
    (mistake,) = mistakes
    assert mistake.endswith(message)
    assert set(found.plain) <= {"run", "ready"}


def test_topics() -> None:
    found, mistakes = manifest("topics: {a: nav/Odometry, b: {rate: '>= 5', max_age: 1}, c: , d: [x]}")
    assert [(topic.name, {key: plain(tree) for key, tree in topic.promise.items()}) for topic in found.topics] == [
        ("a", {"type": "nav/Odometry"}), ("b", {"rate": ">= 5", "max_age": 1}), ("c", {"type": None}), ("d", {}),
    ]  # fmt: skip
    assert mistakes == ["1:66: topic: expected a value or a map, not a list"]


def test_items_of_a_loop_keep_their_places() -> None:
    found, _ = node("for_each: {r: [a, b]}")
    assert found.for_each is not None
    assert isinstance(found.for_each.items, Items)
    assert [item.position.column for item in found.for_each.items.items] == [49, 52]
