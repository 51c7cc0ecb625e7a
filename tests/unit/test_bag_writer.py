"""Writing recordings: what is in the file when, splits, latched topics, counts, and disks that fill."""

import errno
import os
import tempfile
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from robo import bag
from robo.bag.types import topic_of
from robo.bag.write.part import Part
from robo.errors import BagError, DiskFull
from robo.interfaces import cdr
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import String, Twist
from tests import bags
from tests.bags import MS, START

SECOND = 1_000 * MS
TWIST = topic_of("r1/cmd_vel", Twist)
MAP = topic_of("map", String, QoS.LATCHED)


class Clock:
    """A clock that stands until somebody moves it."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def plain(**options: Any) -> bag.Options:
    return bag.Options(**{"compression": "none", "sync": False, **options})


def text(value: str) -> bytes:
    return cdr.encoder(String)(String(value))


def count_of(path: Path) -> int:
    with bag.open(path) as opened:
        return sum(1 for _ in opened.messages())


def test_what_was_written_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path, count=100, missing=[7, 8])
    with bag.open(path) as opened:
        assert {topic.name: (topic.type, topic.count) for topic in opened.topics.values()} == {
            "r1/cmd_vel": ("geometry/Twist", 98),
            "r1/odom": ("nav/Odometry", 10),
            "r1/scan": ("sensor/LaserScan", 10),
            "r1/tf_static": ("tf2/TFMessage", 2),
        }
        first = next(opened.messages("r1/cmd_vel"))
        assert (first.arrived, first.published, first.sequence) == (START + MS, START, 1)
        assert first.data == bags.twist(0.0)
        assert opened.topic("r1/tf_static").qos == QoS.LATCHED
        assert opened.metadata == {"robo": {"version": "1", "robot": "r1"}}
        assert opened.attachment("manifest.yaml") == b"nodes: {}\n"


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_a_recording_is_compressed_if_that_is_wanted(compression: bag.Compression, tmp_path: Path) -> None:
    if not bags.readable(compression.replace("none", "")):
        pytest.skip("needs the extra record")
    path = tmp_path / "drive.mcap"
    bags.drive(path, bag.Options(compression=compression), count=300)
    assert bag.check(path).findings == []
    assert (path.stat().st_size < 40_000) == (compression == "zstd")


def test_what_came_is_in_the_file_after_a_second_and_a_new_topic_at_once(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    clock = Clock()
    recording = bag.Recording(path, plain(flush_period=1.0), monotonic=clock)
    number = recording.topic(TWIST)
    with bag.open(path) as opened:
        assert [*opened.topics] == ["r1/cmd_vel"]
        assert opened.faults[0].cut
    for step in range(4):
        clock.now += 0.3
        recording.write(number, bags.twist(step), START + step, START + step, step + 1)
    assert count_of(path) == 4  # the fourth came after 1.2 s
    recording.write(number, bags.twist(4), START + 4, START + 4, 5)
    assert count_of(path) == 4
    clock.now += 0.75
    assert recording.tick() == pytest.approx(0.25)
    assert count_of(path) == 4
    clock.now += 0.25
    assert recording.tick() == pytest.approx(1.0)
    assert count_of(path) == 5
    recording.close()


def test_a_chunk_that_is_full_is_written_at_once(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, plain(chunk_size=1_000), monotonic=Clock()) as recording:
        number = recording.topic(TWIST)
        for step in range(100):
            recording.write(number, bags.twist(step), START + step, START + step)
        assert count_of(path) > 85


def test_a_recording_in_a_folder_is_split_by_time_and_begins_with_what_is_latched(tmp_path: Path) -> None:
    path = tmp_path / "run"
    with bag.Recording(path, plain(split_duration=1.0)) as recording:
        map_, twist = recording.topic(MAP), recording.topic(TWIST)
        recording.add_metadata("robo", {"robot": "r1"})
        recording.attach("manifest.yaml", b"nodes: {}", "text/yaml", START)
        recording.write(map_, text("old"), START, START - SECOND, 1, "a")
        recording.write(map_, text("new"), START, START - MS, 2, "a")
        recording.write(map_, text("other"), START, START - MS, 1, "b")
        for step in range(30):
            recording.write(twist, bags.twist(step), START + step * 100 * MS, START + step * 100 * MS, step + 1)
    assert [file.name for file in sorted(path.glob("*.mcap"))] == ["run_0.mcap", "run_1.mcap", "run_2.mcap"]
    for number in range(3):
        with bag.open(path / f"run_{number}.mcap") as opened:
            assert not opened.faults
            messages = list(opened.messages())
            said = [message.value.data for message in messages if isinstance(message.value, String)]
            assert said == (["old", "new", "other"] if number == 0 else ["new", "other"])
            assert [message.topic.name for message in messages[:2]] == ["map", "map"]
            assert messages[0].arrived == opened.begin == START + number * SECOND
            assert opened.attachment("manifest.yaml") == b"nodes: {}"
            assert opened.metadata["robo"] == {"robot": "r1"}
    with bag.open(path) as opened:  # as one: what is said again does not come again
        assert (opened.count, opened.topic("map").count) == (33, 3)
        assert len(list(opened.messages())) == 33
    assert bag.check(path).findings == []


def test_what_is_latched_comes_again_even_if_it_is_larger_than_a_chunk(tmp_path: Path) -> None:
    path = tmp_path / "run"
    with bag.Recording(path, plain(split_duration=1.0, chunk_size=100)) as recording:
        maps = [recording.topic(topic_of(f"map{number}", String, QoS.LATCHED)) for number in range(3)]
        for number, topic in enumerate(maps):
            recording.write(topic, text("x" * 1000), START + number, START, 1)
        recording.write(recording.topic(TWIST), bags.twist(1), START + SECOND, START, 1)
    with bag.open(path) as opened:
        assert [(topic.name, topic.count) for topic in opened.topics.values()] == [
            ("map0", 1), ("map1", 1), ("map2", 1), ("r1/cmd_vel", 1),
        ]  # fmt: skip
        assert len(list(opened.messages())) == 4
    assert count_of(path / "run_1.mcap") == 4


def test_a_recording_is_split_by_size_and_the_oldest_go(tmp_path: Path) -> None:
    path = tmp_path / "run"
    with bag.Recording(path, plain(split_size=5_000, chunk_size=1_000, keep=3)) as recording:
        number = recording.topic(TWIST)
        for step in range(1_000):
            recording.write(number, bags.twist(step), START + step * MS, START + step * MS, step + 1)
            assert len(recording.files) <= 3
        assert recording.files == sorted(path.glob("*.mcap"), key=lambda file: int(file.stem.rpartition("_")[2]))
    sizes = [file.stat().st_size for file in recording.files[:-1]]
    assert all(5_000 <= size < 9_000 for size in sizes)
    with bag.open(path) as opened:
        numbers = [message.sequence for message in opened.messages()]
        assert numbers == list(range(numbers[0], 1_001))
        assert numbers[0] > 800
    assert bag.check(path).findings == []


def test_the_oldest_go_by_their_age(tmp_path: Path) -> None:
    path = tmp_path / "run"
    with bag.Recording(path, plain(split_duration=1.0, keep_duration=5.0)) as recording:
        number = recording.topic(TWIST)
        for step in range(3_000):
            recording.write(number, bags.twist(step), START + step * 10 * MS, START, step + 1)
            assert len(recording.files) <= 7
    with bag.open(path) as opened:
        begin = (opened.begin - START) / 1e9
        assert 23.0 <= begin <= 24.5, "of 30 s the last five, and what is in their files"


def test_the_oldest_go_where_all_take_too_much(tmp_path: Path) -> None:
    path = tmp_path / "run"
    with bag.Recording(path, plain(split_size=5_000, chunk_size=1_000, most_size=20_000)) as recording:
        number = recording.topic(TWIST)
        for step in range(3_000):
            recording.write(number, bags.twist(step), START + step * MS, START, step + 1)
            assert sum(file.stat().st_size for file in recording.files) < 24_000, "with what ends the last file"
        assert len(recording.files) > 1


@pytest.mark.parametrize("latched", [3_000, 8_000, 60_000])
def test_what_every_file_begins_with_leaves_room_for_messages(tmp_path: Path, latched: int) -> None:
    path = tmp_path / "run"
    with bag.Recording(path, plain(split_size=5_000, chunk_size=1_000, most_size=40_000)) as recording:
        map_, number = recording.topic(MAP), recording.topic(TWIST)
        recording.write(map_, text("x" * latched), START, START, 1, "a")
        recording.attach("manifest.yaml", b"x" * 2_000, "text/yaml", START)
        for step in range(1_000):
            recording.write(number, bags.twist(step), START + step * MS, START + step * MS, step + 1)
        sizes = [file.stat().st_size - latched for file in recording.files[:-1]]
        files = len(recording.files)
    assert all(size > 5_000 for size in sizes), "each has messages, however much it begins with"
    assert 3 <= files <= 9
    assert sum(file.stat().st_size for file in recording.files) < 40_000 + max(80_000, 4 * latched) + 20_000
    with bag.open(path) as opened:
        numbers = [message.sequence for message in opened.messages("r1/cmd_vel")]
        assert numbers == list(range(numbers[0], 1_001))
        assert len(numbers) > (200 if latched <= 8_000 else 80)


def test_a_file_that_somebody_deletes_ends_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    clock = Clock()
    recording = bag.Recording(path, plain(), monotonic=clock)
    number = recording.topic(TWIST)
    path.unlink()
    clock.now += 1.0
    with pytest.raises(BagError, match=r"drive\.mcap: somebody has deleted it while it was recorded"):
        recording.write(number, bags.twist(0), START, START, 1)
    clock.now += 1.0
    with pytest.raises(BagError, match="somebody has deleted it"):
        recording.tick()
    recording.close()


def test_a_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    def gone(_: Path) -> int:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))

    recording = bag.Recording(tmp_path / "drive.mcap", plain(least_free=1), free=gone)
    with pytest.raises(BagError, match="its disk does not tell what room it has: No such file"):
        recording.flush()
    recording.close()


def test_a_disk_that_is_full_as_a_file_is_closed_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = bag.Recording(tmp_path / "drive.mcap", plain())
    monkeypatch.setattr(recording._part, "_output", _FullAtTheEnd(recording._part._output))
    with pytest.raises(BagError, match="it cannot be written: No space left"):
        recording.close()


class _FullAtTheEnd:
    """A file of a network: what does not fit is told when it is closed."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self.fileno = file.fileno

    def close(self) -> None:
        self._file.close()
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_recording_that_has_not_begun_leaves_nothing(tmp_path: Path) -> None:
    for name, options in (("drive.mcap", plain()), ("run", plain(split_by_hand=True))):
        recording = bag.Recording(tmp_path / name, options)
        if options.splits:
            recording.split(START)
        recording.discard()
    assert list(tmp_path.iterdir()) == []


