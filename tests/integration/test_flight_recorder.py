"""The flight recorder among nodes: what it keeps, what makes it write, and what keeps it from it."""

import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import psutil
import pytest
import zenoh

from robo import Node, Publisher, bag
from robo.bag.edit.excerpt import excerpt
from robo.bag.read.reader import Bag
from robo.bag.types import topic_of
from robo.errors import FlightRecorderError
from robo.recording.flight.intake import FlightIntake
from robo.recording.flight.ring import Limits, Ring, ring_folder
from robo.recording.selection import Selection
from robo.testing.heard import Heard
from robo.wire.keys import control_key, event_key
from robo.wire.reports import Event
from robo_messages import Clock as SaidClock
from robo_messages import DiagnosticStatus, KeyValue, Odometry, String, TakeSnapshot, Time, Twist, Vector3
from robo_services.flight_recorder import FlightRecorder
from tests import bags
from tests.bags import START
from tests.support import PATIENCE, eventually

pytestmark = pytest.mark.timeout(120)

SECOND = 1_000_000_000


class Robot(Node):
    """Something to be recorded."""

    command = Publisher(Twist, "cmd_vel")
    odometry = Publisher(Odometry, "odom")
    map = Publisher(String, "map", latched=True)
    text = Publisher(String, "text")
    state = Publisher(DiagnosticStatus, "safety_state", latched=True)


class Lab:
    """A robot and a flight recorder, each with a session of its own."""

    def __init__(self, folder: Path, session: zenoh.Session, other: zenoh.Session) -> None:
        self.folder = folder
        self._session = session
        self._undo = ExitStack()
        self.robot = Robot(namespace="r1", name="robot")
        self.robot.start(other)
        self._undo.callback(self.robot.close)
        self.recorders: list[FlightRecorder] = []

    def record(self, name: str = "flight_recorder", **parameters: Any) -> FlightRecorder:
        given = {"before": 10.0, "after": 0.3, "folder": str(self.folder / "files"), "ring_folder": str(self.folder)}
        recorder = FlightRecorder(namespace="r1", name=name, parameters=given | parameters)
        recorder.start(self._session)
        self._undo.callback(recorder.close)
        self.recorders.append(recorder)
        return recorder

    def drive(self, count: int) -> None:
        """Publish commands, and wait until they are in the ring."""
        for number in range(count):
            self.robot.command.publish(Twist(Vector3(x=float(number))))
        self.robot.flush()

    def snapshots(self) -> list[Path]:
        return sorted((self.folder / "files").glob("*.mcap"))

    def snapshot(self, number: int = 0) -> Bag:
        eventually(lambda: len(self.snapshots()) > number, "a file")
        return self._undo.enter_context(bag.open(self.snapshots()[number]))

    def close(self) -> None:
        self._undo.close()


@pytest.fixture
def lab(tmp_path: Path, session: zenoh.Session, other: zenoh.Session) -> Iterator[Lab]:
    made = Lab(tmp_path, session, other)
    yield made
    made.close()


def ask(node: Node, reason: str = "") -> TakeSnapshot.Response:
    client = node.create_client(TakeSnapshot.Request, TakeSnapshot.Response, "/r1/flight_recorder/snapshot", 30.0)
    return client(TakeSnapshot.Request(reason))


def event(alarm: str, node: str = "/r1/base", **more: Any) -> Event:
    facts = {"robot": "r1", "reason": "was killed by SIGKILL", "pid": 1, "restarts": 0}
    return msgspec.convert(
        {"time": time.time_ns(), "event": "failed", "node": node, "alarm": alarm, **facts, **more}, Event
    )


def values(found: Bag) -> list[float]:
    return [message.value.linear.x for message in found.messages("r1/cmd_vel")]  # type: ignore[union-attr]


