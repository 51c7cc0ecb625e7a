"""Topics of one name: several types, several definitions of one, names that collide, and names with slashes."""

from pathlib import Path

import pytest

from robo import bag
from robo.bag.forms.json_lines import from_json_lines, to_json_lines
from robo.bag.mcap import format as mcap
from robo.bag.mcap.file_writer import FileWriter
from robo.bag.types import topic_of
from robo_messages import String, Twist
from tests import bags
from tests.bags import START

PLAIN = bag.Options(compression="none", sync=False)
TEXT = topic_of("t", Twist).text

Channel = tuple[str, str, str, str, bytes]
"""A topic, its type, how that is defined, how its messages are encoded, and its definition."""


def written(path: Path, *channels: Channel) -> None:
    """A file with two messages of each channel."""
    with path.open("wb") as file:
        writer = FileWriter(file)
        for number, (topic, schema, kind, encoding, data) in enumerate(channels, 1):
            writer.add_schema(mcap.Schema(number, schema, kind, data))
            writer.add_channel(mcap.Channel(number, number, topic, encoding, {}))
        for place in range(2):
            for number in range(1, len(channels) + 1):
                writer.add_message(number, place + 1, START + place, START, bags.twist(number))
        writer.finish()


def said(path: Path) -> dict[str, list[bytes]]:
    with bag.open(path) as opened:
        return {name: [message.data for message in opened.messages(name)] for name in opened.topics}


COLLIDING: list[Channel] = [
    ("/t", "a/msg/S", "ros2msg", "cdr", b"float64 x\n"),
    ("/t", "a/msg/S", "ros2idl", "cdr", b"struct"),
    ("/t", "a/msg/S", "ros2msg", "json", b"float64 x\n"),
    ("/t (a/msg/S)", "a/msg/S", "protobuf", "cdr", b"\xff\xfe\x00"),
    ("//u", "a/msg/S", "ros2msg", "cdr", b"float64 x\n"),
]


def test_topics_of_one_name_have_names_of_their_own_whatever_is_done_with_them(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    written(path, *COLLIDING)
    names = ["t", "t (a/msg/S)", "t (a/msg/S) 2", "t (a/msg/S) (a/msg/S)", "u"]
    with bag.open(path) as opened:
        assert [*opened.topics] == names
        assert [topic.own_name for topic in opened.topics.values()] == ["t", "t", "t", "t (a/msg/S)", "u"]
        assert opened.topic("//u") is opened.topic("/u") is opened.topic("u")
    assert sorted(map(len, said(path).values())) == [2] * 5
    assert bag.info(path).count == 10
    assert bag.check(path).messages == 10
    assert bag.diff(path, path).same
    assert bag.keep(path, tmp_path / "b.mcap", lambda _: True, "none").messages == 10
    assert said(tmp_path / "b.mcap") == said(path)
    with bag.open(path) as opened:
        to_json_lines(opened, tmp_path / "a.jsonl")
    from_json_lines(tmp_path / "a.jsonl", tmp_path / "c.mcap", "none")
    assert said(tmp_path / "c.mcap") == said(path)
    with bag.open(path) as opened, bag.open(tmp_path / "c.mcap") as other:
        schemas = [{(one.name, one.encoding, one.data) for one in each.files.indexes[0].schemas.values()}
                   for each in (opened, other)]  # fmt: skip
        assert schemas[0] == schemas[1], "also definitions that are no text"


def test_json_lines_keep_the_name_of_a_topic_with_two_types(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with bag.Recording(path, PLAIN) as recording:
        recording.write(recording.topic(topic_of("t", Twist)), bags.twist(1), START, START, 1)
        recording.write(recording.topic(topic_of("t", String)), b"\0\1\0\0\1\0\0\0\0", START + 1, START, 1)
    with bag.open(path) as opened:
        to_json_lines(opened, tmp_path / "a.jsonl")
    from_json_lines(tmp_path / "a.jsonl", tmp_path / "b.mcap", "none")
    with bag.open(tmp_path / "b.mcap") as opened:
        assert [channel.topic for channel in opened.files.indexes[0].channels.values()] == ["/t", "/t"]
    assert said(tmp_path / "b.mcap") == said(path)


def test_two_definitions_of_a_type_stay_two(tmp_path: Path) -> None:
    one, other, both = tmp_path / "a.mcap", tmp_path / "b.mcap", tmp_path / "c.mcap"
    written(one, ("/t", "a/msg/S", "ros2msg", "cdr", b"float64 x\n"))
    written(other, ("/t", "a/msg/S", "ros2msg", "cdr", b"float32 x\n"))
    bag.merge([one, other], both, "none")
    with bag.open(both) as opened:
        assert {name: topic.text for name, topic in opened.topics.items()} == {
            "t": "float32 x\n", "t (a/msg/S)": "float64 x\n",
        }  # fmt: skip


def test_a_definition_that_robo_has_not_is_not_read_as_robos(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    twist = "geometry_msgs/msg/Twist"
    written(
        path,
        ("/t", twist, "ros2msg", "cdr", TEXT.encode()),
        ("/t", twist, "ros2msg", "cdr", b"float32 x\n"),
    )
    with bag.open(path) as opened:
        assert sorted(bool(topic.unknown) for topic in opened.topics.values()) == [False, True]
        for message in opened.messages():
            assert isinstance(message.value, bytes) == bool(message.topic.unknown)


@pytest.mark.parametrize("more", ["", "# of another version of ROS\n"])
def test_definitions_that_say_the_same_are_one(more: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    twist = "geometry_msgs/msg/Twist"
    written(
        path,
        ("/t", twist, "ros2msg", "cdr", TEXT.encode()),
        ("/t", twist, "ros2msg", "cdr", (more + TEXT).encode()),
    )
    with bag.open(path) as opened:
        assert [(name, topic.count, topic.unknown) for name, topic in opened.topics.items()] == [("t", 4, "")]
