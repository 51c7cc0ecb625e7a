import gzip
import math
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo.bag.forms import carmen
from robo.bag.forms.carmen import LaserOffset, LogError, MalformedLog, Motion, Record, Rewritten, Scan
from robo_services.carmen_player import MOST_NAMED, first_lines, line_ranges
from robo_services.planar import yaw_from_quaternion
from tests import room_log

ODOM = "ODOM 1.5 -2 0.5 0.3 0.1 0 976052857.350191 host 10.5"
FLASER = "FLASER 3 1.0 2.5 81.83 9 9 9 8 8 8 12.25 host 12.25"


def read(*lines: str) -> list[Record]:
    return list(carmen.records([line.encode() for line in lines]))


def test_records_are_read_as_they_stand() -> None:
    motion, scan = read(ODOM, FLASER)
    assert motion == Motion(1, 976052857_350191000, 1.5, -2.0, 0.5, 0.3, 0.1)
    assert scan == Scan(2, 12_250_000_000, [1.0, 2.5, 81.83], (9.0, 9.0, 9.0))


def test_other_lines_are_passed_over_but_counted() -> None:
    records = read("# comment", "PARAM x 1 nohost 0", "", "NEFF 15", ODOM)
    assert [r.line for r in records] == [5]


def test_where_the_laser_stands_is_read() -> None:
    offset, side, turn, bad, worse, motion = read(
        "PARAM robot_frontlaser_offset 0.25 nohost 0",
        "PARAM robot_frontlaser_side_offset -0.1",
        "PARAM robot_frontlaser_angular_offset 0.5 nohost 0",
        "PARAM robot_rearlaser_offset 0.3 nohost 0",
        "PARAM",
        "PARAM robot_frontlaser_offset",
        "PARAM robot_frontlaser_offset nan nohost 0",
        "ODOM 1 2 0 0 0 0 0 host 0",
    )
    assert [offset, side, turn] == [LaserOffset(1, "x", 0.25), LaserOffset(2, "y", -0.1), LaserOffset(3, "yaw", 0.5)]
    assert bad == MalformedLog(6, "PARAM robot_frontlaser_offset has no value")
    assert worse == MalformedLog(7, "'nan' is no finite number")
    assert isinstance(motion, Rewritten), "a malformed line was there before"
    assert isinstance(read("PARAM robot_frontlaser_offset 0", "ODOM 1 2 0 0 0 0 0 host 0")[1], Motion)


def test_time_zero_is_kept_at_the_start_only() -> None:
    zero = "ODOM 1 2 0 0 0 0 0 host 0"
    assert [type(r) for r in read(zero, ODOM, zero, zero.replace(" 0 host", " 0.000 host"))] == [
        Motion, Motion, Rewritten, Rewritten,
    ]  # fmt: skip
    assert isinstance(read(ODOM, zero.replace(" 0 host", " 1e-42 host"))[1], Motion)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("ODOM 1 2 3", "takes 9 values, this line has 3"),
        ("ODOM", "takes 9 values, this line has 0"),
        (ODOM.replace("1.5", "x"), "'x' is no finite number"),
        (ODOM.replace("1.5", "nan"), "'nan' is no finite number"),
        (ODOM.replace("976052857.350191", "9e99"), "out of range"),
        (FLASER[:20], "FLASER of 3 ranges takes 13 values"),
        ("FLASER", "begins with its number of ranges"),
        ("FLASER -1 2", "begins with its number of ranges"),
        (f"FLASER {'9' * 5_000} 1", "begins with its number of ranges"),
        ("FLASER 0 1 2 3 4 5 6 7 h 8", "begins with its number of ranges"),
        (FLASER.replace("2.5", "inf"), "'inf' is no finite number"),
    ],
)
def test_a_bad_line_is_named_and_the_rest_goes_on(line: str, reason: str) -> None:
    first, bad, last = read(ODOM, line, ODOM)
    assert isinstance(bad, MalformedLog)
    assert bad.line == 2
    assert reason in bad.reason
    assert isinstance(first, Motion)
    assert isinstance(last, Motion)


@given(st.lists(st.binary(max_size=80) | st.sampled_from([ODOM.encode(), FLASER.encode(), b"ODOM 1 2"]), max_size=20))
def test_any_bytes_are_read_without_a_crash(lines: list[bytes]) -> None:
    for record in carmen.records(lines):
        assert 1 <= record.line <= len(lines)


