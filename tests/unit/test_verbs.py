"""What verbs say of words that make no sense, before they look at any network."""

import pytest
from typer.testing import CliRunner

from robo.cli.app import app

NO_KEYS = ("a//b", "a/**b", "#", "a?", "$", "", "a b")


def said(*words: str) -> tuple[int, str]:
    """The exit code of a command, and what it prints."""
    result = CliRunner().invoke(app, words)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


@pytest.mark.parametrize(
    "words",
    [
        *(("topic", verb) for verb in ("echo", "hz", "bw", "delay", "loss", "plot", "info", "type")),
        *(("service", verb) for verb in ("call", "info", "type")),
    ],
    ids=" ".join,
)
def test_what_is_no_key_is_told_in_a_sentence(words: tuple[str, ...]) -> None:
    for key in NO_KEYS:
        code, text = said(*words, key)
        assert (code, text[: len(f"error: name {key!r} ")]) == (2, f"error: name {key!r} ")
        assert len(text.splitlines()) == 1


def test_one_topic_is_published_on() -> None:
    for key in NO_KEYS:
        assert said("topic", "pub", key, "std/Empty") == said("topic", "pub", key, "std/Empty", "-")
        assert said("topic", "pub", key, "std/Empty")[0] == 2
    for verb, *more in (("pub", "std/Empty"), ("plot",), ("info",), ("type",)):
        assert "r*/x names many topics: " in said("topic", verb, "r*/x", *more)[1]


@pytest.mark.parametrize("words", [("topic", "list"), ("ps",), ("node", "list"), ("why",), ("graph",)], ids=" ".join)
def test_a_robot_that_cannot_be_is_told_in_a_sentence(words: tuple[str, ...]) -> None:
    for robot in ("a//b", "r-1", "r*", ""):
        code, text = said(*words, "--robot-name", robot)
        assert (code, len(text.splitlines())) == (2, 1)
        assert repr(robot) in text
