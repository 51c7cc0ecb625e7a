"""Which topics of a recording are played, and under which names; which keys steer it; what its line says."""

from pathlib import Path

import pytest

from robo import bag
from robo.bag.read.topics import Topic
from robo.bag.types import of_robo, topic_of
from robo.cli.views.bag_keys import Decoder, far_away, next_rate, status_line
from robo.errors import BagError, UsageError
from robo.recording.play.player import State
from robo.recording.play.topics import Choice, select
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import String, Twist

ROBOT = ("r1/odom", "r1/arm/grip", "r1/tf", "clock")
ROS = ("odom", "camera/image", "tf", "clock")
CAMERA = ("camera/image", "camera/info")
FLEET = ("r1/odom", "r1/scan", "r2/odom", "r2/scan")


def topics(*names: str, count: int = 1, qos: QoS = QoS.DEFAULT) -> dict[str, Topic]:
    known = of_robo("std_msgs/msg/String")
    return {
        name: Topic(name, "std/String", "std_msgs/msg/String", "", "cdr", count, qos, "", frozenset(), known)
        for name in names
    }


def keys(names: tuple[str, ...], choice: Choice, robots: list[str] | None = None) -> dict[str, str]:
    found = select(topics(*names), choice, "drive.mcap", robots)
    return {one.topic.name: one.key for one in found.played}


@pytest.mark.parametrize(
    ("names", "choice", "expected"),
    [
        (ROBOT, Choice(), list(ROBOT)),
        (ROBOT, Choice(robot="r2"), ["r2/odom", "r2/arm/grip", "r2/tf", "clock"]),
        (ROBOT, Choice(robot="fleet/r2"), ["fleet/r2/odom", "fleet/r2/arm/grip", "fleet/r2/tf", "clock"]),
        (ROS, Choice(), list(ROS)),
        (ROS, Choice(robot="r2"), ["r2/odom", "r2/camera/image", "r2/tf", "clock"]),
        (ROBOT, Choice(topics=["odom", "clock"]), ["r1/odom", "clock"]),
        (ROBOT, Choice(topics=["r1/**"], exclude=["arm/*"]), ["r1/odom", "r1/tf"]),
        (ROBOT, Choice(topics=["/r1/t*"]), ["r1/tf"]),
        (ROBOT, Choice(exclude=["clock"], remap=["odom:=odom_before"]), ["r1/odom_before", "r1/arm/grip", "r1/tf"]),
        (ROBOT, Choice(topics=["odom"], remap=["odom:=/odom"]), ["odom"]),
        (ROBOT, Choice(topics=["odom"], remap=["odom:=old"], robot="r2"), ["r2/old"]),
        (ROBOT, Choice(topics=["odom"], remap=["odom:=r2/old"], robot="r2"), ["r2/old"]),
        (ROBOT, Choice(topics=["odom"], remap=["r1/odom:=r3/old"], robot="r2"), ["r3/old"]),
        (ROBOT, Choice(exclude=["clock"], remap=["r1/**:=a/b/**"]), ["a/b/odom", "a/b/arm/grip", "a/b/tf"]),
        (ROBOT, Choice(topics=["**/grip"], remap=["arm/**:=hand/**"], robot="r2"), ["r2/hand/grip"]),
        (ROS, Choice(topics=["/camera/*"], remap=["/camera/image:=/r1/image"]), ["r1/image"]),
        (ROS, Choice(topics=["odom", "tf"], remap=["tf:=old"], robot="r2"), ["r2/odom", "r2/old"]),
        (ROS, Choice(topics=["odom", "tf"], remap=["/tf:=/old"], robot="r2"), ["r2/odom", "old"]),
        (CAMERA, Choice(robot="r2"), ["r2/camera/image", "r2/camera/info"]),
        (FLEET, Choice(topics=["r1/**"], robot="r3"), ["r3/odom", "r3/scan"]),
        (FLEET, Choice(exclude=["r2/*"], robot="r3"), ["r3/odom", "r3/scan"]),
        (FLEET, Choice(remap=["r1/**:=/r3/**"]), ["r3/odom", "r3/scan", "r2/odom", "r2/scan"]),
        (("r1/odom", "rosout"), Choice(robot="r2"), ["r2/odom", "rosout"]),
        (ROBOT, Choice(topics=["odom", "tf"], remap=["odom:=all", "tf:=all"]), ["r1/all", "r1/all"]),
        (ROBOT, Choice(topics=["odom"], remap=["/r1/odom:=x"]), ["x"]),
    ],
)
def test_topics_and_their_names(names: tuple[str, ...], choice: Choice, expected: list[str]) -> None:
    assert list(keys(names, choice).values()) == expected


