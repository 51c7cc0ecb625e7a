"""Recordings of robo's in what others read with, and theirs in robo, where that is installed.

pip install rosbags mcap mcap-ros2-support
"""

import warnings
from pathlib import Path
from typing import Any

import pytest

from robo import bag
from robo_messages import LaserScan, Odometry, String, TFMessage, Twist
from tests import bags
from tests.bags import MS, START

FORMS = {
    "whole": bag.Options(compression="none", sync=False, chunk_size=2_000),
    "zstd": bag.Options(compression="zstd", chunk_size=2_000),
    "split": bag.Options(compression="zstd", split_duration=0.4),
}


def made(form: str, folder: Path) -> Path:
    if form != "whole" and not bags.readable("zstd"):
        pytest.skip("needs the extra record")
    path = folder / ("run" if form == "split" else "drive.mcap")
    bags.drive(path, FORMS[form])
    return path


def rosbags() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own parts
        return pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")


@pytest.mark.parametrize("form", FORMS)
def test_rosbags_reads_what_robo_wrote(form: str, tmp_path: Path) -> None:
    reader = rosbags()
    from rosbags.typesys import Stores, get_typestore  # type: ignore[import-not-found, unused-ignore]

    path = made(form, tmp_path)
    store = get_typestore(Stores.ROS2_JAZZY)
    with reader.AnyReader([path], default_typestore=store) as opened:
        topics = {connection.topic: connection for connection in opened.connections}
        assert {name: connection.msgtype for name, connection in topics.items()} == {
            "/r1/cmd_vel": "geometry_msgs/msg/Twist",
            "/r1/odom": "nav_msgs/msg/Odometry",
            "/r1/scan": "sensor_msgs/msg/LaserScan",
            "/r1/tf_static": "tf2_msgs/msg/TFMessage",
        }
        for connection in topics.values():
            if form != "split":  # of a folder it reads metadata.yaml
                assert connection.digest in ("", store.hash_rihs01(connection.msgtype))
        assert topics["/r1/tf_static"].ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        again = 2 * 2 if form == "split" else 0  # what is latched, in each file
        assert opened.message_count in (122, 122 + again)
        found: dict[str, list[Any]] = {}
        for connection, at, data in opened.messages():
            found.setdefault(connection.topic, []).append((at, store.deserialize_cdr(data, connection.msgtype)))
    assert [at for at, _ in found["/r1/cmd_vel"]] == [START + MS + step * 10 * MS for step in range(100)]
    assert [command.linear.x for _, command in found["/r1/cmd_vel"]] == [step / 10 for step in range(100)]
    assert [where.pose.pose.position.x for _, where in found["/r1/odom"]] == [step / 10 for step in range(10)]
    assert list(found["/r1/scan"][0][1].ranges) == [1.0, 2.0, float("inf")]
    assert [one.transforms[0].child_frame_id for _, one in found["/r1/tf_static"]][:2] == ["base", "laser"]


