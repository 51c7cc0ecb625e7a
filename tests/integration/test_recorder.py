"""The node `recorder`: records from its manifest, and does what its services are asked."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

import robo_messages
from robo import KEEP_ALL, Node, ParameterError, Publisher, bag
from robo.wire.latched import kept
from robo_messages import DiagnosticStatus, Trigger, Twist
from robo_services.recorder import Recorder
from tests.support import eventually


class Driver(Node):
    command = Publisher(Twist, "cmd_vel", depth=KEEP_ALL)


@contextmanager
def running(session: zenoh.Session, folder: Path, **parameters: object) -> Iterator[Recorder]:
    said = {"folder": str(folder), "compression": "none", "topics": ["cmd_vel"], "make_tf": False} | parameters
    with Recorder(namespace="r1", session=session, parameters=said) as node:
        yield node


@pytest.fixture
def driver(session: zenoh.Session) -> Iterator[Driver]:
    with Driver(namespace="r1", session=session) as node:
        yield node


def ask(session: zenoh.Session, name: str) -> Trigger.Response:
    """Call a service of the recorder, once it is known."""
    payload = robo_messages.encode(Trigger.Request())
    found: list[Trigger.Response] = []

    def answers() -> bool:
        for reply in session.get(f"r1/recorder/{name}", payload=payload, timeout=30.0):
            if reply.ok is not None:
                found.append(robo_messages.decode(reply.ok.payload.to_bytes(), Trigger.Response))
        return bool(found)

    eventually(answers, f"it answers to {name}")
    return found[0]


def drive(driver: Driver, node: Recorder, count: int, before: int = 0) -> None:
    """Publish commands, and wait until all of them have been written, with those that were before."""
    eventually(lambda: driver.command.has_subscribers, "it listens")
    for _ in range(count):
        driver.command.publish(Twist())
    eventually(lambda: received(node) == before + count, "all of them")


def received(node: Recorder) -> int:
    recording = node._recording
    return recording.status().received if recording is not None else 0


def counts(folder: Path) -> list[int]:
    """The messages of each recording, the oldest first."""
    found = []
    for path in sorted(folder.iterdir()):
        assert bag.check(path).findings == []
        with bag.open(path) as opened:
            found.append(opened.count)
    return found


def test_it_records_from_the_start_and_its_file_is_whole_at_the_end(
    other: zenoh.Session, driver: Driver, tmp_path: Path
) -> None:
    with running(other, tmp_path) as node:
        drive(driver, node, 20)
    assert counts(tmp_path) == [20]


def test_it_is_started_split_and_stopped_by_services(
    session: zenoh.Session, other: zenoh.Session, driver: Driver, tmp_path: Path
) -> None:
    with running(other, tmp_path, autostart=False) as node:
        assert ask(session, "stop") == Trigger.Response(False, "it does not record")
        assert not ask(session, "split").success
        assert ask(session, "start").success
        assert ask(session, "start").message.startswith("it records already")
        drive(driver, node, 5)
        assert "_1.mcap" in ask(session, "split").message
        drive(driver, node, 8, before=5)
        assert ask(session, "stop").message.endswith("has 13 messages")
        assert ask(session, "start").success
        drive(driver, node, 2)
    assert counts(tmp_path) == [13, 2]
    assert len(list(min(tmp_path.iterdir()).glob("*.mcap"))) == 2


def test_a_snapshot_is_a_recording_beside_that_which_goes_on(
    session: zenoh.Session, other: zenoh.Session, driver: Driver, tmp_path: Path
) -> None:
    with running(other, tmp_path, autostart=False) as node:
        assert ask(session, "snapshot") == Trigger.Response(False, "it does not record")
        assert ask(session, "start").success
        drive(driver, node, 5)
        assert ask(session, "snapshot").message.endswith("_snapshot has 1 file")
        drive(driver, node, 8, before=5)
        assert ask(session, "snapshot").message.endswith("_snapshot_2 has 2 files")
    assert counts(tmp_path) == [13, 5, 13]


def test_it_tells_how_it_goes(session: zenoh.Session, other: zenoh.Session, driver: Driver, tmp_path: Path) -> None:
    with running(other, tmp_path, topics=["cmd_vel", "nobody"]) as node:
        drive(driver, node, 5)
        session.put("r1/cmd_vel", b"\x01", encoding="application/msgpack;geometry/Twist")
        told: list[DiagnosticStatus] = []

        def says_all() -> bool:
            told.extend(states(session))
            return {"received": "5", "malformed": "1", "lost": "0", "missing": "r1/nobody"}.items() <= values(
                told[-1]
            ).items()

        eventually(says_all, "a message that was malformed")
        assert told[-1].level == DiagnosticStatus.WARN
        assert values(told[-1])["file"].endswith(".mcap")
        eventually(lambda: "1 malformed" in node.it_records().message, "its check says so")
        ask(session, "stop")
        assert states(session)[-1].message == "does not record"


def states(session: zenoh.Session) -> list[DiagnosticStatus]:
    samples = kept(session, "r1/recorder_state", 1)
    return [robo_messages.decode(one.payload.to_bytes(), DiagnosticStatus) for one in samples]


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"topics": ["a//b"]}, "topics or exclude"),
        ({"topics": ["@robo/**"]}, "is no topic"),
        ({"topics": []}, "no topic is named"),
    ],
)
def test_mistakes_in_parameters_are_told_at_the_start(
    other: zenoh.Session, tmp_path: Path, parameters: dict[str, object], text: str
) -> None:
    with pytest.raises(ParameterError, match=text), running(other, tmp_path, **parameters):
        pass


def test_a_folder_that_cannot_be_made_is_an_error(other: zenoh.Session, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(bag.BagError, match="cannot be made"), running(other, tmp_path / "file" / "folder"):
        pass


def test_a_full_disk_is_told_and_the_file_is_whole(other: zenoh.Session, tmp_path: Path) -> None:
    with running(other, tmp_path, least_free=1e8) as node:
        eventually(lambda: node.it_records().level == DiagnosticStatus.ERROR, "others have less than is left to them")
        assert "the disk has less than" in node.it_records().message
    assert counts(tmp_path) == [0]


def test_it_tells_of_each_topic(session: zenoh.Session, other: zenoh.Session, driver: Driver, tmp_path: Path) -> None:
    with running(other, tmp_path) as node:
        drive(driver, node, 5)
        session.put("r1/cmd_vel", b"\x01", encoding="application/msgpack;geometry/Twist")

        def words() -> str:
            return values(states(session)[-1]).get("r1/cmd_vel", "")

        eventually(lambda: words().startswith("5 at ") and words().endswith(" Hz, 1 malformed"), "what came of it")


def test_whatever_ends_it_is_an_error(
    other: zenoh.Session, driver: Driver, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object) -> None:
        raise RuntimeError("odd")

    with running(other, tmp_path) as node:
        drive(driver, node, 5)
        assert node._recording is not None
        monkeypatch.setattr(node._recording._conversion, "convert", fail)
        driver.command.publish(Twist())
        eventually(lambda: node.it_records().level == DiagnosticStatus.ERROR, "it has ended")
        assert node.it_records().message == "the recording has failed: RuntimeError: odd"
    assert counts(tmp_path) == [5]