def test_a_recording_that_names_its_robot_is_believed() -> None:
    mixed = ("r1/odom", "chatter", "r3/odom")
    assert keys(mixed, Choice(robot="r2"), ["r1"]) == {"r1/odom": "r2/odom", "chatter": "chatter", "r3/odom": "r3/odom"}
    assert keys(("camera/image",), Choice(robot="r2"), ["camera"]) == {"camera/image": "r2/image"}
    assert keys(("camera/image",), Choice(robot="r2"), []) == {"camera/image": "r2/image"}, "robo has namespaces"


@pytest.mark.parametrize("robots", [None, ["r1", "r2"], ["unheard_of"]])
def test_several_robots_do_not_become_one(robots: list[str] | None) -> None:
    with pytest.raises(UsageError, match=r"it has r1 and r2, which cannot all be r3: .*--remap 'r1/\*\*:=/r3/\*\*'"):
        keys(FLEET, Choice(robot="r3"), robots)
    with pytest.raises(UsageError, match=r"r1/odom .* and r2/odom .* would both be published on r2/odom"):
        keys(FLEET, Choice(topics=["*/odom"], remap=["r1/**:=/r2/**"]), robots)


def test_what_nodes_say_of_themselves_is_played_where_it_is_named() -> None:
    said = ("r1/odom", "r1/log", "r1/diagnostics", "r1/parameter_events", "r1/flight_snapshots")
    found = select(topics(*said), Choice(), "drive.mcap")
    assert ([one.key for one in found.played], found.left) == (["r1/odom"], list(said[1:]))
    assert list(keys(said, Choice(topics=["log", "odom"]))) == ["r1/odom", "r1/log"]
    with pytest.raises(BagError, match="--topics r1/log plays what nodes said"):
        keys(("r1/log",), Choice())


@pytest.mark.parametrize(
    ("choice", "text"),
    [
        (Choice(topics=["odm"]), "--topics odm: no topic matches; did you mean r1/odom"),
        (Choice(exclude=["no way"]), "--exclude no way: no topic matches"),
        (Choice(topics=["a//b"]), "topic 'a//b' makes no sense"),
        (Choice(exclude=["**"]), "no topic is left"),
        (Choice(remap=["odom"]), "write OLD:=NEW"),
        (Choice(remap=["r1/*:=r2/odom"]), "write OLD:=NEW"),
        (Choice(remap=["odom:="]), "--remap odom:="),
        (Choice(remap=["scan:=x"]), "--remap scan:=x: no topic matches"),
        (Choice(remap=["odom:=x", "odom:=y"]), "--remap odom:=y: one that stands before it holds for all"),
        (Choice(remap=["/odom:=x"]), "--remap /odom:=x: no topic matches"),
    ],
)
def test_words_that_make_no_sense(choice: Choice, text: str) -> None:
    with pytest.raises(UsageError) as caught:
        keys(ROBOT, choice)
    assert text in str(caught.value)


def test_nothing_to_play_is_an_error() -> None:
    with pytest.raises(BagError, match="it is empty"):
        select({}, Choice(), "drive.mcap")
    with pytest.raises(BagError, match="no message is in it"):
        select(topics("odom", count=0), Choice(), "drive.mcap")
    some = topics("odom", count=0) | topics("scan")
    with pytest.raises(BagError, match="no message of odom"):
        select(some, Choice(topics=["odom"]), "drive.mcap")


def test_what_is_no_name_is_left_out() -> None:
    found = select(topics("odom", "my topic", "a//b", "x*", "", "y" * 1000, "@robo/r1/output"), Choice(), "drive.mcap")
    assert [one.key for one in found.played] == ["odom"]
    assert found.nameless == ["my topic", "a//b", "x*", "", "y" * 1000, "@robo/r1/output"]
    with pytest.raises(BagError, match="my topic is no name of a topic"):
        select(topics("my topic"), Choice(), "drive.mcap")


@pytest.mark.parametrize("name", ["my topic", "a//b", "x*", "", "y" * 1000, "@robo/r1/output", "~x"])
def test_what_is_no_name_gets_one(name: str) -> None:
    assert keys((name, "odom"), Choice(remap=[f"{name}:=mine"])) == {name: "mine", "odom": "odom"}


@pytest.mark.parametrize("name", ["arm/*", "arm/x#y", "arm/a//b", "arm/**", "arm/a b", "arm/" + "y" * 600])
def test_what_is_no_name_is_none_within_another_name_either(name: str) -> None:
    found = select(topics(name, "arm/grip"), Choice(remap=["arm/**:=hand/**"]), "drive.mcap")
    assert ([one.key for one in found.played], found.nameless) == (["hand/grip"], [name])


