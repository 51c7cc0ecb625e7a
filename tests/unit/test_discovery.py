"""Tokens: what robo writes is read back, and what anybody else may write is never an error."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.wire.keys import EndpointToken, NodeToken, SupervisorToken, parse_number, parse_supervisor_token, parse_token
from robo.wire.qos import QoS
from robo.wire.run_id import new_run_id

anything = st.text(st.characters(exclude_characters="/"), min_size=1)
likely = st.sampled_from(
    [
        *("@robo", "r1", "base", "node", "pub", "sub", "srv", "cli", "run", "std%String", "10", "%"),
        *("³", "\u0661", "-1", "1_0", "9" * 5000, "", "a%b%c", "host%run", "\x1b]0;x\x07", "r-1", " ", "0010", "+5"),
    ]
)


@pytest.mark.parametrize("alone", [True, False])
def test_a_token_tells_whose_it_is(alone: bool) -> None:
    run = "" if alone else new_run_id()
    token = NodeToken("fleet/r1", "base", "package.module:Class.<locals>.Inner", 4711, "host-1.local", run)
    assert parse_token(token.key()) == token
    supervisor = SupervisorToken("fleet/r1", 4711, "host-1.local", "arm", "abc0")
    assert parse_supervisor_token(supervisor.key()) == supervisor


@given(st.one_of(st.text(), st.lists(st.one_of(likely, anything), max_size=9).map("/".join)))
def test_whatever_a_stranger_declares_is_a_token_to_the_letter_or_none(key: str) -> None:
    token = parse_token(key)
    assert token is None or token.key() == key
    supervisor = parse_supervisor_token(key)
    assert supervisor is None or supervisor.key() == key


@given(*[st.one_of(likely, anything)] * 5)
def test_whatever_stands_in_a_tokens_place_is_read_or_left(kind: str, node: str, a: str, b: str, c: str) -> None:
    for key in (
        f"@robo/r1/{kind}/{node}/{a}/{b}/{c}",
        f"@robo/r1/run/{b}/{a}%{c}%x",
        f"@robo/r1/node/base/{a}/{b}/{c}",
    ):
        parse_token(key)
        parse_supervisor_token(key)


@pytest.mark.parametrize(
    "key",
    [
        "@robo/r1/pub/base/std%String/³/r1%odom",
        "@robo/r1/pub/base/std%String/\u0661/r1%odom",
        "@robo/r1/pub/base/std%String/010/r1%odom",
        "@robo/r1/pub/base/std%String/99999999999999999999/r1%odom",
        "@robo/r1/pub/base/std%String/10/\x1b]52;c;eA==\x07",
        "@robo/r1/node/ba se/a:B/1/host",
        "@robo/r-1/node/base/a:B/1/host",
        "@robo/r1/node/base/a:B/1/host%",
        "@robo/r1//base/a:B/1/host",
    ],
)
def test_what_only_looks_like_a_token_is_none(key: str) -> None:
    assert parse_token(key) is None


def test_numbers() -> None:
    assert [parse_number(text) for text in ("0", "4711", "³", "-1", "", " 1", "1" * 10)] == [0, 4711, *[None] * 5]


@given(
    st.builds(
        EndpointToken,
        *map(st.just, ("r1", "base", "pub", "std/String")),
        st.builds(QoS, depth=st.integers(0, 10**6)),
        st.just("a/b"),
    )
)
def test_depths(token: EndpointToken) -> None:
    assert parse_token(token.key()) == token