def metadata(folder: Path) -> Any:
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_what_changes_its_quality_of_service_is_one_topic_to_ros_and_said_again_once(tmp_path: Path) -> None:
    path = tmp_path / "run"
    deep = topic_of("map", String, QoS(depth=2, latched=True))
    with bag.Recording(path, plain(split_by_hand=True)) as recording:
        for step, topic in enumerate((MAP, deep, deep, deep, MAP)):
            recording.write(recording.topic(topic), text(str(step)), START + step, START, step + 1, "a")
        recording.split(START + 10)
        recording.write(recording.topic(topic_of("map", String)), text("5"), START + 11, START, 6, "a")
        recording.split(START + 20)
    (topic,) = metadata(path)["topics_with_message_count"]
    assert topic["message_count"] == metadata(path)["message_count"] == 6
    with bag.open(path / "run_1.mcap") as opened:
        assert [message.value.data for message in opened.messages("map") if isinstance(message.value, String)] == [
            "4", "5",
        ]  # fmt: skip
    assert count_of(path / "run_2.mcap") == 0, "it is latched no more"


def test_what_a_publisher_has_said_that_is_replaced_is_not_said_again(tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "run", plain(split_by_hand=True)) as recording:
        number = recording.topic(MAP)
        for source in "abc":
            recording.write(number, text(source), START, START, 1, source)
        recording.forget("map", "b")
        recording.forget("map", "nobody")
        recording.forget("other", "a")
        recording.split(START + 10)
    assert count_of(tmp_path / "run" / "run_1.mcap") == 2


