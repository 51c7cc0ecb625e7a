"""Recordings in parts: which files are one, parts that are missing or empty, what latched topics say again."""

import os
from pathlib import Path

import pytest

from robo import bag
from robo.bag.forms.choice import form_of_input
from robo.bag.types import topic_of
from robo.errors import BagError
from robo.wire.qos import QoS
from robo_messages import Twist
from tests import bags
from tests.bags import MS, START

PLAIN = bag.Options(compression="none", sync=False, split_by_hand=True)
MAP = topic_of("map", Twist, QoS.LATCHED)


def in_parts(folder: Path, parts: int = 4) -> Path:
    """A map that the second part says, and each later one again; a command in each."""
    with bag.Recording(folder, PLAIN) as recording:
        number, commands = recording.topic(MAP), recording.topic(topic_of("cmd_vel", Twist))
        for part in range(parts):
            at = START + part * 1_000 * MS
            if part:
                recording.split(at)
            if part == 1:
                recording.write(number, bags.twist(9), at, at, 1, "mapper")
            recording.write(commands, bags.twist(part), at + MS, at, part + 1, "commander")
    return folder


def maps(folder: Path) -> tuple[int, int, int]:
    with bag.open(folder) as opened:
        return len(list(opened.messages("map"))), len(opened.latched(opened.end + 1)), opened.topic("map").count


@pytest.mark.parametrize("how", ["deleted", "empty", "cut"])
def test_what_is_latched_is_there_though_the_part_that_said_it_is_not(how: str, tmp_path: Path) -> None:
    folder = in_parts(tmp_path / "run")
    assert maps(folder) == (1, 1, 1)
    part = folder / "run_1.mcap"
    if how == "deleted":
        part.unlink()
    else:
        part.write_bytes(part.read_bytes()[: 0 if how == "empty" else 500])
    assert maps(folder) == (1, 1, 1)
    report = bag.check(folder)
    assert not report.whole
    assert (how == "deleted") == ("run_1.mcap is missing" in [found.text for found in report.findings])


@pytest.mark.parametrize("number", [0, 3])
def test_a_first_or_last_part_that_is_missing_is_named_where_ros_knows_of_it(number: int, tmp_path: Path) -> None:
    folder = in_parts(tmp_path / "run")
    (folder / f"run_{number}.mcap").unlink()
    (finding,) = bag.check(folder).findings
    assert (finding.kind, finding.text) == (bag.Kind.MISSING, f"run_{number}.mcap is missing")


def test_parts_that_a_recorder_has_let_go_are_not_missed(tmp_path: Path) -> None:
    options = bag.Options(compression="none", sync=False, split_by_hand=True, keep=2)
    with bag.Recording(tmp_path / "run", options) as recording:
        number = recording.topic(MAP)
        for part in range(5):
            recording.write(number, bags.twist(part), START + part, START, part + 1, "a")
            recording.split(START + part)
    assert bag.check(tmp_path / "run").findings == []


def test_an_odd_entry_closes_no_folder(tmp_path: Path) -> None:
    folder = in_parts(tmp_path / "run")
    (folder / "._run_0.mcap").write_bytes(b"of macOS")
    (folder / "run_7.mcap").symlink_to("nowhere")
    (folder / "run_8.mcap").mkdir()
    os.mkfifo(folder / "run_9.mcap")
    with bag.open(folder) as opened:
        assert opened.count == 5
        assert [fault.reason for fault in opened.faults] == [
            "No such file or directory", "it is a folder, not a file", "it is a pipe, not a file",
        ]  # fmt: skip


def test_recordings_that_are_not_parts_of_one_are_not_read_as_one(tmp_path: Path) -> None:
    bags.drive(tmp_path / "run_0.mcap", count=2)
    bags.drive(tmp_path / "other.mcap", count=2)
    with pytest.raises(BagError, match=r"has several recordings, name one of them: other\.mcap, run_0\.mcap"):
        bag.open(tmp_path)
    (tmp_path / "run_0.mcap").unlink()
    with bag.open(tmp_path) as opened:
        assert opened.count > 0


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("run_0.db3", "run_0.db3 is a database of SQLite.*`rosbags-convert`"),
        ("run.bag", "run.bag is a recording of ROS 1: `rosbags-convert`"),
        ("run_0.mcap.zstd", "run_0.mcap.zstd is compressed as a whole: `unzstd`"),
    ],
)
def test_a_folder_of_another_form_says_what_to_do(name: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(BagError, match=reason):
        bag.open(tmp_path)


def test_a_file_of_another_form_says_what_to_do_when_it_is_to_be_converted(tmp_path: Path) -> None:
    path = tmp_path / "run_0.db3"
    path.write_bytes(b"SQLite format 3\0")
    with pytest.raises(BagError, match="it is a database of SQLite"):
        form_of_input(str(path))


def test_a_last_part_that_a_power_cut_left_empty_stops_nobody(tmp_path: Path) -> None:
    folder = in_parts(tmp_path / "run")
    (folder / "run_4.mcap").write_bytes(b"")
    assert bag.merge([folder, folder], tmp_path / "both.mcap", "none").messages == 10
    (folder / "run_3.mcap").write_bytes((folder / "run_3.mcap").read_bytes()[:-300])
    with pytest.raises(BagError, match=r"run_3\.mcap.*robo bag recover"):
        bag.cut(folder, tmp_path / "part.mcap", START, compression="none")
    recovered = bag.recover(folder, tmp_path / "whole")
    assert (recovered.messages, len(recovered.faults)) == (5 + 2, 2), "with what parts say again"
    assert recovered.size - recovered.read > 0
    assert sorted(path.name for path in (tmp_path / "whole").iterdir()) == [f"run_{n}.mcap" for n in range(4)]
    assert bag.check(tmp_path / "whole").findings == []
    with pytest.raises(BagError, match="it is there already"):
        bag.recover(folder, tmp_path / "whole")
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "a.mcap").write_bytes(b"")
    with pytest.raises(BagError, match="it is empty"):
        bag.recover(tmp_path / "none", tmp_path / "nothing")
    assert not (tmp_path / "nothing").exists()
