"""What `robo up` is asked: its options as one request, and as the words of a run in the background."""

from collections.abc import Sequence
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from typer.models import ArgumentInfo, OptionInfo
from typer.testing import CliRunner

from robo.cli.app import app
from robo.cli.launch import up
from robo.cli.launch.request import UpRequest
from robo.cli.options import words_of

EVERYTHING = UpRequest(
    words=["mine.yaml", "control", "speed:=2"],
    robot_name="r2",
    param=["driver.pin:=3", "rate:=[1, 2]"],
    connect=["tcp/site:7447"],
    listen=["tcp/127.0.0.1:7448", "tcp/[::1]:7448"],
    security="security/names/r2",
    log_level="debug",
    host="arm",
    detach=True,
    wait=True,
    watch=True,
    config=Path("config/uplink.yaml"),
    timing=True,
)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[UpRequest]:
    """The requests that command lines come to, in place of runs."""
    found: list[UpRequest] = []

    def run_up(request: UpRequest, _: object) -> int:
        found.append(request)
        return 0

    monkeypatch.setattr(up, "run_up", run_up)
    return found


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Sequence[str], str, bool]]:
    """What would be started in the background."""
    found: list[tuple[Sequence[str], str, bool]] = []

    def start_in_background(words: Sequence[str], robot: str, *, wait: bool) -> int:
        found.append((words, robot, wait))
        return 7

    monkeypatch.setattr(up, "start_in_background", start_in_background)
    return found


def test_every_field_is_an_option_but_the_words() -> None:
    for name, annotation in get_type_hints(UpRequest, include_extras=True).items():
        said = [about for about in get_args(annotation) if isinstance(about, (OptionInfo, ArgumentInfo))]
        assert len(said) == 1, name
        assert isinstance(said[0], ArgumentInfo) == (name == "words")


def test_the_words_of_a_request_say_the_same_request(asked: list[UpRequest]) -> None:
    for request in (EVERYTHING, UpRequest(detach=True), UpRequest(show_args=True, json=True)):
        words = [*(request.words or ()), *words_of(request)]
        assert CliRunner().invoke(app, ["up", *words]).exit_code == 0
        assert asked.pop() == request


def test_a_run_in_the_background_is_asked_the_same_and_told_its_robot(
    begun: list[tuple[Sequence[str], str, bool]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text("groups:\n  all:\n    namespace: ${robot_name}\n    nodes: {a: {run: sleep inf}}\n")
    code = CliRunner().invoke(app, ["up", "-d", "mine.yaml", "--wait", "--watch", "--listen", "tcp/127.0.0.1:7448"])
    assert code.exit_code == 7, code.output
    assert begun == [
        (["mine.yaml", "--robot-name=my_robot", "--listen=tcp/127.0.0.1:7448", "--watch"], "my_robot", True)
    ]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--json"], "--json goes with --dry-run or --show-args"),
        (["--wait"], "--wait goes with -d"),
        (["-d", "--log-level", "loud"], "log level 'loud': use debug"),
        (["-d", "a.yaml", "b.yaml"], "two manifests: a.yaml and b.yaml"),
        (["-d", "robot.yaml", "-p", "nonsense"], "-p nonsense: write NODE.NAME:=VALUE"),
        (["-d", "robot.yaml", "--listen", "nonsense"], "nonsense is not accepted; an endpoint looks like"),
        (["-d", "robot.yaml", "--connect", "nonsense"], "nonsense is not accepted; an endpoint looks like"),
        (["-d", "robot.yaml", "--network-config", "/nowhere"], "/nowhere cannot be read"),
        (["-d", "robot.yaml", "no_such_group"], "no_such_group"),
    ],
)
def test_words_that_make_no_sense_end_with_2(
    words: list[str], told: str, monkeypatch: pytest.MonkeyPatch, begun: list[tuple[Sequence[str], str, bool]]
) -> None:
    monkeypatch.setattr("robo.supervisor.early.begin", lambda: None)
    result = CliRunner().invoke(app, ["up", *words])
    assert told in result.output
    assert result.exit_code == 2
    assert not begun
