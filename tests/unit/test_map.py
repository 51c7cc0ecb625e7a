"""`robo map`: the way of a robot and what its lasers hit, of recordings and logs."""

import math
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robo import bag
from robo.bag.forms.from_carmen import Setting, from_carmen
from robo.bag.progress import silent
from robo.bag.types import topic_of
from robo.errors import BagError, UsageError
from robo.interfaces import cdr
from robo.recording.map import cells
from robo.recording.map.cells import Cells
from robo.recording.map.picture import as_png, as_svg, facts
from robo.recording.map.sources import Wanted, walk_of
from robo.recording.map.walk import Frames, Walk
from robo.wire.qos import QoS
from robo_messages import Header, LaserScan, Message, Odometry, TFMessage, Time, Transform, TransformStamped, Vector3
from tests import bags
from tests.bags import MS, START
from tests.room_log import LOG


def walk(path: Path, wanted: Wanted | None = None) -> Walk:
    return walk_of(str(path), wanted if wanted is not None else Wanted(), silent)


def test_a_log_and_its_recording_give_the_same_way(tmp_path: Path) -> None:
    from_carmen(LOG, tmp_path / "room.mcap", Setting(namespace="r1"), "none")
    log, recorded = walk(LOG), walk(tmp_path / "room.mcap")
    assert (log.scans, log.left_out, log.cells.hits) == (160, 0, 28_960)
    assert (recorded.scans, recorded.left_out, recorded.cells.hits) == (160, 0, 28_960)
    assert recorded.length == pytest.approx(log.length) == pytest.approx(15.8, abs=0.1)  # a circle of 2.5 m
    first, second = log.cells.grid(log.track), recorded.cells.grid(recorded.track)
    assert first.counts.keys() == second.counts.keys()


def test_the_walls_of_the_room_are_where_they_are() -> None:
    found = walk(LOG)
    grid = found.cells.grid(found.track)
    assert grid.width * grid.resolution == pytest.approx(11.1, abs=0.2)  # 10 m between the walls, and a margin
    assert found.frames == Frames("odom", "base_link")


def test_pictures_are_small_and_whole() -> None:
    found = walk(LOG)
    svg = as_svg(found, "<room> & more", "auto")
    root = ElementTree.fromstring(svg)
    words = [element.text for element in root.iter() if element.tag.endswith("text")]
    assert words[0] == "<room> & more"
    assert {"2 m", "start", "end", facts(found)} <= {*words}
    assert len(svg) < 100_000
    assert "http" not in svg.replace("http://www.w3.org/2000/svg", "")
    for theme in ("light", "dark"):
        assert 1_000 < len(as_png(found, "dark" if theme == "dark" else "light")) < 50_000


