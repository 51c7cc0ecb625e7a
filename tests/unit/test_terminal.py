"""What reaches a terminal, and what of it is shown."""

import io
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.supervisor.console import Console
from robo.text.columns import aligned, fitted
from robo.text.terminal import Door, escaped_json, own, visible, visible_but_colours, width
from robo.text.yaml_tree import as_yaml

CONTROLS = [
    *map(chr, [*range(0x20), *range(0x7F, 0xA0)]),
    *"\u2028\u2029\u202a\u202b\u202c\u202d\u202e\u2066\u2069",
    "\ud800",
]


def through(text: str) -> str:
    stream = io.StringIO()
    Door(stream).write(text)
    return stream.getvalue()


@pytest.mark.parametrize("character", CONTROLS)
def test_every_control_character_is_shown(character: str) -> None:
    assert visible(character).isprintable()
    assert through(character) == (character if character in "\n\t" else visible(character))


def test_text_of_people_stays() -> None:
    text = "Ünï ≠ 日本 🤖 \\ \ue000"
    assert visible(text) == text
    assert visible("\x1b[2J\x9b\u202e") == r"\x1b[2J\x9b\u202e"


def test_robos_own_sequences_pass_and_take_no_room() -> None:
    text = own("\x1b[1m") + "owned\x1b[1m" + own("\x1b[0m")
    assert through(text) == "\x1b[1mowned\\x1b[1m\x1b[0m"
    assert through(visible(text)) == through(text)
    assert width(text) == len(r"owned\x1b[1m")
    rows = [(own("\x1b[32m") + "a" + own("\x1b[0m"), "b"), ("three", "c\nd")]
    assert through("\n".join(aligned(rows))) == "\x1b[32ma\x1b[0m      b\nthree  c\\nd"


def test_a_narrow_terminal_does_without_some_columns() -> None:
    rows = [("ROBOT", "NODE", "PID", "REASON"), ("r1", "/r1/a", "4711", "x" * 100)]
    assert fitted(rows, 140, ["ROBOT", "PID"]) == [list(row) for row in rows]
    for most in (45, 50, 60, 100):
        found = fitted([*rows, ("r1", "/r1/b", "1", "because of " + "y" * 100)], most, ["ROBOT", "PID"])
        assert "NODE" in found[0]
        assert ("ROBOT" in found[0]) == (most >= 7 + 7 + 6 + 24)
        assert width(aligned(found)[2]) == most
    assert fitted(rows, 10, ["ROBOT", "PID"])[0] == ["NODE", "REASON"]
    assert fitted([("A", "B"), ("x", "")], 3, ["A"]) == [["B"], [""]]


@pytest.mark.parametrize(
    ("printed", "shown"),
    [
        ("plain\ttext", "plain\ttext"),
        ("\x1b[1;31mred\x1b[0m", "\x1b[1;31mred\x1b[0m\x1b[0m"),
        ("\x1b[38;5;200mpink", "\x1b[38;5;200mpink\x1b[0m"),
        ("\x1b[38;2;1;2;3mpink\x1b[m", "\x1b[38;2;1;2;3mpink\x1b[m\x1b[0m"),
        ("\x1b[8mhidden", r"\x1b[8mhidden"),
        ("\x1b[31;5mblinking", r"\x1b[31;5mblinking"),
        ("\x1b[2J\x1b]0;title\x07", r"\x1b[2J\x1b]0;title\x07"),
        ("a\rb\x9b31m", r"a\rb\x9b31m"),
    ],
)  # fmt: skip
def test_a_process_may_colour_what_it_prints(printed: str, shown: str) -> None:
    assert visible_but_colours(printed, colour=True) == shown
    assert "\x1b" not in visible_but_colours(printed, colour=False)


def test_a_console_shows_what_processes_say() -> None:
    stream = io.StringIO()
    console = Console(["a"], stream, colour=False)
    console.line("a", "x\x1b[31my\x1b[2J")
    console.line("a\n", "WARN  \u202e")
    console.say("two\nlines")
    assert [line.partition(" ")[2] for line in stream.getvalue().splitlines()] == [
        r"a    | xy\x1b[2J", r"a\n  | WARN  \u202e", "robo | two", "robo | lines",
    ]  # fmt: skip


@given(st.recursive(st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=5))
def test_json_and_yaml_stay_what_they_are(value: object) -> None:
    import yaml

    text = json.dumps(value, ensure_ascii=False)
    assert json.loads(escaped_json(text)) == value
    assert visible(escaped_json(text)) == escaped_json(text)
    assert escaped_json(text, "ascii").isascii()
    assert json.loads(escaped_json(text, "ascii")) == value
    assert visible(as_yaml(value), keep="\n") == as_yaml(value)
    assert yaml.safe_load(as_yaml(value)) == value
