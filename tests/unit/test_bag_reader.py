"""Reading recordings of all forms: topics, order, time, types that are not known, columns."""

import gc
import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from robo import bag
from robo.bag.read.order import MOST_KEPT
from robo.bag.types import nothing, topic_of
from robo.errors import BagError, DamagedBag
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import Odometry, String, TFMessage, Twist
from tests import bags
from tests.bags import MS, START

PLAIN = bag.Options(compression="none", sync=False)
TWIST = topic_of("r1/cmd_vel", Twist)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A file with many small chunks."""
    path = tmp_path_factory.mktemp("bag") / "drive.mcap"
    bags.drive(path, bag.Options(compression="none", sync=False, chunk_size=700))
    return path.read_bytes()


def same(data: bytes) -> bytes:
    return data


def _compressed(name: str) -> Callable[[bytes], bytes]:
    def compress(data: bytes) -> bytes:
        from tests.hostile_bags import compressors

        return bags.with_chunks(data, name, compressors()[name])

    return compress


FORMS = {
    "whole": same,
    "without a summary": bags.without_summary,
    "without chunks": bags.without_chunks,
    "zstd": _compressed("zstd"),
    "lz4": _compressed("lz4"),
}


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_of_files_say_the_same(form: str, whole: bytes, tmp_path: Path) -> None:
    if form in ("zstd", "lz4") and not bags.readable(form):
        pytest.skip("needs the extra record")
    path = tmp_path / "drive.mcap"
    path.write_bytes(FORMS[form](whole))
    with bag.open(path) as opened:
        assert not opened.faults
        assert opened.count == 122
        assert (opened.begin, opened.end) == (START, START + 991 * MS)
        messages = list(opened.messages())
        assert [message.arrived for message in messages] == sorted(message.arrived for message in messages)
        assert len(messages) == 122
        values = [message.value for message in opened.messages("r1/cmd_vel")]
        assert [value.linear.x for value in values if isinstance(value, Twist)] == [step / 10 for step in range(100)]
        part = list(opened.messages(["r1/odom", "/r1/scan"], START + 100 * MS, START + 202 * MS))
        assert [(message.topic.name, message.published - START) for message in part] == [
            ("r1/scan", 100 * MS), ("r1/odom", 100 * MS),
        ]  # fmt: skip
        assert opened.attachment("manifest.yaml") == b"nodes: {}\n"
        assert opened.metadata["robo"]["robot"] == "r1"


def written(path: Path, *times: tuple[int, int], topic: bag.TopicInFile = TWIST) -> None:
    """Messages with these times of arrival and publishing; each says its place."""
    with bag.Recording(path, bag.Options(compression="none", sync=False, chunk_size=300)) as recording:
        number = recording.topic(topic)
        for place, (arrived, published) in enumerate(times):
            recording.write(number, bags.twist(place), START + arrived, START + published, place + 1)


def places(opened: bag.Bag, order: str = "arrived", **more: int) -> list[float]:
    found = []
    for message in opened.messages("r1/cmd_vel", order="published" if order == "published" else "arrived", **more):
        assert isinstance(message.value, Twist)
        found.append(message.value.linear.x)
    return found


def test_order_is_by_arrival_or_by_publishing_and_of_one_time_that_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    written(path, (10, 9), (20, 5), (20, 7), (5, 7), (20, 5), (30, 1), (40, 50), (35, 40), (60, 2))
    with bag.open(path) as opened:
        assert places(opened) == [3, 0, 1, 2, 4, 5, 7, 6, 8]
        assert places(opened, "published") == [5, 8, 1, 4, 2, 3, 0, 7, 6]
        assert places(opened, "published", begin=START + 5, end=START + 9) == [1, 4, 2, 3]
        assert places(opened, begin=START + 20, end=START + 35) == [1, 2, 4, 5]
        assert places(opened, begin=START + 100) == []
        assert list(opened.times("r1/cmd_vel", "published") - START)[:3] == [1, 2, 5]


def test_a_topic_that_is_not_there_is_told_when_it_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    with bag.open(path) as opened:
        with pytest.raises(BagError, match=r"drive\.mcap: it has no topic r1/cmd_val; did you mean r1/cmd_vel\?"):
            opened.messages("r1/cmd_val")
        with pytest.raises(BagError, match=r"no attachment manifest\.yml; did you mean manifest\.yaml"):
            opened.attachment("manifest.yml")


def test_columns_are_arrays_where_numpy_is_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    with bag.open(path) as opened:
        column = opened.column("r1/odom", "pose.pose.position.x")
        assert column.dtype == "float64"
        assert list(column) == [step / 10 for step in range(10)]
        assert opened.column("/r1/scan", "ranges.1").tolist() == [2.0] * 10
        assert (opened.times("r1/odom", "published")[1] - START) == 100 * MS
        monkeypatch.setitem(__import__("sys").modules, "numpy", None)
        assert opened.column("r1/odom", "pose.pose.position.x") == [step / 10 for step in range(10)]
        for field in ("pose.position", "pose.pose.position.x.y", "pose.covariance.40"):
            with pytest.raises(BagError, match=f"r1/odom: a nav/Odometry has no {field}"):
                opened.column("r1/odom", field)


def test_messages_of_a_type_that_is_not_known_stay_bytes_and_that_is_said(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    strange = bag.TopicInFile("arm", "arm_msgs/msg/Joints", "float64[] angles\n")
    other = bag.TopicInFile("pose", "geometry_msgs/msg/Twist", "float32 x\nfloat32 y\n")
    as_json = bag.TopicInFile("text", "std_msgs/msg/String", "", encoding="json", schema_encoding="jsonschema")
    unsaid = bag.TopicInFile("what", "", "", schema_encoding="")
    with bag.Recording(path, PLAIN) as recording:
        for number, topic in enumerate((strange, other, as_json, unsaid)):
            recording.write(recording.topic(topic), b"bytes", START + number, START)
    with bag.open(path) as opened:
        assert {topic.name: topic.unknown for topic in opened.topics.values()} == {
            "arm": "robo has no type 'arm_msgs/msg/Joints'",
            "pose": "its definition is another one: geometry_msgs/Twist has float32 x where robo has "
            "geometry_msgs/Vector3 linear",
            "text": "its messages are in 'json', and robo reads cdr",
            "what": "the file does not say what its type is",
        }
        assert [message.value for message in opened.messages()] == [b"bytes"] * 4
        assert opened.topics["arm"].type == "arm_msgs/msg/Joints"
        with pytest.raises(BagError, match="arm has no fields that can be read: robo has no type"):
            opened.column("arm", "angles")


def test_a_message_that_is_none_of_its_type_is_an_error_and_the_others_are_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, PLAIN) as recording:
        number = recording.topic(TWIST)
        for data in (bags.twist(1), b"\0\1\0\0abc", bags.twist(2)):
            recording.write(number, data, START, START)
    with bag.open(path) as opened:
        first, second, third = opened.messages()
        assert isinstance(first.value, Twist)
        with pytest.raises(BagError, match=f"r1/cmd_vel, the message that came at {START} ns: no geometry/Twist: "):
            assert second.value
        assert isinstance(third.value, Twist)


def test_types_can_be_those_of_somebody_else(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    with bag.open(path, nothing) as opened:
        assert all(topic.unknown for topic in opened.topics.values())
        assert all(isinstance(message.value, bytes) for message in opened.messages())


def test_a_topic_whose_type_changes_is_two(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, PLAIN) as recording:
        recording.write(recording.topic(TWIST), bags.twist(0), START, START)
        recording.write(recording.topic(topic_of("r1/cmd_vel", String)), b"\0\1\0\0\1\0\0\0\0", START, START)
    with bag.open(path) as opened:
        assert [*opened.topics] == ["r1/cmd_vel", "r1/cmd_vel (std_msgs/msg/String)"]
        assert len(list(opened.messages("r1/cmd_vel (std_msgs/msg/String)"))) == 1


def test_what_is_latched_at_a_time_is_what_each_publisher_said_last(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, PLAIN) as recording:
        number = recording.topic(topic_of("map", Twist, QoS(depth=2, latched=True)))
        for at, (place, sequence) in enumerate([(0, 1), (1, 1), (2, 2), (3, 10), (4, 11), (5, 12), (6, 13)]):
            recording.write(number, bags.twist(place), START + at, START, sequence, "whoever")
    with bag.open(path) as opened:

        def latched(at: int) -> list[float]:
            return [message.value.linear.x for message in opened.latched(at) if isinstance(message.value, Twist)]

        assert latched(START) == []
        assert latched(START + 2) == [0, 1]  # two publishers that begin: both have number 1
        assert latched(START + 7) == [0, 1, 2, 5, 6]


LATCHED = QoS(depth=1, latched=True)


@pytest.mark.parametrize("numbers", [(0, 0, 0, 0), (1, 2, 1, 2)])
def test_static_transforms_stay_of_all_who_said_some(numbers: tuple[int, ...], tmp_path: Path) -> None:
    frames = ["base", "laser", "imu", "laser"]
    said = [
        (number, at, at, bags.transform(frame)) for at, (number, frame) in enumerate(zip(numbers, frames, strict=True))
    ]
    path = tmp_path / "ros.mcap"
    bags.of_ros(path, topic_of("tf_static", TFMessage, LATCHED), [*said, (9, 9, 9, bags.transform("late"))])
    with bag.open(path) as opened:
        assert [message.arrived - START for message in opened.latched(START + 5)] == [0, 2, 3]
    assert bag.cut(path, tmp_path / "part.mcap", START + 5, compression="none").latched == 3


@pytest.mark.parametrize(
    ("numbers", "publishers", "depth", "left"),
    [
        ((0, 0, 0, 0), 3, 1, [1, 2, 3]),
        ((0, 0, 0, 0), 1, 2, [2, 3]),
        ((0, 0, 0, 0), 1, KEEP_ALL, [0, 1, 2, 3]),
        ((1, 2, 1), 1, 1, [0, 1, 2]),  # of three, said before the recording began
        ((1, 2, 1, 2, 3), 1, 1, [0, 1, 2, 3, 4]),  # those that come later may be of either
    ],
)
def test_what_is_latched_stays_of_each_publisher(
    numbers: tuple[int, ...], publishers: int, depth: int, left: list[int], tmp_path: Path
) -> None:
    path = tmp_path / "ros.mcap"
    said = [(number, place, -1_000 if place < 3 else place, bags.twist(place)) for place, number in enumerate(numbers)]
    topic = topic_of("map", Twist, QoS(depth=depth, latched=True))
    bags.of_ros(path, topic, [*said, (9, 99, 99, bags.twist(9))], publishers)
    with bag.open(path) as opened:
        assert [message.arrived - START for message in opened.latched(START + 50)] == left
    assert bag.cut(path, tmp_path / "part.mcap", START + 50, compression="none").latched == len(left)


def test_what_is_latched_takes_no_more_memory_than_it_may(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robo.bag.read.latched._MOST", 120)
    path = tmp_path / "ros.mcap"
    said = [(0, at, at, bags.twist(at)) for at in range(20)]
    bags.of_ros(path, topic_of("map", Twist, QoS(depth=KEEP_ALL, latched=True)), said)
    with bag.open(path) as opened:
        assert [message.arrived - START for message in opened.latched(START + 50)] == [18, 19]


def test_files_are_as_one_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (0, 1, 2, 10, 11):
        path = tmp_path / "run" / f"run_{number}.mcap"
        bags.drive(path, count=10, start=START + number * 1_000 * MS)
    with bag.open(tmp_path / "run") as opened:
        assert [Path(path).name for path in opened.files.paths] == [f"run_{n}.mcap" for n in (0, 1, 2, 10, 11)]
        assert opened.count == 5 * 14
        arrivals = [message.arrived for message in opened.messages()]
        assert arrivals == sorted(arrivals)


def test_many_files_are_not_all_open(tmp_path: Path) -> None:
    for number in range(40):
        bags.drive(tmp_path / "run" / f"run_{number}.mcap", count=2, start=START + number * 1_000 * MS)
    before = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").exists() else 0
    with bag.open(tmp_path / "run") as opened:
        assert len(list(opened.messages())) == opened.count
        if before:
            assert len(os.listdir("/proc/self/fd")) <= before + 16
    if before:
        assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "it is empty"),
        (b"\x89MCAP0", "it is no MCAP file"),
        (b"SQLite format 3\0", "a database of SQLite, .*: `rosbags-convert` or `ros2 bag convert` makes MCAP"),
        (b"\x28\xb5\x2f\xfd and more", "compressed as a whole: `unzstd` makes MCAP"),
        (b"#ROSBAG V2.0\n", "a recording of ROS 1: `rosbags-convert`"),
        (b"a text", "it is no MCAP file"),
    ],
)
def test_what_is_no_recording(content: bytes, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    path.write_bytes(content)
    with pytest.raises(BagError, match=reason):
        bag.open(path)


def test_what_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="No such file"):
        bag.open(tmp_path / "drive.mcap")
    with pytest.raises(BagError, match="the folder has no recording: no file that ends in"):
        bag.open(tmp_path)
    with pytest.raises(BagError, match="null"):
        bag.open("a\0b")
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(BagError, match="it is a pipe, not a file"):
        bag.open(tmp_path / "pipe.mcap")


def test_a_folder_with_a_file_that_is_none_opens_with_the_others(tmp_path: Path) -> None:
    bags.drive(tmp_path / "run" / "run_0.mcap")
    (tmp_path / "run" / "run_1.mcap").write_bytes(b"")
    with bag.open(tmp_path / "run") as opened:
        assert opened.count == 122
        assert [str(fault) for fault in opened.faults] == [f"{tmp_path}/run/run_1.mcap, byte 0: it is empty"]


def test_a_damaged_chunk_is_an_error_with_its_place_unless_it_is_to_be_left_out(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    chunks = [begin for kind, begin, _ in bags.records_of(whole) if kind == 6]
    damaged = bytearray(whole)
    damaged[chunks[5] + 200] ^= 1
    path.write_bytes(damaged)
    with bag.open(path) as opened:
        assert not opened.faults
        with pytest.raises(DamagedBag, match="a chunk has another checksum than it says") as caught:
            list(opened.messages())
        assert (caught.value.path, caught.value.offset) == (str(path), chunks[5])
    with bag.open(path, scan=True) as opened:
        assert [fault.offset for fault in opened.faults] == [chunks[5]]
        assert 100 < len(list(opened.messages())) == opened.count < 122
    info = bag.info(path)
    assert 100 < info.count < 122
    assert len(info.faults) == 1


@pytest.mark.parametrize("form", ["whole", "without a summary", "without chunks"])
def test_a_large_file_takes_little_memory(form: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    size, count = 200_000, 600
    picture = topic_of("picture", String)
    with bag.Recording(path, bag.Options(compression="none", sync=False, chunk_size=4 * size)) as recording:
        number = recording.topic(picture)
        for step in range(count):
            recording.write(number, bytes([step % 256]) * size, START + step, START, step + 1)
    if form != "whole":
        path.write_bytes(FORMS[form](path.read_bytes()))
    assert path.stat().st_size > MOST_KEPT * 1.5
    gc.collect()
    tracemalloc.start()
    try:
        with bag.open(path) as opened:
            assert sum(1 for _ in opened.messages()) == count
            assert sum(1 for _ in opened.messages(order="published")) == count
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < MOST_KEPT * 1.2


def test_reading_needs_neither_network_nor_numpy() -> None:
    import subprocess
    import sys

    script = "from robo import bag; bag.open, bag.Recording, bag.recover; import sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert not {name.partition(".")[0] for name in loaded} & {"zenoh", "numpy", "backports", "lz4", "yaml", "asyncio"}
    assert not [name for name in loaded if name.startswith(("robo.node", "robo.process", "robo.cli"))]


def test_odometry_keeps_all_its_digits(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    with bag.open(path) as opened:
        values = [message.value for message in opened.messages("r1/odom")]
    assert all(isinstance(value, Odometry) and value.header.frame_id == "odom" for value in values)