def test_whoever_asks_gets_a_file(lab: Lab, other: zenoh.Session) -> None:
    lab.robot.map.publish(String("kitchen"))
    lab.record()
    heard = Heard(other, "r1/flight_snapshots")
    lab.drive(100)
    answer = ask(lab.robot, "it turned left")
    assert answer.success, answer.message
    assert [str(path) for path in lab.snapshots()] == [answer.snapshot.file]
    assert answer.snapshot.file.endswith("_it_turned_left.mcap")
    found = lab.snapshot()
    assert values(found) == [float(number) for number in range(100)]
    assert [message.value for message in found.messages("r1/map")] == [String("kitchen")], "said before it began"
    assert found.topics["r1/map"].qos.latched
    assert found.metadata["flight_recorder"]["reason_0"].endswith("asked: it turned left")
    assert b"before: 10.0" in found.attachment("parameters.yaml")
    assert b'"/r1/robot"' in found.attachment("graph.json")
    assert not [one for one in bag.check(answer.snapshot.file).findings if one.kind.value != "hole"]
    told = heard.wait_for("r1/flight_snapshots", bool, PATIENCE)
    assert told == answer.snapshot


def test_a_node_that_dies_makes_a_file_once(lab: Lab, other: zenoh.Session) -> None:
    lab.record()
    lab.drive(10)
    tell = other.declare_publisher(event_key("r1"))
    for one in (
        event("", reason="as asked"),
        event("died", "/r2/base"),
        event("died", "/r1/flight_recorder"),
    ):
        tell.put(msgspec.msgpack.encode(one))
    tell.put(b"nonsense")
    tell.put(msgspec.msgpack.encode(event("died")))
    tell.put(msgspec.msgpack.encode(event("degraded", "/r1/laser", reason="nothing on r1/scan for 3.0 s")))
    words = lab.snapshot().metadata["flight_recorder"]
    assert lab.snapshots()[0].name.endswith("_base_died.mcap")
    assert words["nodes"] == "/r1/base /r1/laser"
    assert words["reason_0"].endswith("died: /r1/base was killed by SIGKILL")
    assert words["reason_1"].endswith("degraded: /r1/laser nothing on r1/scan for 3.0 s")
    tell.put(msgspec.msgpack.encode(event("died")))
    assert ask(lab.robot).success
    assert len(lab.snapshots()) == 2, "the same again, and somebody has asked"


def state(reason: str) -> DiagnosticStatus:
    return DiagnosticStatus(2, "/r1/robot", f"because of {reason}", values=[KeyValue("reason", reason)])


def test_an_emergency_stop_makes_a_file_and_one_that_holds_makes_none(lab: Lab) -> None:
    lab.robot.state.publish(state("emergency_stop"))
    lab.record()
    lab.robot.flush()
    lab.robot.state.publish(state("no_command"))
    lab.robot.state.publish(state("emergency_stop"))
    lab.robot.state.publish(state("emergency_stop"))
    found = lab.snapshot()
    assert lab.snapshots()[0].name.endswith("_robot_emergency_stop.mcap")
    assert found.metadata["flight_recorder"]["reason_0"].endswith("/r1/robot because of emergency_stop")
    assert "reason_1" not in found.metadata["flight_recorder"]


def test_what_is_not_wanted_is_not_kept(lab: Lab) -> None:
    lab.record(topics=["**", "/clock"], exclude=["od*", "log"])
    lab.robot.odometry.publish(Odometry())
    lab.drive(3)
    ask(lab.robot)
    topics = set(lab.snapshot().topics)
    assert "r1/cmd_vel" in topics
    assert not topics & {"r1/odom", "r1/log"}


def test_seconds_are_the_machines_whatever_clock_the_robot_has(lab: Lab, other: zenoh.Session) -> None:
    clock = other.declare_publisher("clock", encoding="application/msgpack;system/Clock")
    lab.record(use_sim_time=True)
    clock.put(msgspec.msgpack.encode(SaidClock(Time(5))))
    lab.drive(20)
    assert ask(lab.robot, "now").success  # though the simulated time stands
    assert len(values(lab.snapshot())) == 20