def test_ros_is_told_encodings_and_files_that_are_there(tmp_path: Path) -> None:
    path = tmp_path / "run"
    name = 'r1/\N{ROBOT FACE}"\x7f'
    with bag.Recording(path, plain(split_by_hand=True, keep=2)) as recording:
        number = recording.topic(bag.TopicInFile(name, "a/B", "", encoding="msgpack", schema_encoding=""))
        for step in range(4):
            recording.write(number, b"x", START + step, START, step + 1)
            recording.split(START + step)
            whole = [file.name for file in recording.files[:-1]]
            assert metadata(path)["relative_file_paths"] == whole
    (topic,) = metadata(path)["topics_with_message_count"]
    assert topic["topic_metadata"]["serialization_format"] == "msgpack"
    assert topic["topic_metadata"]["name"] == f"/{name}"


def test_ros_has_its_metadata_of_a_folder(tmp_path: Path) -> None:
    path = tmp_path / "run"
    bags.drive(path, plain(split_duration=0.5), count=100)
    said = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert said["version"] == 9
    assert said["relative_file_paths"] == ["run_0.mcap", "run_1.mcap"]
    assert said["message_count"] == 122
    topics = {one["topic_metadata"]["name"]: one for one in said["topics_with_message_count"]}
    static = topics["/r1/tf_static"]
    assert (static["message_count"], static["topic_metadata"]["type"]) == (2, "tf2_msgs/msg/TFMessage")
    assert static["topic_metadata"]["offered_qos_profiles"][0]["durability"] == "transient_local"
    assert static["topic_metadata"]["type_description_hash"].startswith("RIHS01_")