@pytest.mark.parametrize("form", ["whole", "zstd"])
def test_mcap_reads_what_robo_wrote(form: str, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    path = made(form, tmp_path)
    with path.open("rb") as file:
        opened = reader.make_reader(file, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
        summary = opened.get_summary()
        assert summary.statistics.message_count == 122
        assert opened.get_header().profile == "ros2"
        decoded = list(opened.iter_decoded_messages())
        assert len(decoded) == 122
        commands = [one for one in decoded if one.channel.topic == "/r1/cmd_vel"]
        assert [one.decoded_message.linear.x for one in commands] == [step / 10 for step in range(100)]
        assert [(one.message.publish_time, one.message.sequence) for one in commands] == [
            (START + step * 10 * MS, step + 1) for step in range(100)
        ]
        part = list(opened.iter_messages("/r1/odom", starting_at=START + 500 * MS, ending_before=START + 600 * MS))
        assert len(part) == 1
        (attachment,) = opened.iter_attachments()
        assert (attachment.name, attachment.data) == ("manifest.yaml", b"nodes: {}\n")
        assert {one.name for one in opened.iter_metadata()} == {"robo", "robo.counts"}
    with path.open("rb") as file:  # from the beginning to the end, every checksum, without the summary
        stream = reader.NonSeekingReader(file, validate_crcs=True)
        assert sum(1 for _ in stream.iter_messages(log_time_order=False)) == 122


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
@pytest.mark.parametrize("chunked", [True, False])
def test_robo_reads_what_mcap_wrote(compression: str, chunked: bool, tmp_path: Path) -> None:
    writer = pytest.importorskip("mcap.writer", reason="mcap is not installed")
    if compression != "NONE" and not bags.readable(compression.lower()):
        pytest.skip("needs the extra record")
    from robo.bag.types import topic_of

    path = tmp_path / "drive.mcap"
    topic = topic_of("cmd_vel", Twist)
    with path.open("wb") as file:
        kind = writer.CompressionType[compression]
        made = writer.Writer(file, chunk_size=1_000, compression=kind, use_chunking=chunked)
        made.start("ros2", "test")
        schema = made.register_schema(topic.schema, "ros2msg", topic.text.encode())
        channel = made.register_channel("/cmd_vel", "cdr", schema)
        for step in range(100):
            made.add_message(channel, START + step * MS, bags.twist(step), START + step * MS, step + 1)
        made.add_attachment(START, START, "map.yaml", "text/yaml", b"image: map.png")
        made.add_metadata("robot", {"name": "r1"})
        made.finish()
    assert bag.check(path).findings == []
    with bag.open(path) as opened:
        assert opened.count == 100
        assert [message.value.linear.x for message in opened.messages() if isinstance(message.value, Twist)] == [
            float(step) for step in range(100)
        ]
        assert opened.attachment("map.yaml") == b"image: map.png"
        assert opened.metadata == {"robot": {"name": "r1"}}
    (info,) = bag.info(path).topics
    assert (info.lost, info.type) == (0, "geometry/Twist")


def test_robo_reads_a_folder_of_ros2_bag(tmp_path: Path) -> None:
    rosbags()
    from rosbags.rosbag2 import StoragePlugin, Writer  # type: ignore[import-not-found, unused-ignore]
    from rosbags.typesys import Stores, get_typestore  # type: ignore[import-not-found, unused-ignore]

    store = get_typestore(Stores.ROS2_JAZZY)
    twist, vector = store.types["geometry_msgs/msg/Twist"], store.types["geometry_msgs/msg/Vector3"]
    strange = "strange_msgs/msg/Thing"
    path = tmp_path / "ros"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        commands = writer.add_connection("/cmd_vel", "geometry_msgs/msg/Twist", typestore=store)
        from rosbags.typesys import get_types_from_msg

        store.register(get_types_from_msg("float64 value\n", strange))
        things = writer.add_connection("/thing", strange, typestore=store)
        for step in range(50):
            message = twist(vector(float(step), 0.0, 0.0), vector(0.0, 0.0, 0.0))
            writer.write(commands, START + step * MS, store.serialize_cdr(message, "geometry_msgs/msg/Twist"))
            writer.write(things, START + step * MS, store.serialize_cdr(store.types[strange](1.5), strange))
    with bag.open(path) as opened:
        assert {topic.name: (topic.type, topic.count) for topic in opened.topics.values()} == {
            "cmd_vel": ("geometry/Twist", 50),
            "thing": (strange, 50),
        }
        assert opened.topics["thing"].unknown == f"robo has no type '{strange}'"
        assert list(opened.column("cmd_vel", "linear.x")) == list(range(50))
    assert bag.check(path).whole


@pytest.mark.parametrize("type_", [LaserScan, Odometry, String, TFMessage, Twist])
def test_definitions_of_ros_are_robos(type_: type) -> None:
    rosbags()
    from rosbags.typesys import Stores, get_typestore  # type: ignore[import-not-found, unused-ignore]

    from robo.bag.definitions import differs
    from robo.bag.types import topic_of

    topic = topic_of("any", type_)
    text, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(topic.schema, ros_version=2)
    assert differs(topic.schema, text, topic.text) == ""