def test_messages() -> None:
    motion, scan = read(ODOM, FLASER)
    assert isinstance(motion, Motion)
    assert isinstance(scan, Scan)
    odometry = carmen.odometry(motion, "odom", "base_link")
    assert (odometry.header.stamp.sec, odometry.header.stamp.nanosec) == (976052857, 350191000)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert (odometry.pose.pose.position.x, odometry.pose.pose.position.y) == (1.5, -2.0)
    assert yaw_from_quaternion(odometry.pose.pose.orientation) == pytest.approx(0.5)
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (0.3, 0.1)
    message = carmen.laser_scan(scan, "base_laser", 80.0)
    assert (message.angle_min, message.angle_max) == (-math.pi / 2, math.pi / 2)
    assert message.angle_min + 2 * message.angle_increment == pytest.approx(message.angle_max)
    assert message.ranges == [1.0, 2.5, 81.83]


def test_plain_and_gzip_files(tmp_path: Path) -> None:
    text = f"{ODOM}\n{FLASER}\r\n{ODOM}".encode()
    (tmp_path / "a.log").write_bytes(text)
    (tmp_path / "a.log.gz").write_bytes(gzip.compress(text))
    plain, zipped = (list(carmen.read(tmp_path / name)) for name in ("a.log", "a.log.gz"))
    assert plain == zipped
    assert len(plain) == 3


def test_a_gzip_file_that_is_cut_short_plays_up_to_the_cut(tmp_path: Path) -> None:
    lines = "".join(f"{ODOM.replace('1.5', str(i * 0.37))}\n" for i in range(5000)).encode()
    packed = gzip.compress(lines)
    path = tmp_path / "cut.log.gz"
    path.write_bytes(packed[: len(packed) // 2])
    *good, last = carmen.read(path)
    assert len(good) > 1000
    assert isinstance(last, MalformedLog)
    assert "cut short" in last.reason
    assert sum(isinstance(record, MalformedLog) for record in good) <= 1


def test_a_line_that_is_far_too_long_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "long.log.gz"
    path.write_bytes(gzip.compress(b"ODOM " + bytes(5_000_000) + b"\n" + ODOM.encode()))
    long, motion = carmen.read(path)
    assert long == MalformedLog(1, "the line has more than 1,048,576 bytes")
    assert isinstance(motion, Motion)
    assert motion.line == 2


def test_a_log_that_is_not_there() -> None:
    with pytest.raises(LogError, match=r"nope\.log cannot be opened: No such file"):
        list(carmen.read("nope.log"))


def test_the_log_that_ships_is_what_its_script_makes() -> None:
    assert room_log.LOG.stat().st_size < 100_000
    shipped = list(carmen.read(room_log.LOG))
    made = list(carmen.records(line.encode() for line in room_log.lines()))
    assert len(shipped) == len(made) == 15 * room_log.SECONDS
    for ours, theirs in zip(shipped, made, strict=True):
        if isinstance(ours, Motion) and isinstance(theirs, Motion):
            assert (ours.x, ours.y, ours.theta) == pytest.approx((theirs.x, theirs.y, theirs.theta), abs=1e-3)
        else:
            assert isinstance(ours, Scan)
            assert isinstance(theirs, Scan)
            assert ours.ranges == pytest.approx(theirs.ranges, abs=0.02)


def test_the_log_of_a_real_robot(intel_log: Path) -> None:
    records = list(carmen.read(intel_log))
    motions = [r for r in records if isinstance(r, Motion)]
    assert len(motions) == 13_700
    assert sum(isinstance(r, Rewritten) for r in records) == 841
    assert sum(isinstance(r, Scan) for r in records) == 910
    assert [r for r in records if isinstance(r, LaserOffset)] == [LaserOffset(3, "x", 0.0)]
    assert sum(isinstance(r, MalformedLog) for r in records) == 0
    driven = sum(math.hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(motions))
    assert driven == pytest.approx(534.082, abs=0.001)


@pytest.mark.parametrize(("lines", "text"), [([], ""), ([3], "3"), ([3, 7, 8, 9, 12], "3, 7-9, 12"), ([1, 2], "1-2")])
def test_line_numbers_in_short(lines: list[int], text: str) -> None:
    assert line_ranges(lines) == first_lines(lines) == text


def test_of_very_many_lines_the_first_are_named() -> None:
    assert first_lines([2 * number for number in range(10**6)]).endswith(f" {2 * MOST_NAMED - 2}, …")
