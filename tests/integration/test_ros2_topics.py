"""Topics between robo and ROS 2, over the wire of rmw_zenoh: both ways, typed, latched, and never round in a circle."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from robo import Node, Publisher, subscribe
from robo.errors import RunError, UsageError
from robo.launch.plan import CrossingPlan
from robo.samples.publishing import Sender
from robo.wire.keys import NodeToken
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Odometry, String, Twist, Vector3, encode
from tests.support import eventually

xxhash = pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from robo.bridges.ros2 import type_questions  # noqa: E402 (its library may be missing)
from robo.bridges.ros2.descriptions import (  # noqa: E402
    Field,
    FieldType,
    GetTypeDescription,
    IndividualTypeDescription,
    TypeDescription,
    difference,
)
from tests.ros2 import Both, Heard, RosHeard, RosNode  # noqa: E402

pytestmark = pytest.mark.timeout(120)
_TWIST = [Field(name, FieldType(1, nested_type_name="geometry_msgs/msg/Vector3")) for name in ("linear", "angular")]


@pytest.fixture
def both() -> Iterator[Both]:
    with ExitStack() as stack:
        yield Both(stack)


def sees_bridge(node: RosNode) -> bool:
    return any("ros2_bridge" in one for one in node.tokens())


def has_both_ends(heard: Any) -> bool:
    return [one.data for one in heard.messages].count("end") == 2


def has_end(node: RosNode, kind: str, topic: str) -> bool:
    return any(kind in one and topic in one for one in node.tokens())


class Base(Node):
    odom = Publisher(Odometry, "odom")
    kind = Publisher(String, "kind", latched=True)


def test_what_robo_publishes_is_heard_in_ros_from_its_own_node(both: Both) -> None:
    ros = both.ros("listener")
    heard = ros.hear(Odometry, "/odom")
    both.bridge(topics={"odom": CrossingPlan(ros="/odom")})
    with Base(namespace="r1", session=both.robo) as base:
        eventually(lambda: has_end(ros, "/MP/", "%odom"), "the publisher is announced")
        base.odom.publish(Odometry(child_frame_id="base"))
        assert heard.wait()[0].child_frame_id == "base"
        number, said, _, gid = heard.stamps[0]
        assert number == 1
        assert abs(time.time_ns() - said) < 60e9
        tokens = ros.tokens()
        assert any(one.endswith("/NN/%/%r1/base") for one in tokens), tokens
        mine = [one for one in tokens if "/MP/%/%r1/base/%odom/nav_msgs::msg::dds_::Odometry_/" in one]
        assert len(mine) == 1
        assert xxhash.xxh3_128_intdigest(mine[0].encode()).to_bytes(16, "little") == gid
    eventually(lambda: not [one for one in ros.tokens() if one.endswith("/base")], "its node is gone in ROS, too")


def test_what_ros_publishes_is_heard_in_robo_from_the_bridge(both: Both) -> None:
    both.bridge(topics={"words": CrossingPlan(ros="/chatter", direction="from_ros")})
    heard = both.heard("/r1/words", String)
    publisher = both.ros().publisher(String, "/chatter")
    for number in range(20):
        publisher.publish(String(f"hello {number}"))
    assert [one.data for one in heard.wait(20)] == [f"hello {number}" for number in range(20)]


def test_one_word_of_a_publisher_that_comes_and_goes_crosses_both_ways(both: Both) -> None:
    both.bridge(topics={"words/*": CrossingPlan(ros="/words/*", direction="both")})
    in_robo = [both.heard(f"/r1/words/a{number}", String) for number in range(5)]
    ear = both.ros("ear")
    in_ros = [ear.hear(String, f"/words/b{number}") for number in range(5)]
    for number in range(5):
        node = RosNode(both.ros_at, f"once_{number}")
        eventually(partial(sees_bridge, node), "it sees the graph")
        node.publisher(String, f"/words/a{number}").publish(String(f"a{number}"))
        node.close()
        session = open_session(Network(mode="client", connect=(both.robo_at,)))
        sender = Sender(session, f"r1/words/b{number}", "std/String")
        assert sender.wait_for_subscriber(20.0)
        sender.send(encode(String(f"b{number}")))
        sender.close()
        close_session(session)
    for number in range(5):
        assert [one.data for one in in_robo[number].wait()] == [f"a{number}"]
        assert [one.data for one in in_ros[number].wait()] == [f"b{number}"]


def test_who_comes_later_gets_what_was_latched_both_ways(both: Both) -> None:
    both.bridge(topics={"**": CrossingPlan(ros="/**", direction="both")})
    ros = both.ros("mapper")
    publisher = ros.publisher(String, "/map_name", latched=1)
    publisher.publish(String("old"))
    publisher.publish(String("hall"))
    with Base(namespace="r1", session=both.robo) as base:
        base.kind.publish(String("kitchen"))
        late = both.ros("late").hear(String, "/kind", latched=1)
        assert [one.data for one in late.wait()] == ["kitchen"]

        class Late(Node):
            @subscribe("map_name", latched=True)
            def hear(self, message: String) -> None:
                found.append(message.data)

        found: list[str] = []
        with Late(name="late", namespace="r1", session=both.robo):
            eventually(lambda: found == ["hall"], "the latched message of ROS")
        again: list[str] = []
        found = again
        with Late(name="later", namespace="r1", session=both.robo):
            eventually(lambda: again == ["hall"], "and once more")


def test_nothing_goes_round_in_a_circle(both: Both) -> None:
    bridge = both.bridge(topics={"**": CrossingPlan(ros="/**", direction="both")})
    ros = both.ros()
    in_robo, in_ros = both.heard("/r1/words", String), ros.hear(String, "/words")
    publisher = ros.publisher(String, "/words")
    sender = Sender(both.robo, "r1/words", "std/String")
    assert sender.wait_for_subscriber(20.0)
    for number in range(50):
        publisher.publish(String(f"ros {number}"))
        sender.send(encode(String(f"robo {number}")))
    # Each hears either side once: what comes back would be a third message.
    publisher.publish(String("end"))
    sender.send(encode(String("end")))
    for heard in (in_robo, in_ros):
        eventually(partial(has_both_ends, heard), "both ends")
        assert len(heard.messages) == 102
    counts = {one.way: one.crossed for one in bridge.status().topics if one.key == "r1/words"}
    assert counts == {"to_ros": 51, "from_ros": 51}
    sender.close()


def says(say: Callable[[], object], ear: Heard | RosHeard) -> bool:
    """Say something; whether anything has been heard."""
    say()
    return bool(ear.messages)


def test_nodes_of_either_side_are_heard_again_when_a_router_has_started_anew(both: Both) -> None:
    both.bridge(topics={"**": CrossingPlan(ros="/**", direction="both")})
    for number in range(2):
        both.restart_routers()
        heard = both.heard(f"/r1/words{number}", String)
        ros = both.ros(f"ear{number}")
        in_ros = ros.hear(String, f"/text{number}")
        publisher = ros.publisher(String, f"/words{number}")
        # Not all links need be there again, so that what is said once may not come.
        eventually(partial(says, partial(publisher.publish, String("from ROS")), heard), "ROS is heard")
        assert heard.messages[0].data == "from ROS"
        with both.node({"text": (String, f"text{number}")}) as publish:
            eventually(partial(has_end, ros, "/MP/", f"%text{number}/"), "it is announced")
            eventually(partial(says, partial(publish, "text", String("from robo")), in_ros), "robo is heard")
            assert in_ros.messages[0].data == "from robo"


def test_a_second_bridge_of_a_robot_is_refused_and_what_another_one_says_comes_in_no_more(both: Both) -> None:
    both.bridge(topics={"**": CrossingPlan(ros="/**", direction="both")})
    own = NodeToken("r1", "ros2_bridge", "", 1, "here")
    held = both.robo.liveliness().declare_token(own.key())
    for namespace, node in (("", "/ros2_bridge"), ("r1", "/r1/other"), ("r1/arm", "/r1/arm/ros2_bridge")):
        with pytest.raises(RunError, match="one bridge is enough for a robot"):
            both.bridge(namespace, node=node)
    with pytest.raises(UsageError, match="a robot named ros2 cannot be bridged"):
        both.bridge("ros2")
    # That of another robot passes on what is ROS's, and nothing that the first one has brought there.
    both.bridge("r2", topics={"**": CrossingPlan(ros="/**", direction="from_ros")})
    first, second = both.heard("/r2/words", String), both.heard("/r2/end", String)
    ros = both.ros("ear")
    in_ros = ros.hear(String, "/words")
    with both.node({"words": (String, "words")}) as publish:
        eventually(partial(has_end, ros, "/MP/", "%words/"), "it is announced")
        publish("words", String("of r1"))
        in_ros.wait()
        ros.publisher(String, "/end").publish(String("of ROS"))
        second.wait()
    assert first.messages == []
    held.undeclare()


def test_a_type_that_does_not_fit_is_told_once_with_both_hashes_and_others_go_on(both: Both) -> None:
    bridge = both.bridge(topics={"*": CrossingPlan(ros="/*", direction="from_ros")})
    heard = both.heard("/r1/words", String)
    ros = both.ros()
    wrong = ros.publisher(Twist, "/cmd", hash_="RIHS01_" + "0" * 64)
    right = ros.publisher(String, "/words")
    for _ in range(5):
        wrong.publish(Twist())
        right.publish(String("x"))
    heard.wait(5)
    eventually(lambda: bool(both.told), "it is told")
    assert len(both.told) == 1
    assert "RIHS01_" + "0" * 64 in both.told[0]
    assert "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a" in both.told[0]
    assert bridge.status().faults == both.told


def test_the_field_in_which_a_type_differs_is_told_where_ross_node_tells_its_type(both: Both) -> None:
    both.bridge(topics={"*": CrossingPlan(ros="/*", direction="from_ros")})
    ros = both.ros("old")
    asked: list[GetTypeDescription.Request] = []

    def describe(request: GetTypeDescription.Request) -> GetTypeDescription.Response:
        asked.append(request)
        double, gone = FieldType(11), FieldType(10)
        vector = [Field("x", double), Field("y", double), Field("z", gone)]
        whole = IndividualTypeDescription("geometry_msgs/msg/Twist", _TWIST)
        inner = IndividualTypeDescription("geometry_msgs/msg/Vector3", vector)
        return GetTypeDescription.Response(True, "", TypeDescription(whole, [inner]))

    form = SimpleNamespace(type=type_questions.TYPE, hash=type_questions.HASH)
    ros.serve_raw("/old/get_type_description", form, GetTypeDescription.Request, describe)
    ros.publisher(Twist, "/cmd", hash_="RIHS01_" + "0" * 64)
    said = "geometry_msgs/msg/Vector3.z is of another type in ROS"
    eventually(lambda: any(said in one for one in both.told), "the field is told")
    assert asked[0].type_name == "geometry_msgs/msg/Twist"
    assert asked[0].type_hash == "RIHS01_" + "0" * 64


def test_the_first_difference_of_two_types_is_found() -> None:
    nested = FieldType(1, nested_type_name="geometry_msgs/msg/Vector3")

    def of(*fields: Field) -> str:
        return difference(
            "geometry/Twist", TypeDescription(IndividualTypeDescription("geometry_msgs/msg/Twist", [*fields]))
        )

    assert of(*_TWIST) == ""
    assert of(Field("linear", nested)) == "geometry_msgs/msg/Twist.angular is a field in robo alone"
    assert of(*_TWIST, Field("more", nested)) == "geometry_msgs/msg/Twist.more is a field in ROS alone"
    assert of(*reversed(_TWIST)) == "the fields of geometry_msgs/msg/Twist are in another order"


def test_hostile_messages_and_tokens_end_nothing(both: Both) -> None:
    both.bridge(topics={"*": CrossingPlan(ros="/*", direction="from_ros")})
    heard = both.heard("/r1/words", String)
    ros = both.ros()
    publisher = ros.publisher(String, "/words")
    for data in (b"", b"\0", b"\0\1\0\0", b"\0\1\0\0\xff\xff\xff\xff", b"\0\1\0\0\5\0\0\0ab"):
        publisher.put(data)
    for attachment in (b"", b"\1", bytes(32), bytes(34), bytes(16) + b"\x07" + bytes(16)):
        publisher.publish(String("no"), attachment=attachment)
    made = []
    for key in (
        "@ros2_lv/0/a/b/c",
        "@ros2_lv/0/zz/0/0/NN/%/%/x",
        "@ros2_lv/0/ab/0/1/MP/%/%/x/%t/std_msgs::msg::dds_::String_/RIHS01_zz/::,:,:,:,,",
        "@ros2_lv/0/ab/0/1/MP/%/%/x/%t%%/std_msgs/RIHS01_zz/::,:,:,:,,",
        "@ros2_lv/0/ab/0/1/MP/%/%/" + "x" * 3000,
        "@robo_ros2/x",
    ):
        made.append(ros.session.liveliness().declare_token(key))
    publisher.publish(String("yes"))
    assert [one.data for one in heard.wait()] == ["yes"]
    del made


def test_one_sender_of_commands_at_a_time_drives_whoever_it_says_it_is(both: Both) -> None:
    bridge = both.bridge(topics={"cmd": CrossingPlan(ros="/cmd", direction="from_ros")})
    heard = both.heard("/r1/cmd", Twist)
    first, second = both.ros("pad").publisher(Twist, "/cmd"), both.ros("safety_monitor", "r1").publisher(Twist, "/cmd")
    first.publish(Twist(linear=Vector3(x=0.1)))
    heard.wait(1)
    for number in range(10):
        second.publish(Twist(linear=Vector3(x=9.0)))
        first.publish(Twist(linear=Vector3(x=0.1)))
        heard.wait(number + 2)
    assert {one.linear.x for one in heard.messages} == {0.1}
    eventually(lambda: any("commands of /r1/safety_monitor are left out" in one for one in both.told), "it is told")

    def refused() -> int:
        return next(one for one in bridge.status().topics if one.key == "r1/cmd").refused

    eventually(lambda: refused() >= 9, "they are counted")
    # Nodes of robo see one source, the bridge, whatever ROS's nodes are called.
    publishers = [str(r.ok.key_expr) for r in both.robo.liveliness().get("@robo/**/pub/*/*/*/*") if r.ok]
    mine = [one for one in publishers if "%cmd" in one or "r1%cmd" in one]
    assert all("/ros2_bridge/" in one or one.startswith("@robo/ros2/") for one in mine), mine
