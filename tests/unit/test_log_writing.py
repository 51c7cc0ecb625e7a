"""Log files while disks are full, folders go, and room is scarce."""

import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from robo import environment
from robo.errors import UsageError
from robo.machine import log_files
from robo.machine.log_files import LogFiles, RunInfo
from robo.machine.log_space import KEPT_RUNS, KeptRun, file_limit, kept_runs, limit, make_room, run_limit, surplus
from robo.machine.log_writer import FIRST_TRY, LAST_TRY, LogWriter
from robo.tools import logs
from robo.wire.reports import LogRecord
from robo.wire.run_id import new_run_id


def info(number: int = 1, robot: str = "r1", run: str = "") -> RunInfo:
    begin = (1_700_000_000 + number) * 10**9
    return RunInfo(run=run or over(), robot=robot, manifest="m.yaml", begin=begin, pid=number, nodes=[f"/{robot}/a"])


def over() -> str:
    """The id of a run that is over."""
    random, pid, _, namespace = new_run_id().split("-")
    return f"{random}-{pid}-0-{namespace}"


def line(number: int) -> LogRecord:
    return LogRecord(time=number, node="a", message=f"line {number}")


class Full(LogFiles):
    """Files on a disk that may be full."""

    full = False

    def write(self, line: LogRecord) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        super().write(line)


class Desk:
    """A writer with a clock of its own."""

    def __init__(self, base: Path) -> None:
        self.now = 1000.0
        self.told: list[str] = []
        self.base = base
        self.files = Full(info(), base)
        self.writer = LogWriter(self.files, lambda record: self.told.append(record.message), lambda: self.now)

    def later(self, seconds: float) -> None:
        """Let time pass; the writer looks four times a second."""
        for _ in range(int(seconds * 4)):
            self.now += 0.25
            self.writer.look()

    def write(self, *numbers: int) -> None:
        for number in numbers:
            self.writer.write(line(number))

    def messages(self) -> list[str]:
        """What stands in the files."""
        (run,) = logs.list_runs(base=self.base)
        return [record.message for record in logs.read(run, set())]


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(tmp_path / "log")
    made.writer.begin()
    yield made
    made.files.close()


def test_a_full_disk_costs_lines_and_no_more(desk: Desk) -> None:
    desk.write(1)
    desk.files.full = True
    desk.write(2, 3, 4)
    assert desk.told == ["no log files are written: No space left on device; it is tried again"]
    assert "3 lines are missing so far: No space left on device" in desk.writer.problem
    desk.later(60)
    assert len(desk.told) == 1
    desk.files.full = False
    desk.later(LAST_TRY + 1)
    assert desk.told[1].startswith("log files are written again; 3 lines are missing since ")
    assert desk.writer.problem == ""
    desk.write(5)
    desk.writer.close()
    assert sorted(desk.messages()) == ["line 1", "line 5", desk.told[1]]


