"""Logs of CARMEN as recordings; tests/integration/test_bag_carmen.py has the node beside them that plays logs."""

import gzip
from pathlib import Path

import pytest

from robo import bag
from robo.bag.forms.from_carmen import Setting, from_carmen
from robo.errors import BagError
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import LaserScan, Odometry, TFMessage

ODOM = "ODOM {x} 0 0.5 0.3 0.1 0 {time} host 10.5"
FLASER = "FLASER 3 1.0 2.5 81.83 9 9 9 8 8 8 {time} host 12.25"
OFFSET = "PARAM robot_frontlaser_offset 0.25 nohost 0"


def rows(path: Path) -> list[tuple[str, str, int, int, int]]:
    with bag.open(path) as opened:
        return [(one.topic.name, one.topic.schema, one.arrived, one.published, one.sequence)
                for one in opened.messages()]  # fmt: skip


def carmen(folder: Path, *lines: str, packed: bool = False) -> Path:
    text = "".join(f"{line}\n" for line in lines).encode()
    path = folder / ("run.log.gz" if packed else "run.log")
    path.write_bytes(gzip.compress(text) if packed else text)
    return path


@pytest.mark.parametrize("packed", [False, True])
def test_a_log_becomes_what_its_player_says(packed: bool, tmp_path: Path) -> None:
    lines = (OFFSET, ODOM.format(x=1, time=20.5), FLASER.format(time=20.25), "ODOM 1 2", ODOM.format(x=2, time=21))
    done = from_carmen(carmen(tmp_path, *lines, packed=packed), tmp_path / "a.mcap", Setting(namespace="r1"), "none")
    assert done.notes == ["what makes no sense is left out: line 4; the first: ODOM takes 9 values, this line has 2"]
    first, last = 20_500_000_000, 21_000_000_000
    assert rows(tmp_path / "a.mcap") == [
        ("r1/tf_static", "tf2_msgs/msg/TFMessage", first, first, 1),
        ("r1/tf", "tf2_msgs/msg/TFMessage", first, first, 1),
        ("r1/odom", "nav_msgs/msg/Odometry", first, first, 1),
        ("r1/scan", "sensor_msgs/msg/LaserScan", first, 20_250_000_000, 1),
        ("r1/tf", "tf2_msgs/msg/TFMessage", last, last, 2),
        ("r1/odom", "nav_msgs/msg/Odometry", last, last, 2),
    ]
    with bag.open(tmp_path / "a.mcap") as opened:
        static, moved, odometry, scan, *_ = (message.value for message in opened.messages())
        assert opened.topic("r1/tf_static").qos == QoS.LATCHED
        assert opened.topic("r1/odom").qos.depth == KEEP_ALL
    assert isinstance(static, TFMessage)
    assert isinstance(moved, TFMessage)
    assert isinstance(odometry, Odometry)
    assert isinstance(scan, LaserScan)
    laser = static.transforms[0]
    assert (laser.header.frame_id, laser.child_frame_id) == ("base_link", "base_laser")
    assert laser.transform.translation.x == 0.25
    base = moved.transforms[0]
    assert (base.header, base.child_frame_id) == (odometry.header, "base_link")
    assert base.transform.translation.x == odometry.pose.pose.position.x == 1.0
    assert base.transform.rotation == odometry.pose.pose.orientation
    assert (scan.header.frame_id, scan.range_max) == ("base_laser", 80.0)


def test_a_range_that_no_recording_can_hold_is_left_out(tmp_path: Path) -> None:
    log = carmen(tmp_path, FLASER.format(time=1).replace("2.5", "2e46"), FLASER.format(time=2))
    done = from_carmen(log, tmp_path / "a.mcap", None, "none")
    assert done.notes == ["what makes no sense is left out: line 1; the first: "
                          "sensor/LaserScan.ranges[1]: float 2e+46 is beyond float32"]  # fmt: skip
    assert [row[0] for row in rows(tmp_path / "a.mcap")] == ["tf_static", "scan"]


def test_some_topics_of_a_log(tmp_path: Path) -> None:
    log = carmen(tmp_path, ODOM.format(x=1, time=1), FLASER.format(time=2))
    done = from_carmen(log, tmp_path / "a.mcap", None, "none", wanted="scan".__eq__)
    assert (done.topics, done.messages) == (1, 1)
    with pytest.raises(BagError, match=r"run\.log: it holds no message"):
        from_carmen(log, tmp_path / "b.mcap", None, "none", wanted="map".__eq__)
    with pytest.raises(BagError, match=r"empty\.log: it holds no message"):
        from_carmen(carmen(tmp_path).rename(tmp_path / "empty.log"), tmp_path / "b.mcap", None, "none")
    assert not (tmp_path / "b.mcap").exists()


def test_the_log_of_a_real_robot(intel_log: Path, tmp_path: Path) -> None:
    done = from_carmen(intel_log, tmp_path / "intel.mcap", None, "none")
    assert (done.topics, done.messages) == (4, 2 * 13_700 + 910 + 1)
    assert done.notes[0].startswith("odometry of time 0, which a mapping tool wrote, is left out: lines 176, ")
    assert done.notes[0].endswith(" and 821 more")
