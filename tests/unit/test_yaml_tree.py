import math
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.text.tree import Map, Problem, Scalar, plain
from robo.text.yaml_tree import parse


def read(text: str, *, placeholders: bool = False) -> tuple[object, list[Problem]]:
    problems: list[Problem] = []
    tree = parse(text, "f.yaml", problems, placeholders=placeholders)
    return (plain(tree) if tree is not None else None), problems


def test_scalars_follow_yaml_1_2() -> None:
    text = "[yes, no, on, true, False, 1:30, 0o17, 0x1f, 012, 1e3, 1_000, '3', .inf, ~, 2024-01-01]"
    value, problems = read(text)
    assert value == [
        "yes", "no", "on", True, False, "1:30", 15, 31, 12, 1000.0, "1_000", "3", math.inf, None, "2024-01-01",
    ]  # fmt: skip
    assert not problems


def test_a_placeholder_is_one_word_everywhere() -> None:
    value, problems = read("a: [${x}, {b: ${y}}]\nc: ${z}\nd: '${q}'", placeholders=True)
    assert value == {"a": ["${x}", {"b": "${y}"}], "c": "${z}", "d": "${q}"}
    assert not problems


def test_positions_count_from_one() -> None:
    tree = parse("a: 1\nb:\n  c: 2\n", "f.yaml", [])
    assert isinstance(tree, Map)
    b = tree.get("b")
    assert isinstance(b, Map)
    c = b.get("c")
    assert isinstance(c, Scalar)
    assert str(c.position) == "f.yaml:3:6"


def test_duplicate_keys_are_found() -> None:
    _, problems = read("a: 1\nb: 2\na: 3\n")
    assert list(map(str, problems)) == ["f.yaml:3:1: 'a' stands twice; it is already in line 1"]


@pytest.mark.parametrize("text", ["a: [1", "a: b: c", "\t- x", "!!python/object:os.system x: [", "a: *nope", "\x00"])
def test_broken_yaml_has_a_position(text: str) -> None:
    value, problems = read(text)
    assert value is None
    assert len(problems) == 1
    assert str(problems[0]).startswith("f.yaml:")


@pytest.mark.parametrize(
    ("text", "place"), [("a:\n\tb: 1\n", "2:1"), ("a:\n  b: 1\n\tc: 2\n", "3:1"), ("\t- x", "1:1")]
)
def test_a_tab_is_called_a_tab(text: str, place: str) -> None:
    _, problems = read(text)
    assert [str(problem) for problem in problems] == [f"f.yaml:{place}: not valid YAML: a tab; indent with spaces"]


def test_alias_bombs_and_deep_nesting_end_in_an_error() -> None:
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 9)
    )
    _, problems = read(bomb)
    assert "unfolds to more than" in str(problems[0])
    _, problems = read("[" * 5000 + "]" * 5000)
    assert problems


def test_nothing_but_plain_data_is_made() -> None:
    value, problems = read("a: !!python/object/apply:os.getcwd []")
    assert value is None
    assert str(problems[0]).startswith(
        "f.yaml:1:4: tag tag:yaml.org,2002:python/object/apply:os.getcwd is not read here"
    )
    assert read("a: !!str 5")[0] == {"a": "5"}


def test_whole_numbers_fit_64_bits_or_stay_text() -> None:
    value, _ = read("[9223372036854775807, -9223372036854775807, 0xff, 9223372036854775808, 0xffffffffffffffffff]")
    assert value == [2**63 - 1, 1 - 2**63, 255, "9223372036854775808", "0xffffffffffffffffff"]
    assert read("9" * 5000)[0] == "9" * 5000


@given(st.text())
def test_any_text_is_read_or_refused_with_a_place(text: str) -> None:
    value, problems = read(text)
    assert problems or value is not None or text.strip() in ("", "~", "null") or value is None
    assert all(problem.position.line >= 1 for problem in problems)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[" * 100_000, "nested more than 100 levels"),
        ("- " * 100_000, "nested more than 100 levels"),
        ("\n".join(" " * n + "a:" for n in range(500)), "nested more than 100 levels"),
        ("a: 1\n" * 200_000, "longer than 500,000 characters"),
        ("a: &a [*a]", "alias *a names nothing"),
        ("a: 1\n---\nb: 2", "second document"),
    ],
)
def test_hostile_files_end_in_one_clear_message(text: str, expected: str) -> None:
    problems: list[Problem] = []
    begin = time.process_time()
    assert parse(text, "f", problems) is None
    assert time.process_time() - begin < 20
    assert len(problems) == 1
    assert expected in problems[0].text


def test_keys_stay_as_they_are_written() -> None:
    problems: list[Problem] = []
    tree = parse("1.0: a\ntrue: b\n0x10: c\n&x k: *x", "f", problems)
    assert tree is not None
    assert plain(tree) == {"1.0": "a", "true": "b", "0x10": "c", "k": "k"}
