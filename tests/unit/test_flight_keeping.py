"""A flight recorder's ring, whatever becomes of its disk; and the rings of runs that are over."""

from pathlib import Path
from typing import Any

import pytest

from robo import bag
from robo.bag.types import topic_of
from robo.recording.conversion import Converted
from robo.recording.flight import keeping
from robo.recording.flight.files import FlightFiles, Recorder, Settings
from robo.recording.flight.keeping import Keeping, Place
from robo.recording.flight.left_behind import LeftBehind
from robo.recording.flight.ring import Limits, Ring, ring_folder
from robo.wire.qos import QoS
from robo.wire.run_id import new_run_id
from robo_messages import String, Twist
from tests import bags
from tests.bags import START

SECOND = 1_000_000_000


class Log:
    def __init__(self) -> None:
        self.said: list[str] = []

    def info(self, text: str, *values: object) -> None:
        self.said.append(text % values)

    warning = error = info


def message(number: int, data: bytes = b"", qos: QoS = QoS.DEFAULT) -> Converted:
    topic = topic_of("r1/map", String, qos) if data else topic_of("r1/cmd_vel", Twist)
    at = START + number * SECOND
    return Converted(topic, data or bags.twist(number), at, at, number + 1, "somebody")


def keep(base: Path, log: Log, size: int = 1_000_000) -> Keeping:
    return Keeping(Place([base], "r1", "run"), Limits(duration=10.0, size=size), log, START)


def test_what_fails_is_told_once_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keeping, "_RETRY", 0.0)
    monkeypatch.setattr("robo.recording.flight.ring._LEAST_FREE", 10**18)
    log = Log()
    kept = keep(tmp_path, log)
    kept.keep([message(0)])
    for second in range(1, 10):
        kept.tend(START + second * SECOND)
        kept.keep([message(second)])
    kept.lose(RuntimeError("what is this"))
    assert len([one for one in log.said if one.startswith("nothing is kept: ")]) <= 1
    assert kept.problem == "RuntimeError: what is this"
    monkeypatch.setattr("robo.recording.flight.ring._LEAST_FREE", 0)
    kept.tend(START + 10 * SECOND)
    assert kept.problem == ""
    assert log.said[-1] == "all topics are kept again"
    kept.close(remove=True)
    assert list(tmp_path.iterdir()) == []


def test_much_that_is_latched_is_told(tmp_path: Path) -> None:
    log = Log()
    kept = keep(tmp_path, log, 100_000)
    kept.keep([message(0, bytes(40_000), QoS.LATCHED)])
    kept.tend(START + SECOND)
    assert log.said == []
    for second in (1, 2):
        kept.keep([message(second, bytes(60_000), QoS.LATCHED)])
        kept.tend(START + second * SECOND)
    (told,) = log.said
    assert told.startswith("latched topics have said 0.1 MB, and the ring has 0.1 MB: it keeps few seconds;")
    kept.close(remove=True)


def dead(base: Path, run: str) -> Path:
    """What a recorder has left that was killed."""
    folder = ring_folder(base, "r1", run)
    ring = Ring(folder, Limits(duration=10.0, size=1_000_000), START)
    number = ring.recording.topic(topic_of("r1/cmd_vel", Twist))
    ring.recording.write(number, bags.twist(1.0), START, START, 1, "somebody")
    ring.close(remove=False)
    return folder


def left_behind(tmp_path: Path, log: Log) -> LeftBehind:
    bases = [tmp_path / "first", tmp_path / "second"]
    settings = Settings(
        before=10.0, after=1.0, again=60.0, ring_size=1_000_000, ring_bases=bases, folder=tmp_path / "files",
        most_files=20, most_size=10**9, compression="none",
    )  # fmt: skip
    witnesses: Any = None  # nobody is asked
    recorder = Recorder("/r1/recorder", "r1", "run", True)
    files = FlightFiles(recorder, settings, witnesses, log, log.warning, lambda _: None)
    return LeftBehind(files, Place(bases, "r1", "run"))


def test_rings_of_runs_that_are_over_become_files_wherever_they_are(tmp_path: Path) -> None:
    rings = [dead(tmp_path / "first", "1-1-0-another_container"), dead(tmp_path / "second", "2-1-0-0")]
    lives, own = dead(tmp_path / "first", new_run_id()), dead(tmp_path / "first", "run")
    locked = Ring(ring_folder(tmp_path / "second", "r1", "3-1-0-0"), Limits(duration=10.0, size=1_000_000), START)
    found = left_behind(tmp_path, Log())
    found.write()
    assert not found.remain
    assert [path.exists() for path in (*rings, lives, own, locked.folder)] == [False, False, True, True, True]
    files = sorted((tmp_path / "files").iterdir())
    assert len(files) == 2
    with bag.open(files[0]) as one:
        assert one.metadata["flight_recorder"]["run"] == "1-1-0-another_container"
        assert one.count == 1
    locked.close()


def test_rings_stay_until_there_are_files_and_no_more_than_a_few(tmp_path: Path) -> None:
    (tmp_path / "files").write_bytes(b"")
    rings = [dead(tmp_path / "first", f"{number}-1-0-0") for number in range(5)]
    log = Log()
    found = left_behind(tmp_path, log)
    for _ in range(3):
        found.write()
    remained = found.remain
    assert remained
    assert [ring.exists() for ring in rings] == [False, False, True, True, True]
    assert len(log.said) == 1
    (tmp_path / "files").unlink()
    found.write()
    assert not found.remain
    assert not any(ring.exists() for ring in rings)
    assert len(list((tmp_path / "files").iterdir())) == 3
