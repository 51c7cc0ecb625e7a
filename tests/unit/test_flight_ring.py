"""The ring of a flight recorder: what it keeps, what it may take, and what is left when its process is killed."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from robo import bag
from robo.bag.edit.excerpt import excerpt
from robo.bag.types import topic_of
from robo.errors import BagError, FlightRecorderError
from robo.recording.flight.ring import (
    Limits,
    OldFile,
    Ring,
    claimed,
    default_bases,
    ring_folder,
    rings_without_owner,
    taken_over,
)
from robo.recording.flight.shelf import Shelf
from robo.recording.flight.windows import Reason, Windows, file_name
from robo.wire.qos import QoS
from robo_messages import String, Twist
from tests import bags
from tests.bags import START

SECOND = 1_000_000_000
HOUR = 3600


def room(_: Path) -> int:
    return 10**12


class Filled:
    """A ring with a latched topic and commands."""

    def __init__(self, folder: Path, size: int = 1_000_000, duration: float = 10.0) -> None:
        self.ring = Ring(folder, Limits(duration=duration, size=size), START, free=room)
        self.sequence = 0
        self._map = self.ring.recording.topic(topic_of("r1/map", String, QoS.LATCHED))
        self._commands = self.ring.recording.topic(topic_of("r1/cmd_vel", Twist))
        text = b"\0\1\0\0\4\0\0\0map\0"
        self.ring.recording.write(self._map, text, START, START, 1, "mapper")

    def fill(self, begin: float, end: float, rate: float = 100.0, padding: int = 0) -> None:
        for number in range(round((end - begin) * rate)):
            at = START + round((begin + number / rate) * SECOND)
            self.sequence += 1
            data = bags.twist(self.sequence) + bytes(padding)
            self.ring.recording.write(self._commands, data, at, at, self.sequence, "commander")

    def snapshot(self, output: Path, begin: float, end: float) -> bag.Bag:
        folder, recordings = self.ring.hold(START + round(end * SECOND))
        at = START + round(begin * SECOND), START + round(end * SECOND)
        excerpt(recordings, output, *at, lambda writer: writer.add_attachment(1, 1, "why.txt", "text/plain", b"?"))
        shutil.rmtree(folder)
        return bag.open(output)


@pytest.fixture
def filled(tmp_path: Path) -> Iterator[Filled]:
    made = Filled(tmp_path / "ring")
    yield made
    made.ring.close()
    assert not (tmp_path / "ring").exists()


def test_an_excerpt_has_the_last_seconds_and_what_was_latched_before(filled: Filled, tmp_path: Path) -> None:
    filled.fill(0.0, 60.0)
    with filled.snapshot(tmp_path / "out.mcap", 50.0, 58.0) as found:
        times = found.times("r1/cmd_vel")
        assert (times[0] - START) / SECOND == 50.0
        assert (times[-1] - START) / SECOND == pytest.approx(57.99)
        assert len(times) == 800
        assert [message.value for message in found.messages("r1/map")] == [String("map")]
        assert [message.arrived for message in found.messages("r1/map")] == [found.begin]
        assert found.attachment("why.txt") == b"?"
    assert bag.check(tmp_path / "out.mcap").findings == []


def test_what_was_there_before_the_window_is_gone_soon(filled: Filled) -> None:
    filled.fill(0.0, 60.0)
    files = filled.ring.recording.files
    assert 8 <= len(files) <= 11, "of a second and a quarter each, for ten seconds"
    with bag.open(files[0].parent) as found:
        assert START + 47 * SECOND <= found.begin <= START + 50 * SECOND


def test_what_goes_from_the_ring_meanwhile_is_in_the_excerpt(filled: Filled, tmp_path: Path) -> None:
    filled.fill(0.0, 20.0)
    _, recordings = filled.ring.hold(START + 20 * SECOND)
    filled.fill(20.0, 60.0)
    excerpt(recordings, tmp_path / "out.mcap", START + 10 * SECOND, START + 20 * SECOND, lambda _: None)
    with bag.open(tmp_path / "out.mcap") as found:
        assert found.topic("r1/cmd_vel").count == 1000


def test_an_hour_of_ten_times_the_data_takes_no_more_than_is_granted(tmp_path: Path) -> None:
    """Of 30 s a tenth fits in; it is looked at every two seconds, and every twenty something happens for a second time:
    each file holds what there was, and is written while the next seconds come.
    """
    size, rate, padding = 60_000, 20.0, 900
    filled = Filled(tmp_path / "ring", size, 30.0)
    shelf = Shelf(tmp_path / "files", "r1")
    windows = Windows(30.0, 2.0, 60.0)
    memory = psutil.Process().memory_info
    before, most, most_held, most_shelf, made = 0, 0, 0, 0, 0
    for second in range(0, HOUR, 2):
        at = START + second * SECOND
        filled.fill(second, second + 2, rate, padding)
        filled.ring.recording.flush()
        filled.ring.look(at)
        if second == HOUR // 10:
            before = memory().rss
        if second % 20 == 0:
            windows.add(Reason(at, "died", f"/r1/node_{second % 600}", ""))
        if (window := windows.take(at)) is not None:
            folder, recordings = filled.ring.hold(at)
            most_held = max(most_held, used(tmp_path / "ring"))
            new = shelf.add(file_name("r1", window), lambda path: excerpt(
                recordings, path, window.begin, window.due, lambda _: None, "none"  # noqa: B023 - it is written at once
            ))  # fmt: skip
            shutil.rmtree(folder)
            shelf.keep_newest(new, 3, 200_000)
            made += 1
            most_shelf = max(most_shelf, sum(path.stat().st_size for path in shelf.files()))
        most = max(most, used(tmp_path / "ring"))
    assert filled.sequence == HOUR * rate
    # What comes within two seconds, and the types, before a file is found to be full.
    part = 2 * padding * rate + 15_000
    assert size / 2 < most < size + part
    assert most_held < 2 * (size + part), "a file that is being written holds what was there once"
    assert made == HOUR / 20
    assert most_shelf < 200_000
    assert len(shelf.files()) == 3
    assert memory().rss - before < 20e6
    filled.ring.close()


def used(folder: Path) -> int:
    """What a folder takes of its disk, bytes: a file with two names is one."""
    found = {(stat := path.stat()).st_ino: stat.st_size for path in folder.rglob("*.mcap")}
    return sum(found.values())


def test_files_of_others_in_the_folder_are_left_alone(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path, "r1")
    others = [
        "kitchen_2026-01-01_00-00-00.mcap",
        "mine.mcap",
        "r1_2026-01-01_00-00-00.mcap",
        "r2_2026-01-01_00-00-00_x.mcap",
    ]
    for name in others:
        (tmp_path / name).write_bytes(b"x" * 1000)
    for number in range(5):
        shelf.add(f"r1_2026-01-01_00-00-0{number}_died", lambda path: path.write_bytes(b"x"))
    new = shelf.add("r1_2026-01-01_00-00-04_died", lambda path: path.write_bytes(b"y"))
    shelf.keep_newest(new, 2, 1000)
    own = ["r1_2026-01-01_00-00-04_died.mcap", "r1_2026-01-01_00-00-04_died_2.mcap"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*others, *own])


def test_the_newest_file_stays_though_the_clock_was_set_back(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path, "r1")
    for number in range(3):
        new = shelf.add(f"r1_2026-01-01_00-00-0{number}_died", lambda path: path.write_bytes(b"x"))
    os.utime(new, (0, 0))
    assert [path.name for path in shelf.keep_newest(new, 2, 1000)] == ["r1_2026-01-01_00-00-00_died.mcap"]


def test_what_a_killed_recorder_had_begun_to_write_goes(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        pass
    name = "r1_2026-01-01_00-00-00_died.mcap"
    drafts = [f".{name}.{dead.pid}.part", f".{name}.{os.getpid()}.part", f".{name}.{os.getppid()}.part"]
    drafts += [f".r2{name}.{dead.pid}.part", f".{name}.x.part"]
    for draft in drafts:
        (tmp_path / draft).write_bytes(b"")
    Shelf(tmp_path, "r1").remove_drafts()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(drafts[2:])
    Shelf(tmp_path / "nowhere", "r1").remove_drafts()


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    def fail(path: Path) -> None:
        path.with_suffix(".other").write_bytes(b"")
        raise BagError("no room", str(path))

    with pytest.raises(BagError, match="no room"):
        Shelf(tmp_path / "new", "r1").add("r1_2026-01-01_00-00-00", fail)
    assert Shelf(tmp_path / "new", "r1").files() == []
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(BagError, match="the folder cannot be made"):
        Shelf(tmp_path / "file" / "inner", "r1").add("x", fail)


def killed(folder: Path) -> int:
    """A ring whose process was killed; how many commands are in it for good."""
    command = [sys.executable, "-m", "tests.flight_process", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) >= 500:
                process.send_signal(signal.SIGKILL)
                written = int(line)
                break
        return max([written, *map(int, process.stdout)])


@pytest.mark.timeout(60)
def test_a_ring_survives_the_kill_of_its_process(tmp_path: Path) -> None:
    written = killed(tmp_path / "ring")
    now = max(one.end for files in taken_over(tmp_path / "ring").values() for one in files)
    ring = Ring(tmp_path / "ring", Limits(duration=30.0, size=10_000_000), now, free=room)
    assert ring.taken
    number = ring.recording.topic(topic_of("r1/cmd_vel", Twist))
    ring.recording.write(number, bags.twist(0.0), now + SECOND, now + SECOND, 1, "there")
    _, recordings = ring.hold(now + 2 * SECOND)
    excerpt(recordings, tmp_path / "out.mcap", now - 30 * SECOND, now + 2 * SECOND, lambda _: None)
    with bag.open(tmp_path / "out.mcap") as found:
        assert found.topic("r1/cmd_vel").count >= written + 1
        assert found.end == now + SECOND
    assert bag.check(tmp_path / "out.mcap").messages >= written + 1
    ring.look(now + 29 * SECOND)
    assert ring.taken
    ring.look(now + 31 * SECOND)
    assert sorted(path.name for path in (tmp_path / "ring").iterdir()) == ["2", "held", "lock"]
    ring.close()


def test_what_cannot_be_read_of_a_dead_ring_goes(tmp_path: Path) -> None:
    (tmp_path / "ring" / "1").mkdir(parents=True)
    bags.drive(tmp_path / "ring" / "1" / "1_0.mcap")
    (tmp_path / "ring" / "1" / "1_1.mcap").write_bytes(b"\x89MCAP0\r\n")
    (tmp_path / "ring" / "1" / "1_2.mcap").write_bytes(b"nonsense")
    (tmp_path / "ring" / "2").mkdir()
    (tmp_path / "ring" / "x").mkdir()
    found = taken_over(tmp_path / "ring")
    assert {number: [one.path.name for one in files] for number, files in found.items()} == {1: ["1_0.mcap"]}
    assert isinstance(found[1][0], OldFile)
    assert sorted(path.name for path in (tmp_path / "ring").rglob("*")) == ["1", "1_0.mcap", "x"]


def test_a_recorder_that_was_killed_before_its_first_message_is_in_nobodys_way(tmp_path: Path) -> None:
    (tmp_path / "ring" / "1").mkdir(parents=True)
    (tmp_path / "ring" / "1" / "1_0.mcap").write_bytes(b"\x89MCAP0\r\n")
    limits = Limits(duration=1.0, size=1000)
    ring = Ring(tmp_path / "ring", limits, START, free=room)
    assert not ring.taken
    assert ring.follows, "what happened to the robot meanwhile is in no file yet"
    ring.close()
    first = Ring(tmp_path / "ring", limits, START, free=room)
    assert not first.follows, "one that was stopped has left nothing to do"
    first.close()


def test_a_ring_goes_on_after_a_failure_with_what_it_had(tmp_path: Path) -> None:
    filled = Filled(tmp_path / "ring", size=1_000_000, duration=100.0)
    filled.fill(0.0, 50.0, padding=150)
    before = filled.ring.size
    filled.ring.recording.close()
    with pytest.raises(BagError):
        filled.ring.recording.flush()
    filled.ring.begin_anew(START + 51 * SECOND)
    assert before > 500_000
    assert filled.ring.size > 0.99 * before
    filled.ring.close()


def test_a_ring_that_another_has_the_lock_of_is_not_claimed(filled: Filled) -> None:
    with claimed(filled.ring.folder) as is_ours:
        assert not is_ours
    other = filled.ring.folder.parent / "other"
    with claimed(other) as is_ours, claimed(other) as again:
        assert (is_ours, again) == (True, False)


def test_an_unreadable_folder_leaves_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Path) -> None:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patched:
        patched.setattr("robo.recording.flight.ring.taken_over", fail)
        with pytest.raises(BagError, match="Permission denied"):
            Ring(tmp_path / "ring", Limits(duration=1.0, size=1000), START)
    Ring(tmp_path / "ring", Limits(duration=1.0, size=1000), START, free=room).close()


def test_where_rings_may_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    first, lasting = default_bases()
    assert first == tmp_path / "robo-flight"
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "gone"))
    assert default_bases() == [lasting]


def test_a_damaged_file_costs_no_more_than_what_is_in_it(tmp_path: Path) -> None:
    path = tmp_path / "whole.mcap"
    bags.drive(path)
    data = bytearray(path.read_bytes())
    data[data.index(b"zstd") + 20 if b"zstd" in data else 400] ^= 0xFF
    path.write_bytes(data)
    excerpt([[path]], tmp_path / "out.mcap", 0, 2**63, lambda writer: writer.add_attachment(1, 1, "a", "b", b"c"))
    with bag.open(tmp_path / "out.mcap") as found:
        assert found.attachment("a") == b"c"


def test_a_robot_has_one_recorder(filled: Filled) -> None:
    with pytest.raises(FlightRecorderError, match="another flight recorder of this robot runs already"):
        Ring(filled.ring.folder, Limits(duration=1.0, size=1000), START)


@pytest.mark.timeout(60)
def test_rings_of_runs_that_are_over_are_found(tmp_path: Path) -> None:
    for run in ("dead", "alive", "own"):
        killed(ring_folder(tmp_path, "fleet/r1", run))
    lives = {"alive": True}.get

    def supervised(run: str) -> bool:
        return bool(lives(run))

    assert rings_without_owner(tmp_path, "fleet/r1", "own", supervised) == [tmp_path / "fleet.r1" / "dead"]
    assert rings_without_owner(tmp_path, "r2", "own", supervised) == []


def test_a_full_disk_costs_the_oldest_and_nothing_else(tmp_path: Path) -> None:
    free = [10**12]
    ring = Ring(tmp_path / "ring", Limits(duration=100.0, size=10_000_000), START, free=lambda _: free[0])
    number = ring.recording.topic(topic_of("r1/cmd_vel", Twist))
    for second in range(100):
        at = START + second * SECOND
        ring.recording.write(number, bags.twist(second), at, at, second + 1, "x")
    before = len(ring.recording.files)
    free[0] = 0
    with pytest.raises(BagError, match="the recording has ended"):
        ring.recording.flush()
    assert before > 5
    free[0] = 10**12
    ring.begin_anew(START + 101 * SECOND)
    number = ring.recording.topic(topic_of("r1/cmd_vel", Twist))
    ring.recording.write(number, bags.twist(1), START + 102 * SECOND, START + 102 * SECOND, 1, "x")
    _, recordings = ring.hold(START + 103 * SECOND)
    assert sum(map(len, recordings)) >= 1
    ring.close()


def test_where_nothing_can_be_written_it_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(BagError, match="it cannot be made"):
        Ring(tmp_path / "file" / "ring", Limits(duration=1.0, size=1000), START)