def test_losses_are_counted_exactly_live_and_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    beyond = 2**40
    with bag.Recording(path, plain()) as recording:
        number = recording.topic(TWIST)
        numbers = [("a", 0), ("a", 1), ("b", -beyond + 1), ("a", 5), ("b", -beyond + 2), ("b", -beyond + 4), ("a", 6)]
        came: list[tuple[str, int | None]] = [(source, beyond + number) for source, number in numbers]
        for at, (source, sequence) in enumerate([*came, ("c", None)]):
            recording.write(number, bags.twist(0), START + at * MS, START + at * MS, sequence, source)
        recording.malformed("r1/cmd_vel")
        counts = recording.counts["r1/cmd_vel"]
        assert (counts.received, counts.lost, counts.malformed) == (8, 4, 1)
    (topic,) = bag.info(path).topics
    assert (topic.count, topic.lost) == (8, 4)


@pytest.mark.parametrize("source", ["a", None], ids=["signed", "unnamed"])
def test_what_is_malformed_is_not_lost(source: str | None, tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "drive.mcap", plain()) as recording:
        number = recording.topic(TWIST)
        for step in (1, 2, 5, 8):
            recording.write(number, bags.twist(0), START + step * MS, START + step * MS, step, source)
            if step == 2:
                for bad in (3, 4):
                    recording.malformed("r1/cmd_vel", bad, START + bad * MS, source)
        counts = recording.counts["r1/cmd_vel"]
    assert (counts.received, counts.lost, counts.malformed) == (4, 2, 2)


