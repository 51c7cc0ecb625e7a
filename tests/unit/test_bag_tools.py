"""What is told of recordings, found in them, made of them; and how two differ."""

from pathlib import Path

import msgspec
import pytest

from robo import bag
from robo.bag.mcap import format as mcap
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.types import topic_of
from robo.errors import BagError, DamagedBag
from robo.wire.qos import QoS
from robo_messages import String, Twist
from tests import bags
from tests.bags import MS, START

PLAIN = bag.Options(compression="none", sync=False)
SECOND = 1_000 * MS
TWIST = topic_of("r1/cmd_vel", Twist)


def record(path: Path, *messages: tuple[int, int, int], topic: bag.TopicInFile = TWIST) -> None:
    """Messages with their arrivals and publish times after the beginning, ms, and their numbers."""
    with bag.Recording(path, PLAIN) as recording:
        number = recording.topic(topic)
        for arrived, published, sequence in messages:
            data = bags.twist(sequence)
            recording.write(number, data, START + arrived * MS, START + published * MS, sequence, "a")


def test_info_tells_rates_gaps_losses_and_sizes(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path, count=100, missing=[40, 41, 42])
    info = bag.info(path)
    assert (info.count, info.profile, info.library, info.faults) == (119, "ros2", "robo", [])
    assert info.duration == pytest.approx(0.991)
    assert info.size == path.stat().st_size
    assert info.attachments == {"manifest.yaml": 10}
    topics = {topic.name: topic for topic in info.topics}
    twist = topics["r1/cmd_vel"]
    assert (twist.type, twist.count, twist.lost, twist.unknown) == ("geometry/Twist", 97, 3, "")
    assert twist.rate == pytest.approx(100.0)
    assert twist.gap == pytest.approx(0.04)
    assert twist.gap_at == START + 391 * MS
    assert twist.size == 97 * 52
    assert twist.delay == pytest.approx(0.001)
    assert (twist.begin, twist.end) == (START + MS, START + 991 * MS)
    assert (topics["r1/tf_static"].latched, topics["r1/tf_static"].lost) == (True, 0)
    quick = bag.info(path, quick=True)
    assert (quick.count, quick.topics[0].count, quick.topics[0].rate, quick.topics[0].lost) == (119, 97, None, None)
    assert msgspec.json.decode(msgspec.json.encode(info))["topics"][0]["lost"] == 3


