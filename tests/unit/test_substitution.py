"""`${name}` in one place of a manifest: values keep their types, and what cannot be worked out says why once needed."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.launch import substitution
from robo.launch.manifest import Guarded
from robo.launch.substitution import BROKEN, Broken, Scope, Shared, Word, joined, known, settled, told
from robo.text.tree import Entry, Items, Map, Position, Problem, Scalar

HERE = Position("dir/m.yaml", 3, 5)
VALUES: dict[str, object] = {
    "speed": 1.5, "on": True, "name": "r1", "nothing": None, "word": Word("3"), "list": ["a", 2], "bad": BROKEN,
}  # fmt: skip


def scope(shared: Shared | None = None, /, **values: object) -> Scope:
    return Scope(Path("dir/m.yaml"), VALUES | values, shared or Shared())


def at(text: object, inset: int | None = 0) -> Scalar:
    return Scalar(text, HERE, inset)


def why(value: object) -> list[str]:
    """The mistakes of a Broken value."""
    assert isinstance(value, Broken)
    return [f"{problem.position.column}: {problem.text}" for problem in value.problems]


# -- values ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("plain", "plain"),
        (3, 3),
        (None, None),
        ("${speed}", 1.5),
        ("${on}", True),
        ("${nothing}", None),
        ("${list}", ["a", 2]),
        ("v${speed}", "v1.5"),
        ("${on}${nothing}!", "true!"),
        ("$${speed}", "${speed}"),
        ("$${speed} is ${speed}", "${speed} is 1.5"),
        ("a $ b", "a $ b"),
    ],
)
def test_a_value_alone_keeps_its_type_and_within_text_becomes_text(text: object, value: object) -> None:
    assert scope().raw(at(text)) == value


def test_what_comes_from_outside_is_a_word_whose_use_decides_its_type(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PORT", "080")
    found = scope().raw(at("${env:PORT}"))
    assert isinstance(found, Word)
    assert scope().text(at("${env:PORT}")) == "080"
    assert scope().value(at("${env:PORT}")) == 80
    assert settled(Word("true")) is True
    assert settled("true") == "true", "what is text in YAML stays text"
    assert type(scope().raw(at("x${env:PORT}"))) is str


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("${sped}", "5: ${sped} is not defined; did you mean ${speed}?"),
        ("ab ${sped}", "8: ${sped} is not defined"),
        (
            "${xyz}",
            "5: ${xyz} is not defined; known are bad, dir, file, list, name, nothing, on, speed, word, workspace",
        ),
        ("a${", "6: 'a${': '${' is never closed; write $${ for a literal one"),
        ("${env:NO_SUCH_VARIABLE}", "5: environment variable NO_SUCH_VARIABLE is not set; set it, or write"),
        ("${anon:a b}", "5: ${anon:a b}: the prefix is a name"),
        ("${share:no_such_package}", "5: ${share:no_such_package}: there is no package"),
        ("${shere:x}", "5: ${shere:…} is not known; there are ${env:NAME}, ${share:package} and ${anon:prefix}"),
    ],
)
def test_what_cannot_be_worked_out_says_why_and_where(text: str, message: str) -> None:
    (found,) = why(scope().raw(at(text)))
    assert found.startswith(message)


def test_every_mistake_of_a_text_is_told_with_its_own_place() -> None:
    assert [line.split(" ")[0] for line in why(scope().raw(at("${a} ${speed} ${b}")))] == ["5:", "19:"]
    quoted = why(scope().raw(at("${sped}", inset=1)))
    assert quoted[0].startswith("6: "), "behind the quote"
    over_lines = why(scope().raw(at("x ${sped}", inset=None)))
    assert over_lines[0].startswith("5: "), "a text over several lines is named by its beginning"


def test_what_is_broken_elsewhere_is_broken_without_another_word() -> None:
    for text in ("${bad}", "x${bad}", "${bad}${speed}"):
        found = scope().raw(at(text))
        assert isinstance(found, Broken)
        assert found.problems == ()
    assert why(scope().raw(at("${bad}${sped}"))) == ["11: ${sped} is not defined; did you mean ${speed}?"]


def test_places_and_shares() -> None:
    assert scope().raw(at("${dir}")) == f"{os.getcwd()}/dir"
    assert scope().raw(at("${file}")) == f"{os.getcwd()}/dir/m.yaml"
    assert scope().raw(at("${workspace}")) == os.getcwd()
    assert Path(str(scope().raw(at("${share:robo}/launch")))).is_dir()
    assert why(scope().raw(at("${share:robo_messages}")))[0].endswith("share")


def test_a_random_name_is_the_same_in_all_of_one_launch() -> None:
    shared = Shared()
    one = scope(shared).raw(at("${anon:tool}"))
    assert scope(shared).inner({"index": 1}).raw(at("${anon:tool}")) == one
    assert scope().raw(at("${anon:tool}")) != one


def test_another_environment_may_stand_in_for_that_of_the_process() -> None:
    asked: list[tuple[str, str | None]] = []

    def stand_in(variable: str, default: str | None) -> str | None:
        asked.append((variable, default))
        return f"<{variable}>"

    other = scope(Shared(stand_in))
    assert other.text(at("${env:HOME:-/root}/x ${env:PORT}")) == "<HOME>/x <PORT>"
    assert asked == [("HOME", "/root"), ("PORT", None)]


def test_an_inner_scope_has_more_names() -> None:
    inner = scope().inner({"index": 2, "name": "r2"})
    assert inner.raw(at("${name}_${index}_${speed}")) == "r2_2_1.5"
    assert why(scope().raw(at("${index}")))


# -- trees -----------------------------------------------------------------------------------------------


def entry(key: str, value: Scalar | Items | Map) -> Entry:
    return Entry(key, HERE, value)


def test_a_tree_as_plain_data() -> None:
    tree = Map((entry("a", at("${speed}")), entry("b", Items((at("${word}"), at("x")), HERE))), HERE)
    assert scope().plain(tree) == {"a": 1.5, "b": [3, "x"]}
    broken = Map((entry("a", at("${x1}")), entry("b", Items((at("${x2}"), at("y")), HERE))), HERE)
    assert len(why(scope().plain(broken))) == 2


def test_of_what_is_left_out_only_undefined_names_are_told() -> None:
    tree = Map((entry("a", at("${sped} ${env:NO_SUCH}")), entry("b", Items((at("${name}"), at("${q}")), HERE))), HERE)
    assert [problem.text.split(" ")[0] for problem in scope().undefined(tree)] == ["${sped}", "${q}"]


# -- paths -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "values", "path"),
    [
        ("config/${n}.yaml", {"n": "a"}, "config/a.yaml"),
        ("${n}", {"n": "../x"}, "../x"),
        ("${n}/x", {"n": "/abs"}, "/abs/x"),
        ("../${n}", {"n": "a"}, "../a"),
        ("$${x}/a", {}, "${x}/a"),
        (5, {}, "5"),
    ],
)
def test_a_path_may_begin_anywhere(text: object, values: dict[str, object], path: str) -> None:
    assert scope(**values).path(at(text)) == path


@pytest.mark.parametrize("value", ["../x", "a/../b", "..", "/etc", "..\\x"])
def test_what_is_put_into_a_path_stays_below_it(value: str) -> None:
    (mistake,) = why(scope(n=value).path(at("config/${n}.yaml")))
    assert mistake.startswith("12: ${n} is ")
    assert mistake.endswith("which leads out of the folder that is meant")


def test_a_path_without_a_file_system() -> None:
    assert why(scope(n="a\0b").path(at("x${n}"))) == ["5: a path cannot hold a zero character"]
    assert why(scope().path(at("x/${nope}")))[0].startswith("7: ${nope} is not defined")


# -- conditions ------------------------------------------------------------------------------------------


def holds(when: object = None, unless: object = None) -> tuple[bool, list[str]]:
    mistakes: list[str] = []
    part = Guarded(when=at(when) if when is not None else None, unless=at(unless) if unless is not None else None)
    found = scope().holds(part, lambda where, text: mistakes.append(f"{where.column}: {text}"))
    return found, mistakes


@pytest.mark.parametrize(
    ("when", "unless", "expected"),
    [
        (None, None, True),
        (True, None, True),
        ("on and speed > 1", None, True),
        ("not on", None, False),
        ("${on}", "speed > 2", True),
        (None, "on", False),
        (True, True, False),
        ("word == 3", None, True),
        ("bad", None, True),
        (None, "bad > 1", True),
    ],
)
def test_conditions(when: object, unless: object, expected: bool) -> None:
    assert holds(when, unless) == (expected, [])


@pytest.mark.parametrize(
    ("when", "message"),
    [
        ("speed", "5: 'speed': 1.5 is neither true nor false"),
        ("on and sped > 1", "12: 'on and sped > 1': ${sped} is not defined"),
        (5, "5: expected true, false or an expression, not 5"),
        ("on on", "8: 'on on': unexpected 'on'"),
    ],
)
def test_a_part_whose_condition_has_a_mistake_counts_so_that_it_is_checked_too(when: object, message: str) -> None:
    for found, mistakes in (holds(when), holds(None, when)):
        assert found
        assert mistakes[0].startswith(message)


# -- limits ----------------------------------------------------------------------------------------------


def test_one_text_is_no_longer_than_a_machine_bears() -> None:
    big = "x" * 600_000
    assert why(scope(big=big).raw(at("${big}${big}"))) == [
        "5: a text of 1,200,012 characters, once its ${name} are replaced; at most 1,000,000"
    ]
    assert scope(big=big).raw(at("${big}")) is big, "what is not copied costs nothing"


def test_all_texts_of_a_launch_have_one_limit_which_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(substitution, "MAX_FILLED", 100)
    shared = Shared()
    one = scope(shared, big="x" * 40)
    assert one.raw(at("a${big}")) == "a" + "x" * 40
    assert one.raw(at("b${big}")) == "b" + "x" * 40
    first = one.raw(at("c${big}"))
    again = one.inner({}).raw(at("d${big}"))
    assert first == again == BROKEN, "nobody need tell it who needs one of them"
    assert shared.overflow is not None
    assert "have more than 100 characters" in shared.overflow.text


# -- what is broken --------------------------------------------------------------------------------------


def test_a_broken_value_is_complained_of_by_whoever_needs_it() -> None:
    told_of: list[str] = []

    def complain(where: Position, text: str) -> None:
        told_of.append(f"{where}: {text}")

    broken = Broken((Problem(HERE, "wrong"), Problem(HERE, "and worse")))
    assert known(3, complain) == 3
    assert known(broken, complain) is None
    assert told_of == ["dir/m.yaml:3:5: wrong", "dir/m.yaml:3:5: and worse"]
    assert told(broken, complain) is BROKEN, "from now on without a word"
    assert len(told_of) == 4
    assert told(None, complain) is None
    assert joined([1, broken, BROKEN, broken]).problems == broken.problems * 2


@given(st.text(alphabet="${}:nameabcenv -x'", max_size=30))
def test_any_text_has_a_value_or_says_why_not(text: str) -> None:
    found = scope().raw(at(text))
    if isinstance(found, Broken):
        assert all(problem.position.column >= HERE.column for problem in found.problems)
    elif "${" not in text:
        assert found == text
