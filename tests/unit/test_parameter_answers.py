"""What a node answers to requests about its parameters, without a network."""

import json
from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, Any

import msgpack
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

import robo
from robo import ParameterError, Unit
from robo.node.parameter_server import LONGEST_REQUEST, Answers
from robo.parameters.model import build, change
from robo.wire.codec import Malformed
from robo.wire.reports import Result, Setting


class Parameters(robo.Parameters):
    speed: Annotated[float, Meta(ge=-5, le=5, description="how fast"), Unit("m/s")] = 0.5
    mode: str = "slow"


class Base:
    """A node's parameters and what answers for them."""

    def __init__(self) -> None:
        self.parameters = build(Parameters, {}, "/r1/base")
        self.sets: list[Mapping[str, object]] = []
        self.answers = Answers("/r1/base", lambda: self.parameters, self._explain, self._set)

    def ask(self, verb: str, request: object = None) -> Any:
        return msgspec.to_builtins(self.answers.to(verb, b"" if request is None else msgpack.packb(request)))

    def _explain(self, name: str) -> list[Setting]:
        return [Setting(name, "declared default")]

    def _set(self, changes: Mapping[str, object]) -> None:
        self.sets.append(changes)
        self.parameters = change(self.parameters, changes, "/r1/base")


@pytest.fixture
def base() -> Base:
    return Base()


def test_all_is_read_where_nothing_is_named(base: Base) -> None:
    names = ["speed", "mode", "use_sim_time"]
    assert base.ask("list") == {"names": names}
    assert base.ask("get") == base.ask("get", {}) == {"speed": 0.5, "mode": "slow", "use_sim_time": False}
    assert list(base.ask("describe")) == names
    assert base.ask("explain", ["mode"]) == {"mode": [{"value": "mode", "source": "declared default"}]}


@pytest.mark.parametrize("request_", [{"names": ["speed"]}, ["speed"]])
def test_what_is_named_is_read_alone(base: Base, request_: object) -> None:
    assert base.ask("get", request_) == {"speed": 0.5}
    assert base.answers.to("get", json.dumps(request_).encode()) == {"speed": 0.5}
    assert base.ask("describe", request_)["speed"] == {
        "name": "speed",
        "type": "float",
        "value": 0.5,
        "default": 0.5,
        "description": "how fast",
        "unit": "m/s",
        "constraints": {"ge": -5, "le": 5},
        "read_only": False,
    }


def test_what_is_described_has_the_value_of_now(base: Base) -> None:
    base.ask("set", {"speed": 2})
    assert (base.ask("describe")["speed"]["value"], base.ask("describe")["speed"]["default"]) == (2.0, 0.5)


@pytest.mark.parametrize("verb", ["get", "describe", "explain"])
@pytest.mark.parametrize(
    ("request_", "error", "message"),
    [
        (["sped"], ParameterError, "^/r1/base has no parameter 'sped'; did you mean speed"),
        ([7], ParameterError, "has no parameter 7"),
        ({"name": "speed"}, Malformed, r"expected \{names: "),
        (7, Malformed, r"expected \{names: "),
        (["x"] * 1001, Malformed, "names 1,001 parameters; name at most 1,000"),
    ],
)
def test_a_request_that_means_nothing_is_told(
    base: Base, verb: str, request_: object, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        base.ask(verb, request_)


@pytest.mark.parametrize("request_", [{"speed": 1.5, "mode": "fast"}, [{"name": "speed", "value": 1.5}]])
def test_values_are_set_by_a_map_or_by_a_list_as_ros_has_it(base: Base, request_: object) -> None:
    assert base.ask("set", request_) == {"successful": True, "reason": ""}
    assert base.parameters.speed == 1.5


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        (None, "expected a map from names to values"),
        ({}, "expected a map from names to values"),
        (["speed"], "expected a map from names to values"),
        ([{"name": 1, "value": 2}], "expected a map from names to values"),
        ({1: 2}, "expected a map from names to values"),
        ({"speed": 9}, "speed = 9"),
    ],
)
def test_a_set_that_is_refused_says_why_and_changes_nothing(base: Base, request_: object, reason: str) -> None:
    answer = base.ask("set", request_)
    assert not answer["successful"]
    assert reason in answer["reason"]
    assert base.parameters == Parameters()


def test_a_request_that_is_too_long_is_not_even_read(base: Base) -> None:
    with pytest.raises(Malformed, match="longer than 1,000,000 bytes"):
        base.answers.to("set", b"{" * (LONGEST_REQUEST + 1))
    assert base.sets == []


@given(st.sampled_from(["list", "get", "describe", "explain", "set"]), st.binary(max_size=60))
def test_whatever_bytes_are_sent_there_is_an_answer_or_a_reason(verb: str, payload: bytes) -> None:
    base = Base()
    with suppress(Malformed, ParameterError):
        answer = base.answers.to(verb, payload)
        assert verb != "set" or isinstance(answer, Result)
