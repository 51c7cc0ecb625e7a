"""Which keys a query runs, and which it only reads."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from robo.errors import NodeNotFound, NotKept, ParameterError, RoboError, RunError, UsageError
from robo.wire.queries import Fault, reached

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


@pytest.mark.parametrize(
    "error",
    [
        NodeNotFound("no node x"),
        UsageError("two manifests"),
        RunError("not done"),
        ParameterError("a\nb"),
        NotKept("full"),
    ],
)
def test_an_error_of_robos_is_the_same_at_the_other_end(error: RoboError) -> None:
    raised = Fault.of(error).raised()
    assert type(raised) is type(error)
    assert str(raised) == str(error)


@pytest.mark.parametrize("kind", ["RoboError", "ZeroDivisionError", "TooWide", "", "Exception", "__doc__"])
def test_an_error_of_any_other_kind_is_one_of_the_run(kind: str) -> None:
    raised = Fault(kind, "it failed").raised()
    assert (type(raised), str(raised)) == (RunError, "it failed")
