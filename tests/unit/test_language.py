"""A key of a manifest is said once: what a reader takes, how layers are merged, values and schema follow from it."""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import jsonschema
import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import Meta

from robo.launch.forms import A_PATTERN, A_RATE, SOME_TEXTS, Form, a_number
from robo.launch.language import (
    OF_GROUPS,
    KeysOf,
    Named,
    Written,
    definition,
    fields,
    fill,
    keys_of,
    merged,
    part_of,
    read,
    short_of,
    values_of,
)
from robo.launch.manifest import PARTS, Group, NodeEntry
from robo.launch.plan import LimitsPlan, LogPlan, ProcessPlan, ReadyPlan, RestartPlan, StopPlan, TopicPlan
from robo.launch.reader import read as read_manifest
from robo.launch.schema import SPECIAL, manifest_schema, parts
from robo.launch.substitution import Scope, Shared
from robo.text.tree import Entry, Map, Position, Problem, Scalar, Tree
from robo.text.yaml_tree import as_yaml, parse


class Engine(msgspec.Struct, frozen=True, kw_only=True):
    """A part that nobody but this test knows."""

    SHORT: ClassVar = ("fuel",)

    fuel: Annotated[Literal["gas", "oil"], Meta(description="What it burns.")] = "gas"
    power: Annotated[float, Meta(ge=1, le=100, description="At most, kW.")] = 10.0
    cylinders: Annotated[int, Meta(ge=1, description="How many.")] | None = None
    quiet: Annotated[bool, Meta(description="Whether it whispers.")] = False
    label: Annotated[str | None, Meta(description="What it is called.")] = None
    sound: Annotated[str | None, A_PATTERN, Meta(description="What it is like.")] = None
    least: Annotated[float | None, A_RATE, Named("speed"), Meta(description="Turns.")] = None
    serial: int = 0
    """No key: it has no sentence."""


class Reader:
    """Reads nothing but plain keys."""

    def __init__(self) -> None:
        self.mistakes: list[str] = []

    def complain(self, position: Position, text: str) -> None:
        self.mistakes.append(f"{position.line}:{position.column}: {text}")

    def part(self, name: str, entry: Entry) -> Any:
        raise AssertionError(name, entry)

    def special(self, name: str, tree: Tree) -> Any:
        raise AssertionError(name, tree)


SCHEMA = manifest_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
SCOPE = Scope(Path("m.yaml"), {"on": True, "n": 7, "word": "oil"}, Shared())


def tree_of(text: str) -> Tree:
    tree = parse(text, "m.yaml", [], placeholders=True)
    assert tree is not None
    return tree


def written(text: str, reader: Reader) -> Written:
    tree = tree_of(text)
    assert isinstance(tree, Map)
    found: Written = read(keys_of(Engine), fields(tree, "an engine", keys_of(Engine), reader), reader)
    return found


def engine(*texts: str) -> tuple[Engine, list[str]]:
    """What several layers, weakest first, make of an engine."""
    reader = Reader()
    layers = [fill(keys_of(Engine), written(text, reader), SCOPE) for text in texts]
    found = values_of(keys_of(Engine), merged(keys_of(Engine), layers), reader.complain)
    found.pop("min_rate", None), found.pop("max_rate", None)
    return Engine(**found), reader.mistakes


def test_the_keys_of_a_part_are_its_fields_with_a_sentence() -> None:
    keys = keys_of(Engine)
    assert list(keys) == ["fuel", "power", "cylinders", "quiet", "label", "sound", "speed"]
    assert keys["speed"].field == "least"
    assert keys["power"].about == "At most, kW."
    assert [key.name for key in short_of(Engine)] == ["fuel"]


def test_a_key_that_is_said_once_is_read_and_converted() -> None:
    found, mistakes = engine("{fuel: '${word}', power: 5, cylinders: '${n}', quiet: 'on and n > 3', label: 3}")
    assert not mistakes
    assert found == Engine(fuel="oil", power=5.0, cylinders=7, quiet=True, label="3")
    assert isinstance(found.power, float)


