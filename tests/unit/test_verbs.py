"""What verbs say of words that make no sense, before they look at any network."""

import re
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner

from robo.cli import completion, ros2_words
from robo.cli.app import app
from robo.cli.options import only_one, words_of
from robo.cli.reach import Reach
from robo.cli.tree import Section, root
from robo.cli.verb import verb
from robo.errors import UsageError
from robo.text.suggestions import closest
from tests.interrupts import wait_and_be_struck

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
    for name, *more in (("pub", "std/Empty"), ("plot",), ("info",), ("type",)):
        assert "r*/x names many topics: " in said("topic", name, "r*/x", *more)[1]


@pytest.mark.parametrize("words", [("topic", "list"), ("ps",), ("node", "list"), ("why",), ("graph",)], ids=" ".join)
def test_a_robot_that_cannot_be_is_told_in_a_sentence(words: tuple[str, ...]) -> None:
    for robot in ("a//b", "r-1", "r*", ""):
        code, text = said(*words, "--robot-name", robot)
        assert (code, len(text.splitlines())) == (2, 1)
        assert repr(robot) in text


# -- help, and words from ROS 2 --------------------------------------------------------------------


def test_help_lists_every_verb_once_and_what_groups_hold() -> None:
    commands: dict[str, Any] = get_command(app).commands  # type: ignore[attr-defined]
    _, text = said("--help")
    listed = re.findall(r"^  (\w[\w-]*)  ", text, re.MULTILINE)
    assert sorted(listed) == sorted(commands)
    assert text.index("  up ") < text.index("  topic ") < text.index("  keeper ")
    joined = " ".join(text.split())
    for name in ("topic", "node", "param", "service", "interface", "export"):
        held = commands[name].list_commands(None)
        assert f": {', '.join(held)}." in joined
        assert f": {', '.join(held)}." in " ".join(said(name, "--help")[1].split())


class Way(NamedTuple):
    """What a verb is asked."""

    distance: Annotated[float, typer.Argument(metavar="M")]
    backwards: Annotated[bool, typer.Option("--backwards", help="The other way.")] = False
    via: Annotated[list[str] | None, typer.Option("-v", "--via", metavar="PLACE")] = None


def test_a_verb_is_known_to_help_by_being_made() -> None:
    section, other = Section("Mine"), Section("Other")
    asked: list[tuple[Way, Reach, str]] = []

    @verb(section, "drive", "robo drive 3 --backwards")
    def drive(reach: Reach, way: Way, gear: Annotated[str, typer.Option("--gear")] = "low") -> int:
        """Drive some way: not too fast."""
        asked.append((way, reach, gear))
        return 3

    @verb(section, "fail")
    def fail() -> None:
        raise UsageError("it cannot")

    other.group("topic", "Topics of all")
    tried = root((section, other))
    text = CliRunner().invoke(tried, ["--help"]).output
    assert re.search(r"Mine:\n +drive +Drive some way\.\n +fail", text)
    assert re.search(r"Other:\n +topic +Topics of all: list, ", text)
    text = CliRunner().invoke(tried, ["drive", "--help"]).output
    assert "  robo drive 3 --backwards" in text
    assert text.index("--backwards") < text.index("--via") < text.index("--gear") < text.index("--robot-name")

    words = ["drive", "2.5", "--via", "a", "-v", "b", "--robot-name", "r1", "--connect", "tcp/x:1"]
    assert CliRunner().invoke(tried, words).exit_code == 3
    assert asked == [(Way(2.5, False, ["a", "b"]), Reach(("tcp/x:1",), "r1", None), "low")]
    failed = CliRunner().invoke(tried, ["fail"])
    assert (failed.exit_code, failed.output) == (2, "error: it cannot\n")


def test_options_become_words_and_of_some_only_one_may_be_said() -> None:
    assert list(words_of(Way(1.0))) == []
    assert list(words_of(Way(1.0, backwards=True, via=["a", "b"]))) == ["--backwards", "--via=a", "--via=b"]
    assert only_one(json=False, ros=False) is None
    assert only_one(json=False, ros=True) == "ros"
    with pytest.raises(UsageError, match="choose one of --json, --json-schema and --ros"):
        only_one(json=True, json_schema=True, ros=False)


