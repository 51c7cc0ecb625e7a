"""The keeper of a Compose project, as a process, with an engine that a test plays."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.played_engine import PlayedEngine, playing
from tests.support import eventually, robo, run_robo


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[PlayedEngine]:
    with playing(tmp_path / "engine.sock") as played:
        yield played


def test_what_is_killed_comes_back_by_its_policy(engine: PlayedEngine, tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    keep = ("keeper", "--project", "mine", "--socket", str(engine.server_address), "--ready-file", str(ready))
    with robo(*keep) as keeper:
        keeper.wait_for("keeps the containers of mine")
        eventually(ready.exists, "the ready file")
        engine.happens("unless-stopped", "kill 15", "kill 9", "die")
        engine.happens("running", "kill 9", "die", "start")
        engine.happens("gone", "kill 9", "die", "destroy")
        engine.happens("crashed", "die")
        engine.happens("hung-up", "kill 1", "die")
        engine.happens("going", "kill 9", "die")
        engine.happens("no", "kill 9", "die")
        engine.happens("refused", "kill 9", "die")
        engine.happens("on-failure", "kill 9", "die")
        engine.happens("always", "kill 9", "die")
        keeper.wait_for("the no one was killed and stays down: its restart policy is no")
        keeper.wait_for("the refused one was killed and stays down: the engine at")
        keeper.wait_for("the on-failure one was killed and is started again")
        keeper.wait_for("the always one was killed and is started again")
        asked: list[str] = []

        def started() -> set[str]:
            asked.extend(engine.asked.get() for _ in range(engine.asked.qsize()))
            return {path.split("/")[2] for path in asked if path.endswith("/start")}

        eventually(lambda: "going" in started(), "of the start of one that is just removed nothing is said")
        keeper.process.send_signal(signal.SIGTERM)
        assert keeper.wait() == 0
    assert started() == {"going", "refused", "on-failure", "always"}
    assert asked[0].startswith("/events")
    assert "mine" in asked[0]
    assert len(keeper.output.splitlines()) == 6


def test_a_keeper_without_an_engine_ends_and_says_why(engine: PlayedEngine, tmp_path: Path) -> None:
    with robo("keeper", "--project", "mine", "--socket", str(engine.server_address)) as keeper:
        keeper.wait_for("keeps the containers of mine")
        engine.ends()
        assert keeper.wait() == 1
    assert "error: the engine at" in keeper.output
    with robo("keeper", "--project", "mine", "--socket", str(engine.server_address)) as keeper:
        keeper.wait_for("keeps the containers of mine")
        engine.events.put(b'{"Type": "container", "Act')
        engine.ends()
        assert keeper.wait() == 1
    assert "error: the engine at" in keeper.output

    absent = run_robo("keeper", "--project", "mine", "--socket", str(tmp_path / "nothing.sock"))
    assert absent.returncode == 1
    assert "nothing.sock does not answer: No such file or directory; --socket names another" in absent.stderr
    a_folder = run_robo("keeper", "--project", "mine", "--socket", str(tmp_path))
    assert a_folder.returncode == 1
    assert "Traceback" not in a_folder.stderr
