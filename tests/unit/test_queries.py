"""Which keys a query runs, and which it only reads."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from robo.wire.queries import reached

SET = "r1/base/parameters/set"
GET = "r1/base/parameters/get"
LIST = "r1/base/parameters/list"


@pytest.mark.parametrize(
    ("asked", "answered"),
    [
        (SET, [SET]),
        (GET, [GET]),
        ("r1/base/parameters/*", [GET, LIST]),
        ("r1/base/parameters/$*et", [GET]),
        ("r1/base/parameters/set/**", []),
        ("r1/*/parameters/set", []),
        ("r1/*/parameters/get", [GET]),
        ("**/set", []),
        ("**", [GET, LIST]),
        ("r1/**", [GET, LIST]),
        ("r2/**", []),
        ("r1/base/parameters/delete", []),
        ("r1/base/parameters", []),
    ],
)
def test_wildcards_read_and_only_a_full_name_acts(asked: str, answered: list[str]) -> None:
    assert reached(asked, acts=[SET], tells=[GET, LIST]) == answered


_CHUNK = st.sampled_from(["r1", "emergency_stop", "*", "**", "$*stop", "emergency_$*", "r$*", "emergency_stop$*", "x"])


@given(st.lists(_CHUNK, min_size=1, max_size=4).map("/".join))
def test_nothing_acts_but_on_its_own_key(asked: str) -> None:
    key = "r1/emergency_stop"
    try:
        asked = str(zenoh.KeyExpr.autocanonize(asked))
    except zenoh.ZError:
        return  # no query has such a key
    assert (reached(asked, acts=[key], tells=[]) == [key]) == (asked == key)