def test_what_is_not_said_has_its_default() -> None:
    assert engine("{}") == (Engine(), [])
    assert engine("{fuel: , power: null}") == (Engine(), []), "a key without a value is not there"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{fule: gas}", "1:2: unknown key 'fule' in an engine; did you mean fuel?"),
        ("{fuel: goal}", "1:8: fuel: 'goal' is not known; use gas or oil"),
        ("{fuel: [gas]}", "1:8: fuel: expected a single value, not a list"),
        ("{fuel: 'x${word}'}", "1:8: fuel: 'xoil' is not known; use gas, oil"),
        ("{power: 0.5}", "1:9: power: expected a number from 1 to 100, not 0.5"),
        ("{power: many}", "1:9: power: expected a number from 1 to 100, not 'many'"),
        ("{power: true}", "1:9: power: expected a number from 1 to 100, not True"),
        ("{cylinders: 1.5}", "1:13: cylinders: expected a whole number of at least 1, not 1.5"),
        ("{quiet: 1}", "1:9: expected true, false or an expression, not 1"),
        ("{quiet: of}", "1:9: 'of': ${of} is not defined"),
        ("{label: '${lable}'}", "1:10: ${lable} is not defined"),
        ("{sound: '('}", "1:9: ready: sound: '(' is no pattern"),
    ],
)
def test_each_mistake_is_one_message_with_its_place(text: str, message: str) -> None:
    found, mistakes = engine(text)
    assert found == Engine(), "what has a mistake is left out"
    (mistake,) = mistakes
    assert mistake.startswith(message)


def test_the_last_layer_that_says_something_holds() -> None:
    found, mistakes = engine("{fuel: oil, power: 3}", "{power: 4, label: a}", "{label: b}")
    assert not mistakes
    assert found == Engine(fuel="oil", power=4.0, label="b")


def test_a_mistake_in_what_another_layer_replaces_is_not_told() -> None:
    assert engine("{label: '${nothing}', power: '${n}0000'}", "{label: b, power: 2}") == (
        Engine(label="b", power=2.0),
        [],
    )


class Car(msgspec.Struct, frozen=True, kw_only=True):
    """A part within a part."""

    engine: Annotated[Engine, OF_GROUPS, Meta(description="What drives it.")] = Engine()
    spare: Annotated[Engine, part_of(Engine, whole=True), Meta(description="What drives it then.")] = Engine()
    doors: Annotated[int, Meta(ge=0, description="How many.")] = 4


def car(*texts: str) -> tuple[Car, list[str]]:
    reader, layers = Reader(), []
    for text in texts:
        tree = tree_of(text)
        assert isinstance(tree, Map)
        layers.append(
            fill(keys_of(Car), read(keys_of(Car), fields(tree, "a car", keys_of(Car), reader), reader), SCOPE)
        )
    return Car(**values_of(keys_of(Car), merged(keys_of(Car), layers), reader.complain)), reader.mistakes


def test_of_a_part_each_key_is_replaced_by_itself_unless_it_is_taken_whole() -> None:
    found, mistakes = car(
        "{engine: {fuel: oil, power: 3}, spare: {fuel: oil, power: 3}}", "{engine: {power: 4}, spare: {power: 4}}"
    )
    assert not mistakes
    assert found.engine == Engine(fuel="oil", power=4.0)
    assert found.spare == Engine(power=4.0)


def test_the_most_important_value_of_a_part_may_stand_alone() -> None:
    assert car("{engine: {power: 3}}", "{engine: oil}") == (Car(engine=Engine(fuel="oil", power=3.0)), [])
    assert car("{engine: goal}") == (Car(), ["1:10: fuel: 'goal' is not known; use gas or oil"])
    assert car("{engine: [oil]}") == (Car(), ["1:10: engine: expected a value or a map, not a list"])
    assert car("{engine: {fule: oil}}") == (Car(), ["1:11: unknown key 'fule' in engine; did you mean fuel?"])


def test_a_new_key_is_in_the_schema() -> None:
    schema = definition(Engine)
    whole = schema["anyOf"][1]
    assert schema["anyOf"][0] == {"anyOf": [{"enum": ["gas", "oil"]}, {"type": "string", "pattern": r"\$\{"}]}
    assert whole["additionalProperties"] is False
    assert whole["properties"]["power"] == {
        "description": "At most, kW.",
        "anyOf": [{"type": "number", "minimum": 1, "maximum": 100}, {"type": "string", "pattern": r"\$\{"}],
    }
    assert definition(Car)["properties"]["engine"] == {"description": "What drives it.", "$ref": "#/$defs/engine"}