@given(st.lists(st.integers(1, 5), min_size=1, max_size=30), st.integers(0, 2**33))
def test_one_publisher_that_nobody_names_is_counted_as_well(steps: list[int], first: int) -> None:
    from robo.bag.write.counts import Counter

    counter = Counter()
    number = first
    counter.count("t", number, 0, None)
    for at, step in enumerate(steps, 1):
        number += step
        counter.count("t", number, at * 1000, None)
    assert counter.total["t"].lost == sum(steps) - len(steps)


def test_a_disk_that_fills_ends_the_recording_whole(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    clock, free = Clock(), [10_000_000]
    recording = bag.Recording(path, plain(least_free=1_000_000), monotonic=clock, free=lambda _: free[0])
    number = recording.topic(TWIST)
    recording.write(number, bags.twist(0), START, START, 1)
    free[0] = 999_999
    recording.write(number, bags.twist(1), START + 1, START, 2)
    clock.now += 1.0
    with pytest.raises(DiskFull, match="less than 1,000,000 bytes"):
        recording.write(number, bags.twist(2), START + 2, START, 3)
    for again in (recording.tick, recording.flush, lambda: recording.write(number, b"", START, START)):
        clock.now += 1.0
        with pytest.raises(DiskFull):
            again()
    recording.close()
    assert bag.check(path).findings == []
    assert count_of(path) == 3


def test_a_disk_that_fills_costs_the_oldest_files_if_that_is_wanted(tmp_path: Path) -> None:
    path = tmp_path / "run"
    clock = Clock()
    room = 10_000

    def free(folder: Path) -> int:
        return room - sum(file.stat().st_size for file in folder.glob("*.mcap"))

    options = plain(split_size=2_000, chunk_size=500, least_free=2_000, when_full="drop_oldest")
    with bag.Recording(path, options, monotonic=clock, free=free) as recording:
        number = recording.topic(TWIST)
        for step in range(2_000):
            clock.now += 0.5
            recording.write(number, bags.twist(step), START + step * MS, START + step * MS, step + 1)
    assert 1 < len(list(path.glob("*.mcap"))) <= 4
    with bag.open(path) as opened:
        numbers = [message.sequence for message in opened.messages()]
    assert numbers == list(range(numbers[0], 2_001))


def test_what_cannot_be_written_is_told_and_what_was_written_stays_readable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "drive.mcap"
    recording = bag.Recording(path, plain(chunk_size=500))
    number = recording.topic(TWIST)
    recording.write(number, bags.twist(0), START, START, 1)
    recording.flush()
    size = path.stat().st_size

    monkeypatch.setattr(recording._part.writer, "_output", _Full(recording._part))

    def write_much() -> None:
        for step in range(100):
            recording.write(number, bags.twist(step), START + step, START, step + 2)

    with pytest.raises(BagError, match=r"drive\.mcap: it cannot be written: No space left on device"):
        write_much()
    with pytest.raises(BagError, match="No space left"):
        recording.flush()
    with pytest.raises(BagError, match="No space left"):
        recording.write(number, bags.twist(0), START, START)
    recording.close()
    assert path.stat().st_size == size
    assert count_of(path) == 1


class _Full:
    """Takes a hundred bytes, and then the disk is full."""

    def __init__(self, part: Part) -> None:
        self._file = part._output
        self._room = 100

    def write(self, data: bytes) -> int:
        if not self._room:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = self._file.write(bytes(data)[: self._room]) or 0
        self._room -= written
        return written


def test_nothing_that_is_there_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    with pytest.raises(BagError, match=r"drive\.mcap: it is there already"):
        bag.Recording(path, plain())
    with pytest.raises(BagError, match="it is there already"):
        bag.Recording(tmp_path, plain(split_size=1_000))
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match=r"it cannot be made: (Not a directory|File exists)"):
        bag.Recording(tmp_path / "file" / "drive.mcap", plain())


def test_folders_are_made(tmp_path: Path) -> None:
    bags.drive(tmp_path / "logs" / "today" / "drive.mcap")
    bags.drive(tmp_path / "other" / "run", plain(split_duration=0.5))
    assert count_of(tmp_path / "other" / "run") == 122