@pytest.mark.parametrize(
    ("encoding", "schema", "expected"),
    [
        ("cdr", "arm_msgs/msg/Grip", "application/cdr;arm_msgs/msg/Grip"),
        ("json", "", "application/json"),
        ("msgpack", "my_robot/Grip", "application/msgpack;my_robot/Grip"),
        ("application/cdr", "arm_msgs/msg/Grip", "application/cdr;arm_msgs/msg/Grip"),
        ("video/h264", "", "video/h264"),
        ("", "", "application/octet-stream"),
        ("cdr", "x" * 1000, "application/cdr"),
        ("cdr", "a\nb", "application/cdr"),
        ("x" * 1000, "Grip", "application/octet-stream"),
    ],
)
def test_what_is_said_of_bytes(encoding: str, schema: str, expected: str) -> None:
    topic = Topic("a", schema, schema, "", encoding, 1, QoS.DEFAULT, "unknown", frozenset(), None)
    (played,) = select({"a": topic}, Choice(), "drive.mcap").played
    assert played.encoding == expected, "Zenoh ends where it is longer than 255 bytes"
    assert played.type == ("my_robot/Grip" if encoding == "msgpack" else "")


def test_two_topics_do_not_become_one_of_two_types(tmp_path: Path) -> None:
    with bag.Recording(tmp_path / "two.mcap", bag.Options(compression="none", sync=False)) as recording:
        for name, type_ in (("a", String), ("b", Twist)):
            recording.write(recording.topic(topic_of(name, type_)), b"", 1, 1)
    with bag.open(tmp_path / "two.mcap") as opened, pytest.raises(UsageError, match="would both be published on b"):
        select(opened.topics, Choice(remap=["a:=b"]), "two.mcap")


def test_what_was_latched_is_and_all_go_at_one_priority() -> None:
    latched = select(topics("map", qos=QoS.LATCHED), Choice(), "drive.mcap").played[0].qos
    assert latched == QoS(depth=1, latched=True)
    endless = QoS(depth=KEEP_ALL, latched=True)
    assert select(topics("map", qos=endless), Choice(), "drive.mcap").played[0].qos.depth == 1000
    assert select(topics("cmd_vel", qos=QoS.COMMAND), Choice(), "drive.mcap").played[0].qos == QoS(depth=KEEP_ALL)


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([b" ", b".n"], ["pause", "step", "next"]),
        ([b"\x1b[C\x1b[D"], ["ahead", "back"]),
        ([b"\x1b", b"[", b"5", b"~q"], ["far ahead", "quit"]),
        ([b"\x1bOA\x1bOB"], ["faster", "slower"]),
        ([b"+=-"], ["faster", "faster", "slower"]),
        ([b"\x1b[1;5C", b"xyz", b"\xff"], []),
        ([b"\x1b[200~" + b"9" * 40, b" "], ["pause"]),
        ([b"\x1b\x1b[C"], ["ahead"]),
    ],
)
def test_keys(parts: list[bytes], expected: list[str]) -> None:
    decoder = Decoder()
    assert [key for part in parts for key in decoder.keys(part)] == expected


def test_rates_that_keys_choose() -> None:
    assert [next_rate(rate, faster=True) for rate in (1.0, 0.7, 100.0, 500.0, 0.0)] == [2.0, 1.0, 100.0, 500.0, 0.0]
    assert [next_rate(rate, faster=False) for rate in (1.0, 0.7, 0.01, 500.0, 0.0)] == [0.5, 0.5, 0.01, 100.0, 100.0]


@pytest.mark.parametrize(
    ("coming", "rate", "text"),
    [
        (9, 1.0, None),
        (11, 1.0, "nothing for 11 s of the recording"),
        (11, 2.0, None),
        (11, 0.0, None),
        (19_675 * 86_400, 1.0, "nothing for 19,675 days of the recording: its clock was set there"),
        (None, 1.0, None),
    ],
)
def test_a_long_time_of_nothing_is_told(coming: int | None, rate: float, text: str | None) -> None:
    state = State(10**9, rate, False, 1, None if coming is None else (1 + coming) * 10**9)
    assert far_away(state) == text
    assert far_away(state._replace(paused=True)) is None


@pytest.mark.parametrize("width", [0, 10, 60, 140])
def test_the_line_fits(width: int) -> None:
    state = State(5_250_000_000, 2.0, False, 12_345)
    line = status_line(state, 0, 60_000_000_000, width)
    assert len(line) < max(width, 1)
    if width >= 60:
        assert line.startswith("playing     5.25 of 60.00 s  x2  12,345 messages")
    assert ("space pause" in line) == (width == 140)
