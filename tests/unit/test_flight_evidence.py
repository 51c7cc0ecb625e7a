"""What a flight recorder's file says beside messages, and what supervisors keep of what recorders tell."""

from typing import Any

import msgspec
import pytest

import robo_messages
from robo.recording.flight.evidence import Evidence, attachments
from robo.supervisor.journal import Journal
from robo.supervisor.snapshots import Snapshots
from robo.wire.explained import explained
from robo.wire.reports import Event, Explanation, LogRecord, SnapshotFile
from robo_messages import Snapshot, Time
from tests.processes import FakeProcess, last_exit, process_plan

SECOND = 1_000_000_000


def explanation(node: str, **more: Any) -> Explanation:
    process = FakeProcess(process_plan(node))
    return msgspec.structs.replace(process.explain(process.status("r1", "run", "here"), []), **more)


def event(**facts: Any) -> Event:
    plain: dict[str, Any] = {
        "time": 1, "robot": "r1", "node": "/r1/base", "event": "failed", "reason": "", "pid": 1, "restarts": 0,
    }  # fmt: skip
    return Event(**(plain | facts))


def never(text: str) -> None:
    raise AssertionError(text)


def test_everything_that_is_known_is_a_file_and_what_is_not_is_none() -> None:
    assert attachments(Evidence(), [], never) == []
    evidence = Evidence(
        [explanation("/r1/laser"), explanation("/r1/base")],
        [event(alarm="died")],
        [LogRecord(time=5, node="base", message="oh", level="WARN")],
        {"/r1/base": {"rate": float("inf"), "data": b"x"}},
    )
    found = {one.name: one.data for one in attachments(evidence, ["/r1/base"], never)}
    assert list(found) == [
        "logs.txt", "why.txt", "logs.jsonl", "why.json", "processes.json", "events.jsonl", "parameters.yaml"
    ]  # fmt: skip
    assert found["why.txt"].startswith(b"/r1/base is ready\n")
    assert b"\n\n/r1/laser is ready\n" in found["why.txt"]
    assert b" base: WARN oh\n" in found["logs.txt"]
    assert b"rate: inf" in found["parameters.yaml"]
    assert msgspec.json.decode(found["processes.json"])[0]["node"] == "/r1/base"
    assert found["events.jsonl"].count(b"\n") == 1


def test_what_cannot_be_made_a_file_of_costs_no_other_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> str:
        raise AssertionError("a name that is a value and a group")

    monkeypatch.setattr("robo.recording.flight.evidence.parameters_yaml", fail)
    said: list[str] = []
    found = attachments(Evidence(events=[event()], parameters={"/r1/base": {}}), [], said.append)
    assert [one.name for one in found] == ["events.jsonl"]
    assert said == ["parameters.yaml is not in the file: AssertionError: a name that is a value and a group"]


def test_logs_say_where_they_are_cut() -> None:
    evidence = Evidence(lines=[LogRecord(time=5, node="base", message="oh")], lines_are_missing=True)
    text = attachments(evidence, [], never)[0].data.decode()
    assert text.startswith("(older lines may be missing: a supervisor keeps the last 5,000)\n")
    assert text.endswith(" base: oh\n")


def told(node: str, number: int = 0) -> Snapshot:
    return Snapshot(Time.from_nanoseconds(number * SECOND), f"/f{number}.mcap", "here", "/r1/rec", ["died"], [node])


def test_a_supervisor_knows_the_last_files_of_each_node() -> None:
    snapshots = Snapshots(["r1", "r1/arm"])
    for number in range(5):
        snapshots.take(robo_messages.encode(told("/r1/base", number)))
    snapshots.take(robo_messages.encode(told("/r1/laser", 9)))
    snapshots.take(robo_messages.encode(told("/r1/laser", 9)))
    for nonsense in (b"", b"\xc1", b"\x80", robo_messages.encode(Time())):
        snapshots.take(nonsense)
    assert [one.file for one in snapshots.of("/r1/base")] == ["/f2.mcap", "/f3.mcap", "/f4.mcap"]
    assert snapshots.of("/r1/laser") == [SnapshotFile(time=9 * SECOND, file="/f9.mcap", host="here", reason="died")]
    assert snapshots.of("/r1/other") == []
    for number in range(1000):
        snapshots.take(robo_messages.encode(told("/r1/other", number)))
    assert snapshots.of("/r1/base") == []


def test_why_names_the_file() -> None:
    file = SnapshotFile(time=1, file="/f.mcap", host="here", reason="died")
    assert any(line.endswith(": /f.mcap on here") for line in explained(explanation("/r1/base", snapshots=[file])))


class Nowhere:
    problem = ""

    def line(self, node: str, text: str) -> None: ...
    def say(self, text: str) -> None: ...
    def warn(self, text: str) -> None: ...
    def write(self, line: LogRecord) -> None: ...


@pytest.mark.parametrize(
    ("state", "code", "storm", "alarm"),
    [
        ("restarting", -9, False, "died"),
        ("failed", 1, False, "died"),
        ("degraded", 1, True, "died"),
        ("degraded", None, False, "degraded"),
        ("degraded", None, True, ""),  # back after a storm
        ("restarting", 0, False, ""),  # it ends well, and is to run always
        ("ready", None, False, ""),
        ("stopped", None, False, ""),
        ("completed", None, False, ""),
    ],
)
def test_which_events_are_faults(state: Any, code: int | None, storm: bool, alarm: str) -> None:
    process = FakeProcess(process_plan("/r1/base")).come_to(state, failed=code is not None)
    process.restarts.storm = storm
    process.exits = [last_exit("x", code=code)] if code is not None else []
    journal = Journal("r1", Nowhere(), Nowhere())
    journal.event(state, "", process)
    assert [one.alarm for one in journal.events()] == [alarm]
