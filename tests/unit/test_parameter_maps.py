"""Maps of Structs as parameters: names that a node's user chooses."""

from typing import Annotated, Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

import robo
from robo import READ_ONLY, Unit
from robo.errors import ContractError, ParameterError
from robo.node.contract_text import contract_data, contract_text
from robo.parameters.model import build, change, default_of, describe, describe_running, flat, mistakes
from robo.parameters.shape import declared_as, is_group
from robo.parameters.words import parse_assignment


class Gains(msgspec.Struct, frozen=True):
    p: float = 1.0
    i: float = 0.0


class Source(msgspec.Struct, frozen=True):
    topic: Annotated[str, Meta(min_length=1, description="where it comes from"), READ_ONLY]
    timeout: Annotated[float, Meta(ge=0.01, le=10), Unit("s")] = 0.5
    gains: Gains = Gains()

    def __post_init__(self) -> None:
        if self.gains.p < self.gains.i:
            raise ValueError("p is less than i")


class Parameters(robo.Parameters):
    speed: float = 1.0
    sources: dict[str, Source] = msgspec.field(default_factory=dict)
    zones: dict[str, Gains] = msgspec.field(default_factory=lambda: {"front": Gains(p=3.0)})


class Base(robo.Node):
    Parameters = Parameters


SCAN = {"sources": {"scan": {"topic": "scan", "timeout": 1}}}


def _refusal(values: dict[str, Any]) -> str:
    with pytest.raises(ParameterError) as error:
        build(Parameters, values, "/r1/base")
    return str(error.value)


def test_entries_have_the_names_that_are_given_and_their_defaults() -> None:
    nested = build(Parameters, SCAN, "/r1/base")
    dotted = build(Parameters, {"sources.scan.topic": "scan", "sources.scan.timeout": 1}, "/r1/base")
    assert nested == dotted
    assert nested.sources == {"scan": Source("scan", 1.0)}
    assert isinstance(nested.sources["scan"].timeout, float)
    assert flat(nested) == {
        "speed": 1.0,
        "sources.scan.topic": "scan",
        "sources.scan.timeout": 1.0,
        "sources.scan.gains.p": 1.0,
        "sources.scan.gains.i": 0.0,
        "zones.front.p": 3.0,
        "zones.front.i": 0.0,
        "use_sim_time": False,
    }


def test_entries_that_are_there_by_default_are_changed_and_others_come_beside_them() -> None:
    built = build(Parameters, {"zones.front.i": 0.5, "zones.back.p": 2}, "/r1/base")
    assert built.zones == {"front": Gains(3.0, 0.5), "back": Gains(2.0, 0.0)}
    assert build(Parameters, {}, "/r1/base").zones == {"front": Gains(p=3.0)}


def test_what_an_entry_lacks_and_what_does_not_fit_is_named() -> None:
    assert _refusal({"sources.scan.timeout": 1}) == "/r1/base: sources.scan has no topic"
    text = _refusal({"sources": {"scan": {"topic": "", "timeout": 99, "tpoic": "x"}}})
    assert "sources.scan.topic = '': expected str of length >= 1 (where it comes from)" in text
    assert "sources.scan.timeout = 99: expected float <= 10.0 (s; 0.01 to 10)" in text
    assert "no parameter 'sources.scan.tpoic'" in text
    assert "has no topic" not in text, "one is said, though a wrong one"
    text = _refusal({"sources": {"scan": {"timeout": 99}, "sonar": {"timeout": 1}}, "speed": "x"})
    assert "sources.scan.timeout = 99: expected float <= 10.0 (s; 0.01 to 10); sources.scan has no topic" in text
    assert "/r1/base: sources.sonar has no topic" in text
    assert "speed = 'x'" in text
    assert _refusal({"zones.front.p": 0, "zones.front.i": "much"}).startswith("/r1/base: zones.front.i = 'much'")
    assert _refusal({**SCAN, "sources.scan.gains.i": 2.0}) == "/r1/base: sources.scan: p is less than i"


@pytest.mark.parametrize("name", ["a b", "a.b", "", "*", "a/b", "-"])
def test_an_entry_needs_a_name(name: str) -> None:
    assert "no parameter" in _refusal({"zones": {name: {"p": 1.0}}})


def test_a_map_that_is_no_map_is_refused() -> None:
    assert "no parameter 'zones'" in _refusal({"zones": 3})
    assert "no parameter 'zones.front'" in _refusal({"zones": {"front": 3}})