def test_a_second_recorder_is_refused(lab: Lab, tmp_path: Path) -> None:
    lab.record()
    with pytest.raises(FlightRecorderError, match="has a flight recorder already, /r1/flight_recorder"):
        lab.record("another", ring_folder=str(tmp_path / "elsewhere"))


def warned(recorder: FlightRecorder) -> str:
    return recorder.all_is_kept().message


def test_a_folder_that_cannot_be_written_stops_nothing(lab: Lab) -> None:
    (lab.folder / "file").write_bytes(b"")
    recorder = lab.record(folder=str(lab.folder / "file"))
    lab.drive(5)
    answer = ask(lab.robot)
    assert (answer.success, "the folder cannot be made" in answer.message) == (False, True)
    assert "no file could be written" in warned(recorder)
    (lab.folder / "file").unlink()
    lab.drive(5)
    assert ask(lab.robot).success
    assert warned(recorder) == ""
    with bag.open(next((lab.folder / "file").glob("*.mcap"))) as found:
        assert len(values(found)) == 10


def test_a_ring_that_cannot_be_written_is_tried_again(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.recording.flight.keeping._RETRY", 0.1)
    (lab.folder / "ring").write_bytes(b"")
    recorder = lab.record(ring_folder=str(lab.folder / "ring"))
    assert "nothing is kept" in warned(recorder)
    assert ask(lab.robot, "nothing").success, "what is known is in a file all the same"
    (lab.folder / "ring").unlink()
    eventually(lambda: warned(recorder) == "", "it keeps again")
    lab.drive(5)
    assert ask(lab.robot).success
    assert len(values(lab.snapshot(1))) == 5


def test_a_ring_whose_disk_is_full_goes_on_when_there_is_room(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.recording.flight.keeping._RETRY", 0.1)
    monkeypatch.setattr("robo.recording.flight.ring._LEAST_FREE", 10**18)
    recorder = lab.record()
    lab.drive(5)
    eventually(lambda: "the recording has ended" in warned(recorder), "the disk is full")
    monkeypatch.setattr("robo.recording.flight.ring._LEAST_FREE", 0)
    eventually(lambda: warned(recorder) == "", "there is room")
    lab.drive(5)
    assert ask(lab.robot).success
    assert len(values(lab.snapshot())) >= 5


def test_a_ring_whose_folder_goes_for_good_goes_on_elsewhere(
    lab: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robo.recording.flight.keeping._RETRY", 0.1)
    gone, lasting = tmp_path / "run" / "robo-flight", tmp_path / "lasting"
    monkeypatch.setattr("robo_services.flight_recorder.default_bases", lambda: [gone, lasting])
    recorder = lab.record(ring_folder="")
    lab.drive(5)
    eventually(lambda: recorder.all_is_kept().values["ring_size"] != "0", "it is kept")
    aside = gone.parent.rename(tmp_path / "aside")  # at once: the recorder would make again what goes file by file
    gone.parent.write_bytes(b"")
    shutil.rmtree(aside)

    def goes_on() -> bool:
        lab.drive(1)
        return list(lasting.rglob("*.mcap")) != []

    eventually(goes_on, "it goes on")
    eventually(lambda: warned(recorder) == "", "all is well")
    lab.drive(5)
    assert ask(lab.robot).success
    assert len(values(lab.snapshot())) >= 5


def test_one_step_that_fails_ends_nothing(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.recording.flight.keeping._RETRY", 0.1)
    recorder = lab.record()
    lab.drive(5)
    failed = threading.Event()

    def fail(*_: object) -> None:
        failed.set()
        raise RuntimeError("nobody has thought of this")

    with monkeypatch.context() as patched:
        patched.setattr("robo.recording.flight.intake.FlightIntake.batch", fail)
        assert failed.wait(PATIENCE)
        eventually(lambda: "RuntimeError: nobody has thought of this" in warned(recorder), "it is told")
    eventually(lambda: warned(recorder) == "", "it goes on")
    lab.drive(5)
    assert ask(lab.robot).success
    assert len(values(lab.snapshot())) >= 5


def test_a_message_that_nobody_has_thought_of_costs_no_other_one(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("what is this")

    monkeypatch.setattr("robo.recording.odometry.TransformsOfOdometry._of_odometry", fail)
    recorder = lab.record()
    lab.robot.odometry.publish(Odometry())
    lab.drive(5)
    assert ask(lab.robot).success
    assert len(values(lab.snapshot())) == 5
    assert warned(recorder) == ""


def test_what_others_know_is_missing_where_nobody_can_be_asked(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise zenoh.ZError("the session is closed")

    monkeypatch.setattr("robo.recording.flight.evidence.Witnesses.testimony", fail)
    lab.record()
    lab.drive(5)
    assert ask(lab.robot).success
    assert len(values(lab.snapshot())) == 5


def test_what_others_have_left_stays_until_there_is_a_file_of_it(
    lab: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robo.recording.flight.flight._PARAMETERS", 0.2)
    ring = Ring(ring_folder(tmp_path, "r1", "dead"), Limits(duration=30.0, size=1_000_000), START)
    number = ring.recording.topic(topic_of("r1/cmd_vel", Twist))
    for sequence in range(1, 11):
        ring.recording.write(number, bags.twist(sequence), START, START, sequence, "commander")
    ring.close(remove=False)
    (lab.folder / "files").write_bytes(b"")
    recorder = lab.record()
    eventually(lambda: "no file could be written" in warned(recorder), "it is told")
    assert list((tmp_path / "r1" / "dead").rglob("*.mcap"))
    (lab.folder / "files").unlink()
    eventually(lambda: not (tmp_path / "r1" / "dead").exists(), "it is written")
    assert lab.snapshots()[0].name.endswith("_run_ended.mcap")
    assert lab.snapshot().metadata["flight_recorder"]["run"] == "dead"


def test_a_clock_that_is_set_costs_nothing(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    real = time.time_ns
    recorder = lab.record()
    assert recorder._flight is not None
    lab.drive(10)
    eventually(lambda: recorder.all_is_kept().values["ring_size"] != "0", "it is kept")
    for hour in (3600 * SECOND, 0):

        def told(by: int = hour) -> int:
            return real() + by

        monkeypatch.setattr("time.time_ns", told)
        monkeypatch.setattr(recorder._flight._clock, "_wall", told)
        lab.drive(10)
        answer = ask(lab.robot)
        assert answer.success
        assert abs(answer.snapshot.stamp.to_nanoseconds() - time.time_ns()) < 60 * SECOND
    assert len(values(lab.snapshot(1))) == 20, "an hour later, by its name"
    found = lab.snapshot(0)
    assert len(values(found)) == 30
    assert abs(found.end - real()) < 60 * SECOND


def test_a_file_is_there_soon_whatever_happens_meanwhile_and_whoever_does_not_answer(
    lab: Lab, other: zenoh.Session
) -> None:
    asked: list[zenoh.Query] = []  # which are never answered
    silent = other.declare_queryable(control_key("**", "*"), asked.append)
    lab.record(after=1.0)
    lab.drive(5)
    tell = other.declare_publisher(event_key("r1"))
    begin = time.time_ns()
    number = 0
    while not lab.snapshots():
        number += 1
        tell.put(msgspec.msgpack.encode(event("died", f"/r1/node_{number}")))
        time.sleep(0.1)  # something happens all the time
        assert time.time_ns() - begin < PATIENCE * SECOND
    took = (lab.snapshots()[0].stat().st_mtime_ns - begin) / SECOND
    assert took < 4.5, "two seconds until it is due, and two for those who are silent"
    assert asked
    silent.undeclare()


def test_while_a_file_is_written_what_happens_waits_for_one_more(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    writing, go_on = threading.Event(), threading.Event()

    def slow(*arguments: Any, **more: Any) -> None:
        writing.set()
        assert go_on.wait(PATIENCE)
        excerpt(*arguments, **more)

    monkeypatch.setattr("robo.recording.flight.files.excerpt", slow)
    lab.record(after=0.0)
    lab.drive(5)
    answers: list[TakeSnapshot.Response] = []
    threads = [threading.Thread(target=lambda: answers.append(ask(lab.robot, "it"))) for _ in range(4)]
    threads[0].start()
    assert writing.wait(PATIENCE)
    for thread in threads[1:]:
        thread.start()
    lab.drive(5)
    held = lab.folder / "r1"
    eventually(lambda: len(list(held.glob("*/held/*"))) == 1, "one is being written")
    go_on.set()
    for thread in threads:
        thread.join()
    assert 2 <= len(lab.snapshots()) <= 3, "one, what waited, and whoever asked later still"
    assert all(answer.success for answer in answers)


def size_of_recordings(folder: Path) -> int:
    """Bytes, of all that are below a folder; they come and go meanwhile."""
    size = 0
    for where, _, files in os.walk(folder):
        for name in files:
            with suppress(FileNotFoundError):
                size += (Path(where) / name).stat().st_size if name.endswith(".mcap") else 0
    return size


def test_what_comes_too_fast_takes_no_more_than_is_granted(lab: Lab, tmp_path: Path) -> None:
    lab.record(ring_size=1.0, most_files=2, most_size=1.0, again=0.0)
    lab.robot.map.publish(String("kitchen" * 100))
    most = 0
    memory = psutil.Process().memory_info
    before = 0
    for part in range(60):
        for _ in range(50):
            lab.robot.text.publish(String(os.urandom(5_000).hex()))
        lab.robot.flush()
        most = max(most, size_of_recordings(tmp_path / "r1"))
        if part in (20, 40):
            assert ask(lab.robot).success
            before = before or memory().rss
    assert 500_000 < most < 3_000_000, "the ring, what is held for a file, and what comes between two looks"
    assert sum(path.stat().st_size for path in lab.snapshots()) < 2_000_000
    assert memory().rss - before < 50e6
    assert [message.value for message in lab.snapshot().messages("r1/map")] == [String("kitchen" * 100)]


def test_what_has_waited_for_long_is_taken_in_up_to_a_limit(
    session: zenoh.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("robo.recording.flight.intake.MOST_AT_ONCE", 1_000)
    intake = FlightIntake(
        session, Selection(["r1/**"]), lambda _: None, lambda _topic, _publisher: None, time.time_ns()
    )
    facts = {"key_expr": "r1/picture", "kind": zenoh.SampleKind.PUT}
    waiting = [SimpleNamespace(payload=bytes([number]) * 300, **facts) for number in range(10)]
    intake._channels = [(0, SimpleNamespace(try_recv=lambda: waiting.pop(0) if waiting else None))]
    intake._empty_channels(0)
    assert [row[2].payload[0] for row in intake._row] == [7, 8, 9], "the newest"
    assert intake.dropped == 7
    intake._row.clear()
    intake.close()


def test_a_recorder_that_is_stopped_writes_what_is_due_and_leaves_no_ring(lab: Lab, other: zenoh.Session) -> None:
    recorder = lab.record(after=60.0)
    lab.drive(5)
    other.put(event_key("r1"), msgspec.msgpack.encode(event("died")))
    flight = recorder._flight
    assert flight is not None
    eventually(lambda: len(flight._jobs) == 1, "it has heard of it")
    recorder.close()
    assert len(values(lab.snapshot())) == 5
    assert [path.name for path in lab.folder.iterdir()] == ["files"]


def test_many_asks_at_once_are_one_file(lab: Lab) -> None:
    lab.record(after=1.0)
    answers: list[TakeSnapshot.Response] = []
    asking: list[Callable[[], None]] = [lambda: answers.append(ask(lab.robot, "one")) for _ in range(5)]
    threads = [threading.Thread(target=one) for one in asking]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({answer.snapshot.file for answer in answers}) == 1
    assert os.path.exists(answers[0].snapshot.file)
    assert len(answers[0].snapshot.reasons) == 5
