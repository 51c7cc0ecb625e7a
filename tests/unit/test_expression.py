"""Conditions of manifests."""

import re
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.launch.expression import ExpressionError, evaluate

VALUES: dict[str, object] = {"use_sim": True, "mode": "gazebo", "n": 3, "empty": "", "robots": ["r1", "r2"]}


def holds(text: str) -> bool:
    def look_up(name: str) -> object:
        if name not in VALUES:
            raise KeyError(f"{name} is not defined")
        return VALUES[name]

    return evaluate(text, look_up)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("use_sim", True),
        ("${use_sim}", True),
        ("not use_sim", False),
        ("mode == 'gazebo'", True),
        ('${mode} != "gazebo"', False),
        ("n >= 3 and n < 4", True),
        ("n == 3.0", True),
        ("n == true", False),
        ("'r1' in robots and 'r3' not in robots", True),
        ("mode in ['gazebo', 'webots']", True),
        ("'gaz' in mode", True),
        ("false or not (use_sim and n == 2)", True),
        ("true or false and false", True),
        ("empty == ''", True),
        ("-1 < 0", True),
        ("null == null", True),
        (f"{'1' * 300} == {'1' * 300}", True),
        (f"{'1' * 300} == {'1' * 299}2", False),
        (f"1e300 < {'1' * 300}", False),
        ("18446744073709551615 == 18446744073709551615", True),
    ],
)
def test_what_holds(text: str, expected: bool) -> None:
    assert holds(text) is expected


@pytest.mark.parametrize(
    ("text", "message", "offset"),
    [
        ("mode", "'gazebo' is neither true nor false", 0),
        ("use_sim and mode", "'gazebo' is neither", 12),
        ("use_simm", "use_simm is not defined", 0),
        (f"{'1' * 350} == {'1' * 300}", "a number of 350 digits; at most 300", 0),
        (f"n == 0.{'1' * 300}", "a number of 301 digits", 5),
        ("1e400 == 2e400", "1e400 is larger than any number here", 0),
        ("(" * 1_000_000, "an expression of 1,000,000 characters; at most 10,000", 0),
        (f"n == {'x' * 9_000}", "is not defined", 5),
        ("n ==", "something is missing", 4),
        ("n = 3", "cannot read '= 3'", 2),
        ("(use_sim", "expected ')'", 8),
        ("1 < n < 5", "one comparison at a time", 6),
        ("mode < 3", "have no order", 5),
        ("3 in n", "cannot be in 3", 2),
        ("use_sim use_sim", "unexpected 'use_sim'", 8),
        ("__import__('os')", "unexpected '('", 10),
        ("", "something is missing", 0),
        ("(" * 1000, "nested more than 50", 51),
        ("not " * 1000, "nested more than 50", 204),
    ],
)
def test_what_is_refused_and_where(text: str, message: str, offset: int) -> None:
    with pytest.raises(ExpressionError, match=re.escape(message)) as error:
        holds(text)
    assert error.value.offset == offset


@given(st.text(alphabet="use_sim n3.'\"()[]$={}<>!,andornti \n", max_size=40))
def test_any_text_is_true_false_or_refused(text: str) -> None:
    try:
        holds(text)
    except ExpressionError as error:
        offset = error.offset
    else:
        offset = 0
    assert 0 <= offset <= len(text)


def test_a_text_that_unfolds_to_more_than_a_condition_needs_is_refused() -> None:
    big = "x" * 60_000
    assert evaluate("'${big}' != ''", lambda _: big)
    begin = time.process_time()
    with pytest.raises(ExpressionError, match="a text of more than 100,000 characters"):
        evaluate(f"'{'${big}' * 1_000}' == ''", lambda _: big * 100)
    assert time.process_time() - begin < 20
