"""`robo why` where no robot runs any more: what logs and flight recorders have left."""

import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from robo.bag.edit.excerpt import excerpt
from robo.cli.app import app
from robo.errors import NodeNotFound
from robo.machine.log_files import LogFiles, RunInfo
from robo.recording.flight.shelf import WORDS
from robo.tools.last_run import last_run
from robo.wire.reports import LogRecord
from robo.wire.run_id import new_run_id

SECOND = 1_000_000_000
NOON = 1_700_000_000 * SECOND
PLACE = "tcp/127.0.0.1:1"


def ran(base: Path, run: str = "0-1-0-0", begin: int = NOON, endpoint: str = PLACE) -> LogFiles:
    """The logs of a run whose monitor has died."""
    nodes = ["/r1/safety_monitor", "/r1/base"]
    files = LogFiles(
        RunInfo(
            run=run, robot="r1", manifest="robot.yaml", begin=begin, pid=1, nodes=nodes, groups=["", ""],
            processes=["", ""], endpoints=[endpoint],
        ), base,
    )  # fmt: skip
    files.begin()
    files.write(LogRecord(time=begin + SECOND, node="safety_monitor", message="clear", level="INFO"))
    files.write(LogRecord(time=begin + 2 * SECOND, node="robo", message="safety_monitor was killed", level="WARN"))
    files.write(LogRecord(time=begin + 3 * SECOND, node="robo", message="stopping", level="INFO"))
    files.close()
    return files


def recorded(base: Path, run: str = "0-1-0-0", node: str = "/r1/safety_monitor") -> Path:
    """A file of its flight recorder."""
    folder = base / "r1" / "flight"
    folder.mkdir(exist_ok=True)
    path = folder / f"r1_2026-11-23_20-15-03_{len(list(folder.iterdir()))}.mcap"
    words = {"run": run, "nodes": node, "reason_0": f"{NOON} died: {node} was killed by SIGKILL"}
    excerpt([], path, 0, 1, lambda writer: writer.add_metadata(WORDS, words))
    return path


def test_the_last_run_says_how_it_ended_and_names_its_files(tmp_path: Path) -> None:
    assert last_run(None, [], []) is None
    ran(tmp_path)
    path, other = recorded(tmp_path), recorded(tmp_path, node="/r1/base")
    recorded(tmp_path, run="another")
    (tmp_path / "r1" / "flight" / "nonsense.mcap").write_bytes(b"nonsense")
    found = last_run("r1", [], [], tmp_path)
    assert found is not None
    assert [one.message for one in found.end] == ["safety_monitor was killed", "stopping"]
    assert [one.path for one in found.files] == [path, other]
    assert found.files[0].reasons == ["died: /r1/safety_monitor was killed by SIGKILL"]
    assert found.words == {}
    of_one = last_run("r1", [PLACE], ["safety_monitor"], tmp_path)
    assert of_one is not None
    assert [one.path for one in of_one.files] == [path]
    assert [one.message for one in of_one.words["safety_monitor"]] == ["clear"]


def test_a_run_that_is_not_meant_is_not_told(tmp_path: Path) -> None:
    ran(tmp_path)
    assert last_run("r2", [], [], tmp_path) is None
    assert last_run("r1", ["tcp/127.0.0.1:2"], [], tmp_path) is None
    with pytest.raises(NodeNotFound, match="no node or group laser"):
        last_run("r1", [], ["laser"], tmp_path)
    ran(tmp_path, new_run_id(), time.time_ns())
    assert last_run("r1", [], [], tmp_path) is None, "it goes on"


def test_why_tells_of_it(tmp_path: Path, endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBO_LOG_DIR", str(tmp_path))
    words = ["why", "safety_monitor", "--robot-name", "r1", "--connect", endpoint]
    before = CliRunner().invoke(app, words)
    assert before.exit_code == 1
    ran(tmp_path, endpoint=endpoint)
    path = recorded(tmp_path)
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0
    assert f": {path}\n    died: /r1/safety_monitor was killed by SIGKILL\n" in done.stdout
    assert " WARN safety_monitor was killed\n" in done.stdout
    assert "2023-11-1" in done.stdout, "the date, as it was another day"
    assert CliRunner().invoke(app, [*words, "--json"]).exit_code == 1