def test_a_recording_that_has_ended_says_so(tmp_path: Path) -> None:
    recording = bag.Recording(tmp_path / "drive.mcap", plain())
    number = recording.topic(TWIST)
    recording.close()
    recording.close()
    with pytest.raises(BagError, match="the recording has ended"):
        recording.write(number, b"", START, START)
    with pytest.raises(BagError, match="the recording has ended"):
        recording.topic(MAP)
    assert recording.topic(TWIST) == number
    with bag.open(tmp_path / "drive.mcap") as opened:
        assert (opened.count, opened.begin, opened.end, opened.duration) == (0, 0, 0, 0.0)
        assert list(opened.messages()) == []


def test_times_that_no_file_can_hold(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, plain()) as recording:
        number = recording.topic(TWIST)
        recording.write(number, bags.twist(0), START, -5, -7)
        with pytest.raises(BagError, match="cannot have come at -1 ns"):
            recording.write(number, bags.twist(0), -1, START)
    with bag.open(path) as opened:
        (message,) = opened.messages()
        assert (message.published, message.sequence) == (START, 2**32 - 7)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"compression": "rar"}, "compression 'rar' is not known; use zstd or none"),
        ({"chunk_size": 0}, "chunk_size 0: use a number above 0"),
        ({"split_duration": float("nan")}, "split_duration nan: use a number above 0"),
        (
            {"keep": 2},
            "keep deletes the oldest of several files: say what splits them",
        ),
        ({"when_full": "drop_oldest"}, "when_full drop_oldest deletes the oldest"),
        ({"chunk_size": 10**9}, "chunk_size 1,000,000,000: use 67,108,864 at most"),
        ({"least_free": -1}, "least_free -1"),
    ],
)
def test_options_that_make_no_sense(options: dict[str, Any], reason: str) -> None:
    with pytest.raises(BagError, match=reason):
        bag.Options(**options)


def test_one_file_is_not_split(tmp_path: Path) -> None:
    with (
        bag.Recording(tmp_path / "drive.mcap", plain()) as recording,
        pytest.raises(BagError, match="it is one file"),
    ):
        recording.split(START)


def test_a_keep_all_topic_is_told_to_ros(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, plain()) as recording:
        recording.topic(topic_of("log", String, QoS(depth=KEEP_ALL)))
    with bag.open(path) as opened:
        assert opened.topic("/log").qos.depth == KEEP_ALL


def test_files_end_when_somebody_says_so(tmp_path: Path) -> None:
    path = tmp_path / "run"
    with bag.Recording(path, plain(split_by_hand=True)) as recording:
        number = recording.topic(TWIST)
        for step in range(3):
            recording.write(number, bags.twist(step), START + step, START, step + 1)
            recording.split(START + step)
    assert [file.name for file in recording.files] == [f"run_{number}.mcap" for number in range(4)]
    assert count_of(path) == 3
    with bag.open(path) as opened:  # the last one is empty
        assert (opened.begin, opened.end) == (START, START + 2)


@pytest.mark.parametrize("links", [True, False], ids=["links", "copies"])
def test_a_snapshot_stays_when_the_oldest_files_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    if not links:
        monkeypatch.setattr("os.link", refuse)
    with bag.Recording(tmp_path / "run", plain(split_by_hand=True, keep=2)) as recording:
        number = recording.topic(TWIST)
        for step in range(6):
            recording.write(number, bags.twist(step), START + step, START, step + 1)
            if step == 3:
                files = recording.snapshot(tmp_path / "kept", START + step)
            else:
                recording.split(START + step)
    assert [file.name for file in files] == ["run_3.mcap"], "its next one, which is empty, is one of the two"
    assert count_of(tmp_path / "kept") == 1
    assert bag.check(tmp_path / "kept").findings == []
    assert (tmp_path / "kept" / "metadata.yaml").exists()
    assert [file.name for file in recording.files] == ["run_5.mcap", "run_6.mcap"]


