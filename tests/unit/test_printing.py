"""How verbs print: lines, tables, colours, JSON, amounts."""

import contextlib
import io
import json
import sys
from collections.abc import Callable
from typing import Any

import pytest

from robo.cli import printing
from robo.cli.json_text import document, to_json
from robo.errors import UsageError
from robo.text import colours, terminal

Shown = Callable[[Callable[[], None]], str]


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Shown:
    """What comes out on a terminal of 80 columns, behind the door that the command puts before it."""
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("COLUMNS", "80")

    def on_screen(print_something: Callable[[], None]) -> str:
        behind = Terminal()
        with contextlib.redirect_stdout(terminal.Door(behind)):
            print_something()
        return behind.getvalue()

    return on_screen


@pytest.mark.parametrize(("value", "shown"), [(None, True), ("", True), ("1", False), ("0", False)])
def test_no_color_is_read_as_its_standard_says(value: str | None, shown: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if value is None:
        monkeypatch.delenv("NO_COLOR", raising=False)
    else:
        monkeypatch.setenv("NO_COLOR", value)
    assert colours.shown_on(Terminal()) is shown
    assert not colours.shown_on(io.StringIO())


def test_robos_own_colours_pass_the_door_and_those_of_others_do_not(shown: Shown) -> None:
    text = shown(lambda: printing.print_line(printing.paint("a\x1b[2Jb", colours.RED)))
    assert text == "\x1b[31ma\\x1b[2Jb\x1b[0m\n"


def test_a_newline_in_a_line_begins_no_other(shown: Shown) -> None:
    assert shown(lambda: printing.print_line("one\nline\tof\rtext")) == "one\\nline\tof\\rtext\n"


def test_a_table_has_a_bold_head_and_gives_up_columns_on_a_narrow_terminal(shown: Shown) -> None:
    rows = [("NODE", "HOST", "REASON"), ("/r1/a", "h" * 50, "because of this and that")]
    assert shown(lambda: printing.print_table(rows, spared=("HOST",))).splitlines() == [
        "\x1b[1mNODE   REASON\x1b[0m",
        "/r1/a  because of this and that",
    ]


def test_a_file_gets_the_whole_table_without_colours(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [("NODE", "HOST", "REASON"), ("/r1/a", "h" * 50, "r" * 60)]
    printing.print_table(rows, spared=("HOST",))
    printing.clear_screen()
    assert capsys.readouterr().out == f"NODE   HOST{' ' * 48}REASON\n/r1/a  {'h' * 50}  {'r' * 60}\n"


def test_hints_are_for_people_and_notes_for_all(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    printing.hint("wait")
    printing.note("know")
    assert capsys.readouterr().err == "know\n"
    beside = Terminal()
    monkeypatch.setattr(sys, "stderr", beside)
    printing.hint("wait")
    assert beside.getvalue() == "wait\n"


def test_a_file_that_cannot_be_written_is_told(tmp_path: Any) -> None:
    printing.write_file("text ü", tmp_path / "x")
    assert (tmp_path / "x").read_bytes() == "text ü".encode()
    with pytest.raises(UsageError, match="y cannot be written: No such file or directory"):
        printing.write_file("text", tmp_path / "nowhere" / "y")


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: printing.amount(1, "node"), "1 node"),
        (lambda: printing.amount(0, "node"), "0 nodes"),
        (lambda: printing.data_size(0), "0 B"),
        (lambda: printing.data_size(999), "999 B"),
        (lambda: printing.data_size(1_234_567, "B/s"), "1.23 MB/s"),
        (lambda: printing.data_size(-2_500), "-2.5 kB"),
    ],
)
def test_amounts(make: Callable[[], str], text: str) -> None:
    assert make() == text


def test_a_time_has_milliseconds() -> None:
    assert printing.clock_time(1_700_000_000_123_999_999)[-4:] == ".123"


@pytest.mark.parametrize("encode", [to_json, document])
def test_json_holds_no_control_characters_and_reads_back(encode: Callable[[object], str]) -> None:
    value = {"text": "a\x1b[2J\x9b\u202e\n", "numbers": [1, 2.5]}
    text = encode(value)
    assert json.loads(text) == value
    assert all(character.isprintable() or character == "\n" for character in text)


def test_json_for_data_that_json_has_no_word_for() -> None:
    assert json.loads(to_json({"a": float("nan"), "b": b"\x00\xff"})) == {"a": "nan", "b": "AP8="}