def test_a_type_that_says_no_form_has_to_be_given_one() -> None:
    class Odd(msgspec.Struct):
        parts: Annotated[dict[str, int], Meta(description="Of what.")] = {}

    class Bottomless(msgspec.Struct):
        depth: Annotated[float, Meta(description="How deep.")] = 0.0

    for part in (Odd, Bottomless):
        with pytest.raises(TypeError, match="say the form of"):
            keys_of(part)


def test_keys_of_another_struct_are_plain() -> None:
    class Garage(msgspec.Struct):
        cars: Annotated[Written, KeysOf(Car)] = {}

    class Street(msgspec.Struct):
        cars: Annotated[Written, KeysOf(Car, of_groups=True)] = {}

    assert [(key.name, key.plain) for key in keys_of(Garage).values()] == [
        ("engine", True), ("spare", True), ("doors", True),
    ]  # fmt: skip
    assert list(keys_of(Street)) == ["engine"]


# -- the language of manifests ---------------------------------------------------------------------------


def test_a_node_says_all_keys_of_the_plan_and_a_group_those_that_are_for_all() -> None:
    assert keys_of(ProcessPlan).keys() <= keys_of(NodeEntry).keys()
    assert keys_of(Group).keys() & keys_of(ProcessPlan).keys() == {"restart", "log", "process", "limits", "args"}
    assert not keys_of(Group)["args"].plain, "arguments of its includes, not words of a command"


@pytest.mark.parametrize("part", [RestartPlan, StopPlan, LogPlan, ReadyPlan, LimitsPlan])
def test_every_field_of_a_part_of_the_plan_is_a_key(part: type[msgspec.Struct]) -> None:
    assert {key.field for key in keys_of(part).values()} == {field.name for field in msgspec.structs.fields(part)}


@pytest.mark.parametrize("part", [RestartPlan, StopPlan, LogPlan, ReadyPlan, LimitsPlan, ProcessPlan])
def test_every_default_of_the_plan_is_one_that_a_manifest_may_say(part: type[msgspec.Struct]) -> None:
    keys = {key.field: key for key in keys_of(part).values()}
    for field in msgspec.structs.fields(part):
        if field.name in keys and isinstance(field.default, (bool, int, float, str)):
            validator = jsonschema.Draft202012Validator({**keys[field.name].form.schema, "$defs": SCHEMA["$defs"]})
            assert validator.is_valid(field.default), (field.name, field.default)


def test_ranges_of_the_schema_are_those_that_a_check_refuses() -> None:
    numbers = {key.name: key.form.schema for key in keys_of(RestartPlan).values()}
    assert numbers["jitter"]["anyOf"][0] == {"type": "number", "minimum": 0, "maximum": 1}
    port = keys_of(ReadyPlan)["port"].form.schema["anyOf"][0]
    assert (port["minimum"], port["maximum"]) == (1, 65_535)
    priority = keys_of(ProcessPlan)["priority"].form.schema["anyOf"][0]
    assert (priority["minimum"], priority["maximum"]) == (-20, 19)


def test_a_rate_fills_two_fields() -> None:
    key = keys_of(TopicPlan)["rate"]
    found = values_of({"rate": key}, {"rate": Scalar("<= 5", Position("m.yaml", 1, 1))}, Reader().complain)
    assert found == {"min_rate": None, "max_rate": 5.0}


def test_the_schema_has_a_definition_for_all_that_it_names() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    named: set[str] = set()

    def look(tree: object) -> None:
        if isinstance(tree, dict):
            named.update({tree["$ref"].removeprefix("#/$defs/")} if "$ref" in tree else ())
            for inner in tree.values():
                look(inner)
        elif isinstance(tree, list):
            for inner in tree:
                look(inner)

    look(SCHEMA)
    assert named == set(SCHEMA["$defs"])
    of_keys = {"restart", "stop", "log", "ready", "limits", "quality", "crossing"}
    assert set(SCHEMA["$defs"]) == {*SPECIAL, *PARTS, *of_keys}


# -- what the schema accepts, the reader accepts -----------------------------------------------------------

WORDS = st.sampled_from(["a", "b", "${x}", "r1", "x y", "3", "0-2", "main.yaml", "${env:HOME}/x", "don't"])
NAMES = st.sampled_from(["a", "b", "left_arm"])