def test_a_snapshot_that_cannot_be_made_leaves_nothing_and_the_recording_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (tmp_path / "there").mkdir()
    with bag.Recording(tmp_path / "run", plain(split_by_hand=True)) as recording:
        number = recording.topic(TWIST)
        recording.write(number, bags.twist(1), START, START, 1)
        with pytest.raises(BagError, match="there: it cannot be made: File exists"):
            recording.snapshot(tmp_path / "there", START)
        monkeypatch.setattr("os.link", refuse)
        monkeypatch.setattr("shutil.copyfile", refuse)
        with pytest.raises(BagError, match="kept: it cannot be made: No space left"):
            recording.snapshot(tmp_path / "kept", START)
        assert not (tmp_path / "kept").exists()
        recording.write(number, bags.twist(2), START + 1, START + 1, 2)
    assert count_of(tmp_path / "run") == 2


def test_a_message_that_nobody_could_read_again_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.bag.write.writer.MOST_MESSAGE", 1_000)
    monkeypatch.setattr("robo.bag.write.writer.MOST_ATTACHMENT", 1_000)
    with bag.Recording(tmp_path / "drive.mcap", plain()) as recording:
        number = recording.topic(TWIST)
        with pytest.raises(BagError, match="r1/cmd_vel: a message of 1,001 bytes is larger than 1,000"):
            recording.write(number, bytes(1_001), START, START)
        with pytest.raises(BagError, match=r"map\.png has 1,001 bytes, and at most 1,000"):
            recording.attach("map.png", bytes(1_001), "image/png", START)
    assert count_of(tmp_path / "drive.mcap") == 0


def test_a_recording_whose_next_file_cannot_be_made_has_ended(tmp_path: Path) -> None:
    path = tmp_path / "run"
    recording = bag.Recording(path, plain(split_by_hand=True))
    number = recording.topic(TWIST)
    recording.write(number, bags.twist(0), START, START, 1)
    (path / "run_1.mcap").write_text("of somebody else")
    with pytest.raises(BagError, match=r"run_1\.mcap: it cannot be made: File exists"):
        recording.split(START)
    with pytest.raises(BagError, match=r"the recording has ended: .*run_1\.mcap: it cannot be made: File exists"):
        recording.write(number, bags.twist(0), START, START, 1)
    recording.close()
    assert bag.check(path / "run_0.mcap").findings == []


MESSAGES = st.lists(
    st.tuples(st.integers(0, 2), st.integers(0, 50), st.integers(0, 50), st.binary(max_size=40)), max_size=60
)
"""Topic, arrival, publish time, data."""


@given(
    messages=MESSAGES,
    chunk_size=st.integers(1, 500),
    split_size=st.none() | st.integers(1, 3_000),
    split_duration=st.none() | st.sampled_from([1e-9, 7e-9, 30e-9]),
)
def test_whatever_is_written_is_read_in_the_order_of_its_times(
    messages: list[tuple[int, int, int, bytes]], chunk_size: int, split_size: int | None, split_duration: float | None
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        options = plain(chunk_size=chunk_size, split_size=split_size, split_duration=split_duration)
        with bag.Recording(path, options) as recording:
            topics = [
                recording.topic(bag.TopicInFile(f"t{name}", "a/msg/B", "byte[] c", qos=qos))
                for name, qos in enumerate((QoS.DEFAULT, QoS.LATCHED, QoS(depth=3, latched=True)))
            ]
            for topic, arrived, published, data in messages:
                recording.write(topics[topic], data, START + arrived, START + published)
        with bag.open(path) as opened:
            for order, key in (("arrived", 1), ("published", 2)):
                found = [
                    (int(one.topic.name[1:]), one.arrived - START, one.published - START, one.data)
                    for one in opened.messages(order="arrived" if order == "arrived" else "published")
                ]
                assert found == sorted(messages, key=lambda message: message[key])
            assert opened.count == len(messages)
            if messages:
                assert opened.begin == START + min(message[1] for message in messages)
        assert not [found for found in bag.check(path).findings if found.kind in (bag.Kind.INDEX, bag.Kind.DAMAGED)]