def test_odometry_serves_where_there_are_no_transforms(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    with bag.open(tmp_path / "drive.mcap") as recording:
        assert "r1/tf" not in recording.topics
    found = walk(tmp_path / "drive.mcap")
    assert found.length == pytest.approx(0.9)
    assert found.scans == 10


def test_scans_wait_for_the_transforms_of_their_time(tmp_path: Path) -> None:
    """A scan often comes before the odometry after it, and between two transforms it is moved."""
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        static = recording.topic(topic_of("tf_static", TFMessage, QoS.LATCHED))
        moving = recording.topic(topic_of("tf", TFMessage))
        scans = recording.topic(topic_of("scan", LaserScan))

        def say(topic: int, message: TFMessage | LaserScan, at: int) -> None:
            recording.write(topic, cdr.encoder(type(message))(message), at, at, 0, "node")

        def stands(parent: str, child: str, x: float, at: int) -> TFMessage:
            header = Header(Time.from_nanoseconds(at), parent)
            return TFMessage([TransformStamped(header, child, Transform(Vector3(x=x)))])

        scan = LaserScan(Header(Time.from_nanoseconds(START + 50 * MS), "laser"), ranges=[1.0], range_max=9.0)
        say(scans, scan, START + 50 * MS)
        say(static, stands("base_link", "laser", 0.5, 0), START + 60 * MS)
        say(moving, stands("odom", "base_link", 0.0, START), START + 61 * MS)
        say(moving, stands("map", "odom", 10.0, START), START + 61 * MS)
        say(moving, stands("odom", "base_link", 1.0, START + 100 * MS), START + 101 * MS)
        say(moving, stands("map", "odom", 10.0, START + 100 * MS), START + 102 * MS)
        say(scans, scan.__class__(Header(Time(1), "laser"), ranges=[1.0], range_max=9.0), START + 103 * MS)
    found = walk(path)
    assert found.frames == Frames("map", "base_link")
    assert (found.scans, found.left_out) == (1, 1)
    grid = found.cells.grid([])
    ((column, _),) = grid.counts
    assert grid.left + column * grid.resolution == pytest.approx(12.0)  # 10 + 0.5 + 0.5 + 1
    assert walk(path, Wanted(frame="odom")).track[-1] == pytest.approx((1.0, 0.0))
    with pytest.raises(UsageError, match="no such frame; did you mean odom"):
        walk(path, Wanted(frame="odum"))


def test_what_makes_no_sense_is_told(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    with pytest.raises(UsageError, match="no robot r2"):
        walk(tmp_path / "drive.mcap", Wanted(robot="r2"))
    with pytest.raises(UsageError, match="--corrected is for logs of CARMEN"):
        walk(tmp_path / "drive.mcap", Wanted(corrected=True))
    with pytest.raises(UsageError, match="does not name it"):
        walk(LOG, Wanted(robot="r1"))
    with pytest.raises(BagError, match="No such file"):
        walk(tmp_path / "none.mcap")
    bag.keep(tmp_path / "drive.mcap", tmp_path / "commands.mcap", lambda name: name.endswith("cmd_vel"))
    with pytest.raises(UsageError, match="neither transforms nor odometry"):
        walk(tmp_path / "commands.mcap")


def test_the_poses_that_a_mapping_tool_has_written_count_where_they_are_wanted(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    log.write_text("ODOM 0 0 0 0 0 0 1 h 1\nFLASER 1 2.0 5 6 1.5707963 5 6 1.5707963 1 h 1\nODOM 1 0 0 0 0 0 2 h 2\n")
    found = walk(log, Wanted(corrected=True))
    assert found.track == [(5.0, 6.0)]
    assert "by the corrected poses of the log" in facts(found)
    assert walk(log).track == [(0.0, 0.0), (1.0, 0.0)]


def test_the_base_is_not_where_its_laser_is(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    log.write_text("PARAM robot_frontlaser_offset 0.5\nFLASER 1 2.0 5 6 1.5707963 5 6 1.5707963 1 h 1\n")
    (place,) = walk(log, Wanted(corrected=True)).track
    assert place == pytest.approx((5.0, 5.5))


def test_what_of_a_log_makes_no_sense_is_told(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    lines = ["ODOM 0 0 0 0 0 0 1 h 1", "ODOM 1e300 0 0 0 0 0 2 h 2", "ODOM no", "ODOM 1 0 0 0 0 0 3 h 3"]
    log.write_text("\n".join(lines) + "\n")
    found = walk(log)
    assert found.track == [(0.0, 0.0), (1.0, 0.0)]  # nobody drives 1e300 m
    assert found.malformed == 1
    (told,) = found.notes
    assert told.startswith("what makes no sense is left out: line 3;")


Said = tuple[str, Message, int]


def written(path: Path, *said: Said) -> Path:
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        topics: dict[str, int] = {}
        for name, message, at in said:
            if name not in topics:
                qos = QoS.LATCHED if name.endswith("static") else QoS.DEFAULT
                topics[name] = recording.topic(topic_of(name, type(message), qos))
            recording.write(topics[name], cdr.encoder(type(message))(message), at, at, 0, "node")
    return path


def odometry(name: str, x: float, at: int) -> Said:
    found = Odometry(Header(Time.from_nanoseconds(at), "odom"), "base_link")
    found.pose.pose.position.x = x
    return name, found, at


def stands(name: str, parent: str, child: str, at: int) -> Said:
    return name, TFMessage([TransformStamped(Header(Time.from_nanoseconds(at), parent), child)]), at


def test_wheels_that_turn_do_not_hide_the_odometry(tmp_path: Path) -> None:
    said = [stands("r1/tf_static", "base_link", "laser", START)]
    for step in range(20):
        at = START + step * 100 * MS
        said += [stands("r1/tf", "base_link", "wheel", at), odometry("r1/odom", step * 0.1, at)]
        said.append(("r1/scan", LaserScan(Header(Time.from_nanoseconds(at), "laser"), ranges=[1.0], range_max=9.0), at))
    found = walk(written(tmp_path / "joints.mcap", *said))
    assert found.length == pytest.approx(1.9)
    assert found.frames == Frames("odom", "base_link", "by the odometry r1/odom")
    assert found.scans == 20
    assert found.cells.grid([]).width == pytest.approx(59, abs=2)  # 1.9 m, and a margin


def test_one_odometry_of_several_is_the_way(tmp_path: Path) -> None:
    said = []
    for step in range(20):
        at = START + step * 100 * MS
        said += [odometry("r1/filtered", step * 0.1 + 0.5, at), odometry("r1/odom", step * 0.1, at + 1)]
    found = walk(written(tmp_path / "two.mcap", *said))
    assert found.length == pytest.approx(1.9)
    assert facts(found) == "1.9 m driven, by the odometry r1/odom"


def test_one_message_that_cannot_be_read_is_no_reason_to_draw_nothing(tmp_path: Path) -> None:
    path = written(tmp_path / "bad.mcap", *(odometry("r1/odom", step * 0.1, START + step * MS) for step in range(5)))
    with bag.Recording(tmp_path / "worse.mcap", bag.Options(compression="none", sync=False)) as recording:
        topic = recording.topic(topic_of("r1/odom", Odometry, QoS.DEFAULT))
        with bag.open(path) as good:
            for number, message in enumerate(good.messages()):
                data = b"\0\1\0\0\xff" if number in (0, 2) else message.data
                recording.write(topic, data, message.arrived, message.arrived, 0, "node")
    found = walk(tmp_path / "worse.mcap")
    assert found.length == pytest.approx(0.3)
    assert found.malformed == 2
    assert found.notes[0].startswith("2 messages could not be read; the first: ")


def test_a_start_where_the_end_is_is_seen(tmp_path: Path) -> None:
    found = walk(written(tmp_path / "still.mcap", odometry("r1/odom", 0.0, START)))
    circles = [one for one in ElementTree.fromstring(as_svg(found, "t", "auto")).iter() if one.tag.endswith("circle")]
    assert [(one.get("class"), one.get("r")) for one in circles[:2]] == [("begin", "8"), ("finish", "5")]


@given(st.lists(st.tuples(st.floats(), st.floats()), max_size=60))
def test_cells_take_whatever_comes(points: list[tuple[float, float]]) -> None:
    found = Cells()
    found.add(points)
    grid = found.grid([(0.0, 0.0), *((x, y) for x, y in points if math.isfinite(x) and math.isfinite(y))])
    assert max(grid.width, grid.height) <= 1_100
    assert all(0 <= x < grid.width and 0 <= y < grid.height for x, y in grid.counts)


def test_many_cells_get_coarser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cells, "_MOST_CELLS", 1_000)
    found = Cells()
    for row in range(100):
        found.add((column * 0.05, row * 0.05) for column in range(100))
    grid = found.grid([])
    assert len(grid.counts) <= 1_000
    assert sum(grid.counts.values()) == found.hits == 10_000
    assert grid.resolution == pytest.approx(0.2)


def test_the_log_of_a_real_building(intel_log: Path) -> None:
    found = walk(intel_log, Wanted(corrected=True))
    assert found.scans == 910
    assert len(as_svg(found, "intel", "auto")) < 200_000