def test_losses_are_told_without_what_the_recorder_counted(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    bags.drive(whole, bag.Options(compression="none", sync=False, chunk_size=700), missing=[10, 11])
    cut.write_bytes(whole.read_bytes()[:-3_000])
    (twist,) = [topic for topic in bag.info(cut).topics if topic.name == "r1/cmd_vel"]
    assert twist.lost == 2


def test_a_topic_of_one_message_or_none_has_no_rate(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, PLAIN) as recording:
        recording.topic(topic_of("silent", String))
        recording.write(recording.topic(TWIST), bags.twist(0), START, START)
    one, silent = bag.info(path).topics
    assert (one.count, one.rate, one.gap, one.lost) == (1, None, None, 0)
    assert (silent.count, silent.begin, silent.size) == (0, None, 0)


def kinds(path: Path) -> dict[tuple[str, str], int]:
    return {(found.kind.value, found.topic): found.count for found in bag.check(path).findings}


def test_check_finds_nothing_wrong_with_a_good_recording(tmp_path: Path) -> None:
    bags.drive(tmp_path / "drive.mcap")
    report = bag.check(tmp_path / "drive.mcap")
    assert (report.findings, report.messages, report.whole) == ([], 122, True)


def test_check_finds_holes_losses_and_disorder(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    even = [(step * 10, step * 10, step + 1) for step in range(100)]
    record(path, *even, (4_000, 4_000, 101), (4_010, 4_005, 103), (4_020, 4_004, 102))
    report = bag.check(path)
    assert {found.kind.value: (found.count, found.text) for found in report.findings} == {
        "hole": (1, "3.0 s without a message"),
        "out of order": (1, "up to 0.001 s late"),
        "lost": (1, "up to 1 in a row"),
    }
    assert report.whole


def test_check_finds_clocks_that_jump_and_those_that_were_not_set(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, PLAIN) as recording:
        number = recording.topic(TWIST)
        for sequence, at in enumerate((5 * SECOND, 6 * SECOND, START + 9 * SECOND, START, START + SECOND), 1):
            recording.write(number, bags.twist(0), at, at, sequence, "a")
    found = kinds(path)
    assert found["time jump", ""] == 2, "forward by years, and back"
    assert found["epoch", "r1/cmd_vel"] == 2


def two_publishers(path: Path, *, numbers: bool, behind: int = 3) -> None:
    """Two sound publishers of a topic, of which one takes longer, ms."""
    rows = sorted(
        (step * 10 + who * behind, step * 10 + 5 * who - 5, step + 1, who) for who in range(2) for step in range(100)
    )
    of_ros = [
        (number if numbers else 0, arrived * MS, (published - who * 5) * MS, bags.twist(who))
        for arrived, published, number, who in rows
    ]
    bags.of_ros(path, TWIST, of_ros, publishers=2)


@pytest.mark.parametrize("numbers", [True, False])
@pytest.mark.parametrize("behind", [3, 25])
def test_a_publisher_that_is_slower_than_another_one_is_no_disorder(numbers: bool, behind: int, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    two_publishers(path, numbers=numbers, behind=behind)
    assert bag.check(path).findings == []


def test_without_numbers_what_is_late_is_so_of_a_topic_with_one_publisher(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    said = [(0, at * MS, (at - 5 * (at == 7)) * MS, bags.twist(at)) for at in range(10)]
    bags.of_ros(path, TWIST, said)
    assert kinds(path) == {("out of order", "r1/cmd_vel"): 1}
    bags.of_ros(path, TWIST, said, publishers=2)
    assert kinds(path) == {}


def test_check_sees_a_topic_that_dies_or_comes_late(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with bag.Recording(path, PLAIN) as recording:
        dies, late, lives = (recording.topic(topic_of(name, Twist)) for name in ("dies", "late", "lives"))
        for step in range(1_000):
            at = START + step * 100 * MS
            if step < 100:
                recording.write(dies, bags.twist(0), at, at, step + 1, "a")
            if step > 900:
                recording.write(late, bags.twist(0), at, at, step, "b")
            recording.write(lives, bags.twist(0), at, at, step + 1, "c")
    assert [(found.topic, found.text, found.time) for found in bag.check(path).findings] == [
        ("dies", "90.0 s without a message, up to the end", START + 9_900 * MS),
        ("late", "90.1 s until the first message", START),
    ]


def test_check_sees_a_clock_that_is_set_forward(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    record(path, *((step * 10 + 3_600_000 * (step > 5), step * 10, step + 1) for step in range(10)))
    (found,) = bag.check(path).findings
    assert (found.kind, found.time) == (bag.Kind.JUMP, START + 50 * MS)
    assert found.text == "nothing came for 3600.0 s: all was silent, or the clock was set forward"


def test_info_and_check_say_what_the_recorder_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with bag.Recording(path, PLAIN) as recording:
        number = recording.topic(TWIST)
        for step in range(10):
            recording.write(number, bags.twist(0), START + step * MS, START, 1 + step * 500, f"publisher {step % 2}")
        recording.malformed("r1/cmd_vel")
    (topic,) = bag.info(path).topics
    assert topic.lost == 8 * 999
    assert topic.malformed == 1
    assert kinds(path) == {("lost", "r1/cmd_vel"): 8 * 999, ("malformed", "r1/cmd_vel"): 1}


def test_what_is_made_of_a_recording_is_of_its_profile(tmp_path: Path) -> None:
    path = tmp_path / "ros1.mcap"
    with path.open("wb") as file:
        writer = FileWriter(file, profile="ros1")
        writer.add_channel(mcap.Channel(1, 0, "t", "ros1", {}))
        writer.add_message(1, 0, START, START, b"x")
        writer.finish()
    bags.drive(tmp_path / "drive.mcap")
    bag.recover(path, tmp_path / "a.mcap")
    bag.keep(path, tmp_path / "b.mcap", lambda _: True, "none")
    bag.merge([path, path], tmp_path / "c.mcap", "none")
    bag.merge([path, tmp_path / "drive.mcap"], tmp_path / "d.mcap", "none")
    assert [bag.info(tmp_path / f"{name}.mcap").profile for name in "abcd"] == ["ros1", "ros1", "ros1", ""]


def test_recordings_without_messages_become_one_without(tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "a.mcap", PLAIN) as recording:
        recording.topic(TWIST)
    with bag.Recording(tmp_path / "b.mcap", PLAIN):
        pass
    for source in ("a", "b"):
        path = tmp_path / f"{source}.mcap"
        assert bag.merge([path, path], tmp_path / f"{source}2.mcap", "none").messages == 0
        assert bag.keep(path, tmp_path / f"{source}3.mcap", lambda _: True, "none").messages == 0
        assert bag.check(tmp_path / f"{source}2.mcap").findings == []


def test_attachments_of_one_name_and_no_checksum_are_all_kept(tmp_path: Path) -> None:
    path, part = tmp_path / "a.mcap", tmp_path / "b.mcap"
    with bag.Recording(path, PLAIN) as recording:
        recording.write(recording.topic(TWIST), bags.twist(0), START, START)
        for data in (b"one", b"two", b"one"):
            recording.attach("file", data, "text/plain", START)
    unchecked = bytearray(path.read_bytes())
    for kind, _, end in bags.records_of(bytes(unchecked)):
        if kind == mcap.ATTACHMENT:
            unchecked[end - 4 : end] = bytes(4)
    path.write_bytes(unchecked)
    bag.keep(path, part, lambda _: True, "none")
    with bag.open(part) as opened:
        assert [one.data for one in opened.all_attachments()] == [b"one", b"two"]


def test_check_finds_messages_that_are_none_and_types_that_are_not_known(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with bag.Recording(path, PLAIN) as recording:
        number = recording.topic(TWIST)
        strange = recording.topic(bag.TopicInFile("arm", "arm_msgs/msg/Joints", "float64[] angles\n"))
        recording.write(number, bags.twist(0), START, START)
        recording.write(number, b"nothing", START, START)
        recording.write(strange, b"whatever", START, START)
    report = bag.check(path)
    assert kinds(path) == {("undecodable", "r1/cmd_vel"): 1, ("unknown type", "arm"): 1}
    assert not report.whole


def test_check_finds_a_summary_that_lies(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    data = bytearray(path.read_bytes())
    (at,) = [begin for kind, begin, _ in bags.records_of(bytes(data)) if kind == 0x0B]
    counts = at + 9 + 8 + 2 + 4 * 4 + 16 + 4 + 2
    data[counts] += 1  # one more message of the first topic
    path.write_bytes(data)
    (found,) = bag.check(path).findings
    assert found.kind == bag.Kind.INDEX
    assert "the summary has another checksum than it says" in found.text
    path.write_bytes(bags.summary_without_checksum(bytes(data)))
    (found,) = bag.check(path).findings
    assert found.kind == bag.Kind.INDEX
    assert "the summary counts 122 messages, and by their topics 123" in found.text
    data[at + 9] += 1
    path.write_bytes(bags.summary_without_checksum(bytes(data)))
    (found,) = bag.check(path).findings
    assert (found.kind, found.text) == (bag.Kind.INDEX, f"{path}: its summary counts 123 messages, and it has 122")


def test_check_tells_of_a_file_that_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path, bag.Options(compression="none", sync=False, chunk_size=700))
    path.write_bytes(path.read_bytes()[:-4_000])
    report = bag.check(path)
    assert report.findings[0].kind == bag.Kind.CUT
    assert "drive.mcap, byte" in report.findings[0].text
    assert not report.whole


def test_a_part_begins_with_what_is_latched(tmp_path: Path) -> None:
    path, part = tmp_path / "drive.mcap", tmp_path / "part.mcap"
    bags.drive(path)
    edited = bag.cut(path, part, START + 500 * MS, START + 600 * MS, "none")
    assert (edited.topics, edited.messages, edited.latched) == (4, 14, 2)
    with bag.open(part) as opened:
        messages = list(opened.messages())
        assert [message.topic.name for message in messages[:3]] == ["r1/tf_static", "r1/tf_static", "r1/cmd_vel"]
        assert (opened.begin, opened.end) == (START + 500 * MS, START + 591 * MS)
        assert messages[0].published == START
        assert opened.attachment("manifest.yaml") == b"nodes: {}\n"
        assert opened.metadata == {"robo": {"version": "1", "robot": "r1"}}
        assert opened.topic("r1/scan").qos == QoS.SENSOR_DATA
    assert bag.check(part).findings == []


def test_a_part_in_which_nothing_came_is_not_made(tmp_path: Path) -> None:
    path, part = tmp_path / "drive.mcap", tmp_path / "part.mcap"
    bags.drive(path)
    with pytest.raises(BagError, match=f"no message came in that time; they came from {START} to"):
        bag.cut(path, part, START + 5 * SECOND, compression="none")
    with pytest.raises(BagError, match="nothing is from 7 ns on and before 7 ns"):
        bag.cut(path, part, 7, 7)
    assert not part.exists()


def test_some_topics_are_kept(tmp_path: Path) -> None:
    path, part = tmp_path / "drive.mcap", tmp_path / "part.mcap"
    bags.drive(path)
    edited = bag.keep(path, part, lambda name: name.startswith("r1/") and name != "r1/scan", "none")
    assert (edited.topics, edited.messages) == (3, 112)
    with bag.open(part) as opened:
        assert [*opened.topics] == ["r1/cmd_vel", "r1/odom", "r1/tf_static"]
    with pytest.raises(BagError, match="it has none of these topics"):
        bag.keep(path, tmp_path / "none.mcap", lambda name: name == "r2/scan", "none")


def test_recordings_become_one_in_the_order_of_their_arrivals(tmp_path: Path) -> None:
    first, second, merged = tmp_path / "a.mcap", tmp_path / "b", tmp_path / "m.mcap"
    bags.drive(first, count=50)
    bags.drive(
        second, bag.Options(compression="none", sync=False, split_duration=0.2), count=50, start=START + 250 * MS
    )
    edited = bag.merge([first, second], merged, "none")
    assert edited.messages == 2 * (50 + 10 + 2)
    with bag.open(merged) as opened:
        arrivals = [message.arrived for message in opened.messages()]
        assert arrivals == sorted(arrivals)
        assert opened.topic("r1/tf_static").count == 4
        assert [*opened.attachments] == ["manifest.yaml"]
    assert bag.check(merged).whole
    with pytest.raises(BagError, match="there is nothing to merge"):
        bag.merge([], tmp_path / "none.mcap")


def test_a_damaged_recording_is_mended_before_it_is_edited(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(DamagedBag, match=r"the file is cut: .*; `robo bag recover` makes a whole file"):
        bag.cut(path, tmp_path / "part.mcap", START)


def test_differences_are_told_with_the_field(tmp_path: Path) -> None:
    first, second = tmp_path / "a.mcap", tmp_path / "b.mcap"
    bags.drive(first)
    with bag.open(first) as opened, bag.Recording(second, PLAIN) as recording:
        numbers = {name: recording.topic(bag.TopicInFile(name, topic.schema, topic.text, qos=topic.qos))
                   for name, topic in opened.topics.items() if name != "r1/scan"}  # fmt: skip
        for index, message in enumerate(opened.messages(["r1/odom", "r1/cmd_vel"])):
            data = bags.twist(99) if index == 30 else message.data
            recording.write(numbers[message.topic.name], data, message.arrived + index, message.published + 2 * MS)
    difference = bag.diff(first, second)
    assert not difference.same
    topics = {topic.name: topic for topic in difference.topics}
    twist = topics["r1/cmd_vel"]
    assert (twist.counts, twist.differing, twist.same) == ((100, 100), 1, False)
    assert twist.first is not None
    assert (twist.first.field, twist.first.second) == ("linear.x", "99.0")
    assert twist.shift == pytest.approx(0.002)
    assert topics["r1/odom"].same
    assert topics["r1/scan"].types == ("sensor/LaserScan", "")
    assert topics["r1/tf_static"].counts == (2, 0)


def test_a_recording_does_not_differ_from_itself(tmp_path: Path) -> None:
    bags.drive(tmp_path / "a.mcap")
    assert bag.diff(tmp_path / "a.mcap", tmp_path / "a.mcap").same


@pytest.mark.parametrize("force", [False, True])
def test_what_is_interrupted_leaves_no_half_file(force: bool, tmp_path: Path) -> None:
    path, part = tmp_path / "drive.mcap", tmp_path / "part.mcap"
    bags.drive(path)
    if force:
        part.write_bytes(b"before")

    def interrupt(done: int, total: int) -> None:
        assert (done, total) == (50, 122)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bag.keep(path, part, lambda _: True, "none", force=force, tell=interrupt)
    assert sorted(file.name for file in tmp_path.iterdir()) == (
        ["drive.mcap", "part.mcap"] if force else ["drive.mcap"]
    )
    assert not force or part.read_bytes() == b"before"


def test_how_far_things_are_is_told(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    bags.drive(path, bag.Options(compression="none", sync=False, chunk_size=2_000))
    size = path.stat().st_size
    told: list[tuple[int, int]] = []

    def tell(done: int, total: int) -> None:
        told.append((done, total))

    def taken() -> list[tuple[int, int]]:
        found = list(told)
        told.clear()
        return found

    bag.info(path, tell=tell)
    assert taken() == [(50, 122), (100, 122)]
    bag.check(path, tell=tell)
    assert taken()[-3:] == [(size - _after_data(path), size), (50, 122), (100, 122)]
    bag.merge([path, path], tmp_path / "both.mcap", "none", tell=tell)
    assert taken() == [(done, 244) for done in (50, 100, 150, 200)]
    bag.cut(path, tmp_path / "part.mcap", START, compression="none", tell=tell)
    assert taken() == [(50, 0), (100, 0)], "of how much is not known"
    bag.diff(path, path, tell=tell)
    assert taken() == [(50, 122), (100, 122)]
    bag.recover(path, tmp_path / "whole.mcap", tell=tell)
    found = taken()
    assert {total for _, total in found} == {2 * size}
    assert [done for done, _ in found] == sorted(done for done, _ in found)


def _after_data(path: Path) -> int:
    """Bytes from the end of the data on."""
    data = path.read_bytes()
    return len(data) - next(begin for kind, begin, _ in bags.records_of(data) if kind == mcap.DATA_END)
