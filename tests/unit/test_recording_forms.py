"""What a recording makes of messages: CDR where it can, else their bytes; what is malformed is said by name."""

import msgspec
import pytest

import robo_messages
from robo.interfaces import cdr
from robo.recording.forms import form_of, zenoh_encoding
from robo.wire.codec import Malformed, encoding_of
from robo.wire.qos import QoS
from robo_messages import Header, LaserScan, Odometry, String, Time, Twist, Vector3


def test_known_types_become_cdr() -> None:
    form = form_of("r1/cmd_vel", encoding_of(Twist), QoS.COMMAND)
    twist = Twist(linear=Vector3(x=0.5))
    assert form.topic.schema == "geometry_msgs/msg/Twist"
    assert (form.topic.encoding, form.topic.schema_encoding) == ("cdr", "ros2msg")
    assert form.topic.qos == QoS.COMMAND
    assert form.unknown == ""
    assert cdr.decoder(Twist)(form.write(robo_messages.encode(twist))) == twist


def test_json_becomes_cdr_too() -> None:
    form = form_of("r1/cmd_vel", "application/json;geometry/Twist")
    assert cdr.decoder(Twist)(form.write(b'{"linear": {"x": 0.5}}')).linear.x == 0.5
    # Whatever it says that it is, nodes read both.
    form = form_of("r1/cmd_vel", encoding_of(Twist))
    assert cdr.decoder(Twist)(form.write(b'{"linear": {"x": 0.5}}')).linear.x == 0.5


@pytest.mark.parametrize("encoding", ["zenoh/bytes", "application/msgpack", ""])
def test_a_message_that_says_no_type_is_of_the_one_that_nodes_announce(encoding: str) -> None:
    form = form_of("r1/cmd_vel", encoding, announced="geometry/Twist")
    assert cdr.decoder(Twist)(form.write(robo_messages.encode(Twist()))) == Twist()


@pytest.mark.parametrize(
    ("encoding", "written", "schema", "why"),
    [
        ("application/msgpack;nobody/Has", "msgpack", "nobody/Has", "type nobody/Has is not known here"),
        ("application/json", "json", "", "nobody says what type"),
        ("image/png", "image/png", "", "are in 'image/png'"),
        ("zenoh/bytes", "zenoh/bytes", "", "nobody says what type"),
        ("application/x;own", "application/x", "own", "are in 'application/x'"),
        ("cdr", "zenoh/cdr", "", "are in 'cdr'"),
    ],
)
def test_others_stay_the_bytes_that_they_are(encoding: str, written: str, schema: str, why: str) -> None:
    form = form_of("r1/odd", encoding)
    assert (form.topic.encoding, form.topic.schema, form.topic.text) == (written, schema, "")
    assert why in form.unknown
    assert form.write(b"\xff\x00") == b"\xff\x00"
    if written != "zenoh/cdr":
        assert zenoh_encoding(form.topic.encoding, form.topic.schema) == encoding


def test_a_type_that_raises_costs_its_own_topic_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(_: str) -> None:
        raise FileNotFoundError("no such folder")

    monkeypatch.setattr("robo.interfaces.catalogue.find_here", gone)
    form = form_of("r1/cmd_vel", encoding_of(Twist))
    assert form.unknown == "its type geometry/Twist cannot be used: FileNotFoundError: no such folder"
    assert form.topic.encoding == "msgpack"


def test_names_of_strangers_are_bounded() -> None:
    form = form_of("r1/odd", f"application/msgpack;{'x' * 100_000}")
    assert len(form.topic.schema) < 300
    assert len(form.unknown) < 400


def test_what_is_no_message_of_its_type_is_malformed() -> None:
    form = form_of("r1/cmd_vel", encoding_of(Twist))
    with pytest.raises(Malformed, match="not a geometry/Twist in MessagePack"):
        form.write(b"\x01")
    with pytest.raises(Malformed, match="not a geometry/Twist in MessagePack"):
        form.write(robo_messages.encode(String("text")))
    with pytest.raises(Malformed, match="not a geometry/Twist in JSON"):
        form.write(b'{"linear": 1}')


def test_what_ros_cannot_have_is_malformed_and_names_the_field() -> None:
    scan = robo_messages.find_type("sensor/LaserScan")
    form = form_of("r1/scan", encoding_of(scan))
    message = msgspec.convert({"angle_min": 1e300}, scan)
    with pytest.raises(Malformed, match=r"ROS cannot have it: .*angle_min"):
        form.write(robo_messages.encode(message))


def test_every_type_that_ships_becomes_cdr() -> None:
    for name in robo_messages.type_names():
        type_ = robo_messages.find_type(name)
        form = form_of("topic", encoding_of(type_))
        assert form.unknown == "", name
    assert form_of("odom", encoding_of(Odometry)).topic.schema == "nav_msgs/msg/Odometry"


def test_long_scans_are_written_as_short_ones_are() -> None:
    pytest.importorskip("numpy")
    form = form_of("r1/scan", encoding_of(LaserScan))
    for rays in (1, 100, 2_000):
        scan = LaserScan(Header(Time(5, 6), "laser"), 0.5, ranges=[float(n) for n in range(rays - 1)] + [float("inf")])
        assert form.write(robo_messages.encode(scan)) == cdr.encoder(LaserScan)(scan)
        assert form.write(robo_messages.encode_json(scan)) == cdr.encoder(LaserScan)(scan)
    broken = LaserScan(ranges=[1e300] * 2_000)
    with pytest.raises(Malformed, match="ranges"):
        form.write(robo_messages.encode(broken))
    with pytest.raises(Malformed, match="not a sensor/LaserScan"):
        form.write(robo_messages.encode(LaserScan(ranges=[0.0] * 2_000))[:-1])