def test_a_running_node_changes_values_and_takes_no_new_names() -> None:
    running = build(Parameters, SCAN, "/r1/base")
    slower = change(running, {"sources.scan.timeout": 2.0, "zones.front.p": 4.0}, "/r1/base")
    assert (slower.sources["scan"].timeout, slower.zones["front"].p) == (2.0, 4.0)
    assert running.sources["scan"].timeout == 1.0, "the old ones are as they were"
    with pytest.raises(ParameterError, match=r"no parameter 'zones\.back\.p' now, and one can only be added"):
        change(running, {"zones.back.p": 1.0}, "/r1/base")
    with pytest.raises(ParameterError, match=r"sources\.scan\.topic is read-only"):
        change(running, {"sources.scan.topic": "other"}, "/r1/base")
    assert change(running, {"sources.scan.topic": "scan"}, "/r1/base") == running


def test_a_class_declares_them_by_a_star_and_those_that_are_there_by_default() -> None:
    infos = {info.name: info for info in describe(Parameters)}
    assert list(infos) == [
        "speed",
        "sources.*.topic",
        "sources.*.timeout",
        "sources.*.gains.p",
        "sources.*.gains.i",
        "zones.front.p",
        "zones.front.i",
        "zones.*.p",
        "zones.*.i",
        "use_sim_time",
    ]
    assert (infos["sources.*.topic"].default, infos["sources.*.timeout"].default) == (None, 0.5)
    assert (infos["zones.front.p"].default, infos["zones.*.p"].default) == (3.0, 1.0)
    text = contract_text(contract_data(Base))
    assert "  sources.*.topic   needed   where it comes from" in text


def test_a_running_node_describes_those_that_it_has() -> None:
    running = describe_running(build(Parameters, SCAN, "/r1/base"))
    infos = {info.name: info for info in running}
    assert list(infos) == list(flat(build(Parameters, SCAN, "/r1/base")))
    assert infos["sources.scan.timeout"].default == 0.5
    assert infos["sources.scan.timeout"].unit == "s"
    assert infos["sources.scan.topic"].read_only
    assert default_of(Parameters, "sources.scan.topic") is None
    assert default_of(Parameters, "zones.front.p") == 3.0


def test_mistakes_are_told_by_the_names_that_they_are_about() -> None:
    wrong = {"speed": "x", "zones.front.p": 2.0, "zones.back.i": "y"}
    assert list(mistakes(Parameters, wrong, "base")) == ["speed", "zones.back.i"]
    assert mistakes(Parameters, {"speed": 2.0, "sources.scan.timeout": 1.0, "zones.front.p": 2.0}, "base") == {
        "sources.scan.timeout": "base: sources.scan has no topic"
    }
    contradiction = {"sources.scan.topic": "scan", "sources.scan.gains.i": 9.0, "speed": 2.0}
    text = "base: sources.scan: p is less than i"
    assert mistakes(Parameters, contradiction, "base") == {"sources.scan.gains.i": text}


def test_text_on_a_command_line_stays_text_where_it_is_declared_so() -> None:
    assert parse_assignment("sources.scan.topic:=5", Parameters) == ("sources.scan.topic", "5")
    assert parse_assignment("sources.scan.timeout:=5", Parameters) == ("sources.scan.timeout", 5)


def test_a_map_cannot_be_read_only_as_a_whole_and_a_struct_in_it_needs_defaults() -> None:
    class Whole(robo.Parameters):
        zones: Annotated[dict[str, Gains], READ_ONLY] = msgspec.field(default_factory=dict)

    class Inner(msgspec.Struct):
        gains: Source

    class Lacking(robo.Parameters):
        inner: dict[str, Inner] = msgspec.field(default_factory=dict)

    with pytest.raises(ContractError, match=r"Whole\.zones: READ_ONLY stands with the fields of Gains instead"):
        describe(Whole)
    with pytest.raises(ContractError, match=r"Source\.topic has no default"):
        describe(Lacking)


WORDS = st.from_regex(r"[a-z_][a-z0-9_]{0,8}", fullmatch=True)


@given(st.dictionaries(WORDS, st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=5))
def test_what_is_flat_builds_the_same_again(zones: dict[str, tuple[float, float]]) -> None:
    built = build(
        Parameters,
        {f"zones.{key}.{name}": v for key, pi in zones.items() for name, v in zip("pi", pi, strict=True)},
        "n",
    )
    assert built.zones == {"front": Gains(p=3.0)} | {key: Gains(*pi) for key, pi in zones.items()}
    assert build(Parameters, flat(built), "n") == built
    declared = {info.name for info in describe(Parameters)}
    for name in flat(built):
        assert declared_as(name, declared) is not None
        assert not is_group(name, declared)
    for key in zones:
        assert is_group(f"zones.{key}", declared)