@pytest.mark.parametrize("words", [*((word,) for word in ros2_words.VERBS), *ros2_words.GROUP_VERBS], ids=" ".join)
def test_a_command_of_ros_2_is_answered_with_what_robo_has(words: tuple[str, ...]) -> None:
    code, text = said(*words, "x")
    assert (code, len(text.splitlines())) == (2, 1)
    assert text.startswith(f"error: there is no robo {' '.join(words)}: ")


@pytest.mark.parametrize(
    ("word", "meant"),
    [("echo", "topic echo or robo action echo or robo tf echo"), ("call", "service call or robo batch call"),
     ("info", "topic info or robo node info or robo service info or robo action info or robo bag info"),
     ("tpoic", "topic"), ("restrat", "restart")],
)  # fmt: skip
def test_a_verb_that_there_is_not_brings_to_mind_what_was_meant(word: str, meant: str) -> None:
    assert said(word, "x") == (2, f"error: there is no robo {word}; did you mean robo {meant}?\n")


def test_programs_beside_ros_2_go_by_how_their_names_begin() -> None:
    assert ros2_words.about_verb("teleop_twist_keyboard") == ros2_words.VERBS["teleop"]
    assert ros2_words.about_verb("rqt_bag") == ros2_words.VERBS["rqt"]
    assert ros2_words.about_verb("rqt_plot") == ros2_words.VERBS["rqt_plot"]
    assert ros2_words.about_verb("lunch") is None


@pytest.mark.parametrize(
    "words", [(*verb, option) for verb, options in ros2_words.OPTIONS.items() for option in options], ids=" ".join
)
def test_an_option_of_ros_2_is_answered_with_what_to_write(words: tuple[str, ...]) -> None:
    *verb, option = words
    assert said(*verb, "x", option)[0] == 2
    assert said(*verb, "x", option)[1].startswith(f"error: {option}: ")
    own = get_command(import_module(f"robo.cli.verbs.{verb[0]}").verbs).commands[verb[1]]  # type: ignore[attr-defined]
    assert option not in [name for parameter in own.params for name in parameter.opts], "robo has that option itself"


def test_options_before_the_verb_are_told_where_to_stand() -> None:
    assert said("--robot-name", "r1", "topic", "list") == (
        2, "error: --robot-name stands behind the verb: robo VERB --robot-name …\n"
    )  # fmt: skip


def test_a_part_of_a_name_is_enough_to_be_understood() -> None:
    known = ["linear_velocity", "angular_velocity", "publish_rate"]
    assert closest("linear", known) == "linear_velocity"
    assert closest("rate", known) == "publish_rate"
    assert closest("zzz", known) is None
    assert closest("li", known) is None


def test_manifests_are_completed_and_other_files_are_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "launch").mkdir()
    (tmp_path / "launch" / "mine.yaml").write_text("include: robot.yaml\n")
    (tmp_path / "mapping.yml").write_text("# mine\nargs: {x: {default: 1}}\ngroups:\n  a: {}\n")
    (tmp_path / "marks.yaml").write_text("/**:\n  ros__parameters: {groups: 3}\n")
    monkeypatch.chdir(tmp_path)
    assert completion.manifests("m") == ["mapping.yml", "mine.yaml"]
    assert completion.manifests("launch/") == ["launch/mine.yaml"]
    assert "robot.yaml" in completion.manifests("")
    assert completion.manifests("nowhere/") == []


@pytest.mark.parametrize(("by", "code"), [(KeyboardInterrupt, 130), (SystemExit, 0)])
def test_a_ctrl_c_that_strikes_as_a_wait_begins_ends_a_verb_as_any_other(by: type[BaseException], code: int) -> None:
    group = typer.Typer()
    verb(group, "waits", "robo waits")(lambda: wait_and_be_struck(by))
    result = CliRunner().invoke(group, [])
    assert (result.exit_code, result.output) == (code, "")


def test_what_is_wrong_with_robo_itself_is_not_taken_for_a_ctrl_c() -> None:
    def fails() -> None:
        raise RuntimeError("this is a mistake")

    group = typer.Typer()
    verb(group, "fails", "robo fails")(fails)
    result = CliRunner().invoke(group, [])
    assert repr(result.exception) == "RuntimeError('this is a mistake')"
