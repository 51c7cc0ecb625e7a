"""What a shell completes, of what lives on a network that a test makes up."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.core import TyperCommand

from robo.cli import completion, connection
from robo.cli.reach import Reach
from robo.errors import NetworkError
from robo.tools import nodes, runs, topics
from robo.tools.topics import Topic
from robo.wire.keys import NodeToken
from tests.reports import process

NODES = [
    NodeToken("r1", "base", "m:Base", 1, "h"),
    NodeToken("r1", "tracker", "m:Tracker", 2, "h"),
    NodeToken("r2", "base", "m:Base", 3, "h"),
    NodeToken("r2", "bad\x1b[2J", "m:Bad", 4, "h"),
]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Reach]:
    """Where shells have looked; nothing needs a network."""
    found: list[Reach] = []

    @contextmanager
    def connect(reach: Reach) -> Iterator[None]:
        found.append(reach)
        yield None

    monkeypatch.setattr(connection, "connect_to_robot", connect)
    monkeypatch.setattr(nodes, "list_nodes", lambda *_: NODES)
    keys = ("r1/odom", "r1/scan", "r2/odom", "r1/\u202eevil")
    monkeypatch.setattr(topics, "list_topics", lambda *_: [Topic(key, "", [], [], []) for key in keys])
    return found


def line(**given: Any) -> typer.Context:
    """A command line so far."""
    context = typer.Context(TyperCommand("verb"))
    context.params = given
    return context


@pytest.mark.usefixtures("asked")
def test_topics_are_those_that_begin_so() -> None:
    assert completion.topics(line(), "") == ["r1/odom", "r1/scan", "r2/odom"], "without what a terminal would obey"
    assert completion.topics(line(), "r1/s") == ["r1/scan"]
    assert completion.topics(line(), "x") == []


def test_what_the_line_says_of_the_network_counts(asked: list[Reach]) -> None:
    completion.topics(line(connect=["tcp/h:1"], robot_name="r1", timeout=30.0), "")
    assert asked == [Reach(("tcp/h:1",), "r1", completion.TIMEOUT)], "nobody waits for long who pressed Tab"


@pytest.mark.usefixtures("asked")
def test_a_node_goes_by_its_name_where_that_says_enough() -> None:
    assert completion.nodes(line(), "") == ["/r1/base", "/r2/base", "tracker"]
    assert completion.nodes(line(), "/r1") == ["/r1/base", "/r1/tracker"]
    assert completion.robots(line(), "") == ["r1", "r2"]


@pytest.mark.usefixtures("asked")
def test_processes_bring_their_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [process("r1", "/r1/base", "drive"), process("r1", "/r1/arm/grip", "")]
    monkeypatch.setattr(runs, "processes", lambda *_, **__: found)
    assert completion.processes(line(), "") == ["arm/grip", "base", "drive"]
    assert completion.processes(line(), "/r1/a") == ["/r1/arm/grip"]


def test_where_nothing_answers_there_is_nothing_and_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(_: Reach) -> None:
        raise NetworkError("nothing is running")

    monkeypatch.setattr(connection, "connect_to_robot", connect)
    for complete in (completion.topics, completion.services, completion.nodes, completion.processes):
        assert complete(line(), "") == []
    assert completion.topics(line(robot_name="no//name"), "") == []


def test_types_need_no_network() -> None:
    assert completion.types("geometry/Tw") == [
        *("geometry/Twist", "geometry/TwistStamped", "geometry/TwistWithCovariance"),
        "geometry/TwistWithCovarianceStamped",
    ]


def test_recordings_are_files_and_folders_that_may_hold_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("drive.mcap", "log.jsonl", "run.log.gz", "notes.txt", ".hidden.mcap", "parts/one.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert completion.recordings("") == ["drive.mcap", "log.jsonl", "parts/", "run.log.gz"]
    assert completion.recordings("d") == ["drive.mcap"]
    assert completion.recordings("parts/") == ["parts/one.mcap"]
    assert completion.recordings(f"{tmp_path}/.h") == [f"{tmp_path}/.hidden.mcap"]
    assert completion.recordings("nowhere/") == []