def test_a_full_disk_is_tried_again_at_growing_intervals(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    desk.files.full = True
    desk.write(1)
    tries: list[float] = []
    monkeypatch.setattr(desk.files, "begin", lambda: tries.append(desk.now))
    desk.later(60)
    gaps = [b - a for a, b in zip([1000.0, *tries], tries, strict=False)]
    assert gaps[0] == pytest.approx(FIRST_TRY)
    assert gaps == sorted(gaps)
    assert gaps[-1] == pytest.approx(LAST_TRY)


def test_only_their_user_reads_them(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        (tmp_path / "r1").mkdir(mode=0o755)  # as it was made once
        files = LogFiles(info(), tmp_path / "new" / "log")
        files.begin()
        files.write(line(1))
        files.close()
        LogFiles(info(), tmp_path).begin()
    finally:
        os.umask(before)
    made = [files.folder, files.folder.parent, tmp_path / "new" / "log", tmp_path / "r1"]
    assert [oct(one.stat().st_mode & 0o777) for one in made] == ["0o700"] * 4
    assert {oct(one.stat().st_mode & 0o777) for one in files.folder.iterdir()} == {"0o600"}


def test_a_folder_that_is_removed_is_made_again(desk: Desk) -> None:
    desk.write(1)
    desk.later(2)
    shutil.rmtree(desk.base)
    desk.write(2, 3)
    desk.later(2)
    assert len(desk.told) == 1
    assert "log files are written again; 2 lines are missing" in desk.told[0]
    assert "the files or their folder were removed" in desk.told[0]
    desk.write(4)
    assert sorted(desk.messages()) == ["line 4", desk.told[0]]


def test_what_stands_in_the_way_of_the_folder(desk: Desk) -> None:
    desk.write(1)
    shutil.rmtree(desk.base)
    desk.base.write_text("in the way")
    desk.write(2)
    desk.later(2)
    assert "no log files are written: " in desk.told[0]
    assert "2 lines are missing so far" in desk.writer.problem
    desk.base.unlink()
    desk.later(LAST_TRY)
    assert len(desk.told) == 2
    desk.write(3)
    assert sorted(desk.messages()) == ["line 3", desk.told[1]]


def test_a_file_that_something_stands_in_the_way_of_is_an_outage_all_the_time(desk: Desk) -> None:
    desk.writer.begin()
    (desk.files.folder / "a.jsonl").mkdir()
    desk.writer.write(line(1))
    for number in range(2, 30):
        desk.later(1.0)
        assert "Is a directory" in desk.writer.problem, f"after {number} s, while others' files could be written"
        desk.writer.write(line(number))
    assert len(desk.told) == 1
    (desk.files.folder / "a.jsonl").rmdir()
    desk.later(LAST_TRY + 1.0)
    assert (desk.writer.problem, len(desk.told)) == ("", 2)
    assert "29 lines are missing" in desk.told[1]


def test_a_disk_that_was_full_is_tried_again_when_it_has_room(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    desk.files.full = True
    desk.write(1)
    desk.files.full = False
    monkeypatch.setattr(desk.files, "room", lambda: 4096)
    desk.later(30)
    assert desk.writer.problem
    monkeypatch.undo()
    desk.later(LAST_TRY)
    assert desk.writer.problem == ""


def test_a_run_that_ends_during_an_outage_notes_it_where_it_can(desk: Desk) -> None:
    desk.write(1)
    desk.files.full = True
    desk.write(2)
    desk.files.full = False
    desk.writer.close()
    assert any("1 line is missing since" in message for message in desk.messages())


def test_before_the_files_are_begun_lines_wait_for_them(tmp_path: Path) -> None:
    desk = Desk(tmp_path / "log")
    desk.write(1)
    assert logs.list_runs(base=desk.base) == []
    desk.writer.begin()
    desk.writer.close()
    assert desk.messages() == ["line 1"]


def test_a_line_of_which_the_disk_takes_a_part_is_taken_back(tmp_path: Path) -> None:
    files = LogFiles(info(), tmp_path)
    files.begin()
    files.write(line(1))
    file = files._files["a"]._file

    class Small:
        def write(self, data: bytes) -> int:
            if len(data) < 20:
                raise OSError(errno.ENOSPC, "full")
            return file.write(bytes(data[:-10]))

        def fileno(self) -> int:
            return file.fileno()

    files._files["a"]._file = Small()  # type: ignore[assignment]
    with pytest.raises(OSError, match="full"):
        files.write(line(2))
    files._files["a"]._file = file
    files.write(line(3))
    files.close()
    (run,) = logs.list_runs(base=tmp_path)
    assert [record.message for record in logs.read(run, set())] == ["line 1", "line 3"]


# -- room ------------------------------------------------------------------------------------------


def test_old_runs_of_a_robot_go(tmp_path: Path) -> None:
    for number in range(KEPT_RUNS + 3):
        LogFiles(info(number), tmp_path).begin()
    LogFiles(info(0, robot="r2"), tmp_path).begin()
    make_room(tmp_path, 10**9)
    kept = [run.info.pid for run in logs.list_runs("r1", tmp_path)]
    assert kept == list(range(3, KEPT_RUNS + 3))
    assert len(logs.list_runs("r2", tmp_path)) == 1
    assert logs.find_run(None, None, tmp_path).info.pid == kept[-1]
    assert logs.find_run("r1", logs.list_runs("r1", tmp_path)[2].info.run, tmp_path).info.pid == 5


def test_all_runs_together_take_no_more_than_is_granted() -> None:
    def run(number: int, size: int, *, lives: bool = False) -> KeptRun:
        return KeptRun(Path(str(number)), info(number, robot=f"r{number}"), size, lives)

    runs = [run(1, 40, lives=True), run(2, 30), run(3, 10), run(4, 30), run(5, 10)]
    assert [one.folder.name for one in surplus(runs, 120)] == []
    assert [one.folder.name for one in surplus(runs, 100)] == ["2"]
    assert [one.folder.name for one in surplus(runs, 10)] == ["5", "4", "3", "2"]


def test_what_runs_keeps_its_files_but_for_those_that_were_set_aside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_files, "LARGEST", 600)
    old, own = LogFiles(info(1), tmp_path), LogFiles(info(2, run=new_run_id()), tmp_path)
    for files in (old, own):
        files.begin()
        for number in range(30):
            files.write(line(number))
    assert own.set_aside > 1
    assert [run.lives for run in sorted(kept_runs(tmp_path), key=lambda run: run.info.begin)] == [False, True]
    make_room(tmp_path, 1_500, own.folder)
    assert not old.folder.exists()
    left = sum(file.stat().st_size for file in own.folder.iterdir())
    assert 600 < left <= 1_500
    assert (own.folder / "a.jsonl").exists()
    own.write(line(31))
    old.close()
    own.close()


def test_that_the_oldest_lines_go_is_told_once(tmp_path: Path) -> None:
    told: list[str] = []
    clock = [0.0]
    files = LogFiles(info(), tmp_path, largest=600)
    writer = LogWriter(files, lambda record: told.append(record.message), lambda: clock[0])
    writer.begin()
    for number in range(200):
        writer.write(line(number))
        clock[0] += 1.0
        writer.look()
    assert told == [
        "the log of a is full: its oldest lines go from now on, the newest 0.0018 MB are kept (ROBO_LOG_RUN_LIMIT)"
    ]
    assert sum(file.stat().st_size for file in files.folder.glob("*.jsonl*")) <= 1800
    writer.close()


def test_all_files_of_a_run_take_no_more_than_it_may() -> None:
    assert file_limit(300_000_000, 10) == 10_000_000
    assert file_limit(300_000_000, 5) == 10_000_000
    assert file_limit(300_000_000, 100) == 1_000_000
    assert file_limit(1_000_000, 100) == 50_000


def test_a_run_may_take_what_is_said_and_not_more_than_all_may(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(environment.LOG_RUN_LIMIT_VARIABLE, raising=False)
    assert run_limit(1_000_000_000) == 300_000_000
    assert run_limit(200_000_000) == 200_000_000
    monkeypatch.setenv(environment.LOG_RUN_LIMIT_VARIABLE, "50")
    assert run_limit(1_000_000_000) == 50_000_000
    monkeypatch.setenv(environment.LOG_RUN_LIMIT_VARIABLE, "much")
    with pytest.raises(UsageError, match="ROBO_LOG_RUN_LIMIT='much': say how many megabytes the log files of one run"):
        run_limit(1)


def test_on_a_small_disk_logs_take_a_tenth_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(environment.LOG_LIMIT_VARIABLE, raising=False)
    disk = os.statvfs(tmp_path)
    size = disk.f_blocks * disk.f_frsize
    assert limit(tmp_path / "not" / "there") == min(1_000_000_000, size // 10)


def test_the_limit_is_a_number_of_megabytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(environment.LOG_LIMIT_VARIABLE, raising=False)
    assert limit() == 1_000_000_000
    monkeypatch.setenv(environment.LOG_LIMIT_VARIABLE, "50")
    assert limit() == 50_000_000
    for nonsense in ("1G", "-1", "0", "³"):
        monkeypatch.setenv(environment.LOG_LIMIT_VARIABLE, nonsense)
        with pytest.raises(UsageError, match="say how many megabytes"):
            limit()


def test_logs_are_those_of_the_run_that_goes_on(tmp_path: Path) -> None:
    LogFiles(info(1, run=new_run_id()), tmp_path).begin()
    LogFiles(info(2), tmp_path).begin()
    assert logs.find_run(None, None, tmp_path).info.pid == 1
    assert logs.find_run("r1", None, tmp_path).info.pid == 1