@lru_cache
def part_named(name: str) -> st.SearchStrategy[Any]:
    return st.deferred(lambda: trees_of(SCHEMA["$defs"][name]))


def trees_of(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    """Trees that fit a part of the schema."""
    if "$ref" in schema:
        return part_named(schema["$ref"].removeprefix("#/$defs/"))
    if "anyOf" in schema:
        return st.one_of([trees_of(form) for form in schema["anyOf"]])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    kinds = schema.get("type")
    if isinstance(kinds, list):
        return st.one_of([trees_of({"type": kind}) for kind in kinds])
    if kinds == "object":
        return maps_of(schema)
    if kinds == "array":
        items = trees_of(schema["items"]) if "items" in schema else WORDS
        return st.lists(items, min_size=schema.get("minItems", 0), max_size=2)
    if kinds in ("number", "integer"):
        low, high = schema.get("minimum", 1), schema.get("maximum", 1_000)
        return st.integers(low, min(high, low + 100)) if kinds == "integer" else st.floats(low, high, width=32)
    return {"boolean": st.booleans(), "null": st.none()}.get(
        str(kinds), st.just("${x}") if "pattern" in schema else WORDS
    )


def maps_of(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    if "properties" not in schema:
        inner = schema.get("additionalProperties")
        values = trees_of(inner) if isinstance(inner, dict) else WORDS
        least = schema.get("minProperties", 0)
        return st.dictionaries(NAMES, values, min_size=least, max_size=schema.get("maxProperties", 2))
    chosen = {name: trees_of(form) for name, form in schema["properties"].items()}
    return st.lists(st.sampled_from(sorted(chosen)), unique=True, max_size=4).flatmap(
        lambda names: st.fixed_dictionaries({name: chosen[name] for name in names})
    )


MANIFESTS = trees_of(SCHEMA)

TOGETHER = (
    "has no service and no run", "has both a service and a run", "starts nothing", "has args but no include",
    "is a choice; add choices", "contradicts that", "exclude each other", "an include names its file", "add value",
)  # fmt: skip
"""What several keys say together, of which a schema knows nothing."""


@settings(suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large], deadline=None, max_examples=150)
@given(st.data())
def test_what_the_schema_accepts_the_reader_accepts(data: st.DataObject) -> None:
    tree = data.draw(MANIFESTS)
    assert VALIDATOR.is_valid(tree)
    problems: list[Problem] = []
    read_manifest(as_yaml(tree), Path("m.yaml"), problems)
    assert [str(problem) for problem in problems if not any(text in problem.text for text in TOGETHER)] == []


@pytest.mark.parametrize("name", sorted(parts()))
def test_every_key_of_every_part_takes_what_the_schema_says(name: str) -> None:
    """Each key by itself, so that none is left to chance."""
    reader = Accepting()
    for key in keys_of(parts()[name]).values():
        for value in samples(key.form.schema):
            tree = tree_of(as_yaml({"k": value}))
            assert isinstance(tree, Map)
            if value is not None:
                assert key.form.read(tree.entries[0].value, key.name, reader) is not None, (key.name, value)
    assert reader.mistakes == []


class Accepting(Reader):
    """Takes parts as they come."""

    def part(self, name: str, entry: Entry) -> Any:
        return name, entry

    def special(self, name: str, tree: Tree) -> Any:
        return name, tree


def samples(schema: dict[str, Any]) -> list[Any]:
    """A value for each form that a schema allows."""
    if "$ref" in schema:
        return samples(SCHEMA["$defs"][schema["$ref"].removeprefix("#/$defs/")])
    if "anyOf" in schema:
        return [value for form in schema["anyOf"] for value in samples(form)]
    if "enum" in schema:
        return list(schema["enum"])
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    by_kind: dict[str, list[Any]] = {
        "object": [{}], "array": [["x"]], "string": ["${x}"], "boolean": [True, False], "null": [],
        "number": [schema.get("minimum", 1), schema.get("maximum", 5)],
        "integer": [schema.get("minimum", 1), schema.get("maximum", 5)],
    }  # fmt: skip
    return [value for kind in kinds for value in by_kind[kind]]


def test_forms_are_plain_data() -> None:
    assert isinstance(SOME_TEXTS, Form)
    assert a_number(0, 1).schema["anyOf"][0] == {"type": "number", "minimum": 0, "maximum": 1}
