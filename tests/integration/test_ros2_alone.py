"""A node that is in ROS's graph by itself: each thing once, beside a bridge of its robot as well."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from robo import Client, Node, Publisher, service, subscribe
from robo.launch.plan import CrossingPlan
from robo.wire.keys import EndpointToken
from robo.wire.qos import QoS
from robo_messages import Odometry, SetBool, String, Twist, Vector3
from tests.support import eventually

pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

from robo.bridges.ros2.alone import in_ros
from robo.bridges.ros2.scope import Scope, who_of
from tests.ros2 import Both, RosHeard, RosNode

pytestmark = pytest.mark.timeout(120)
EVERYTHING = {"**": CrossingPlan(direction="both")}


class Base(Node):
    odom = Publisher(Odometry, "odom")
    kind = Publisher(String, "kind", latched=True)
    ask = Client(SetBool.Request, SetBool.Response, "ask", timeout=30.0)

    def on_start(self) -> None:
        self.commands: list[float] = []
        self.maps: list[str] = []

    @subscribe("cmd")
    def on_command(self, message: Twist) -> None:
        self.commands.append(message.linear.x)

    @subscribe("map_name", latched=True)
    def on_map(self, message: String) -> None:
        self.maps.append(message.data)

    @service("lights")
    def lights(self, request: SetBool.Request) -> SetBool.Response:
        return SetBool.Response(request.data, "bright")


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def both(stack: ExitStack) -> Both:
    return Both(stack)


def started(both: Both, stack: ExitStack) -> Base:
    node: Base = stack.enter_context(Base(name="base", namespace="r1", session=both.open(both.peer())))
    stack.enter_context(in_ros(node, both.ros_at, 0))
    return node


def ends(ros: RosNode, kind: str, node: str, topic: str) -> int:
    return sum(f"/{kind}/%/%r1/{node}/{topic}/" in one for one in ros.tokens())


def link(node: Base, heard: RosHeard) -> None:
    """Have a node heard: of two that have just linked it knows a moment later that the other one listens."""

    def is_heard() -> bool:
        node.odom.publish(Odometry())
        return bool(heard.messages)

    eventually(is_heard, "it is heard")


def frames(heard: RosHeard, count: int = 1) -> list[str]:
    """What has been heard, once it is so much, beside what was said to link."""

    def found() -> list[str]:
        return [one.child_frame_id for one in list(heard.messages) if one.child_frame_id]

    eventually(lambda: len(found()) >= count, f"{count} messages")
    return found()


def test_it_says_hears_serves_and_calls_in_ros_what_it_does_in_robo(both: Both, stack: ExitStack) -> None:
    others = both.heard("/r1/cmd", Twist)
    early = both.ros("early")
    map_name = early.publisher(String, "/r1/map_name", latched=1)
    map_name.publish(String("hall"))
    node = started(both, stack)
    ros = both.ros("nav")
    heard, publisher = ros.hear(Odometry, "/r1/odom"), ros.publisher(Twist, "/r1/cmd")
    eventually(lambda: ends(ros, "MS", "base", "%r1%cmd") == 1, "it is there")
    eventually(lambda: ends(ros, "MP", "base", "%r1%odom") == 1, "it is there")
    link(node, heard)
    node.odom.publish(Odometry(child_frame_id="base"))
    assert frames(heard) == ["base"]
    for number in range(20):
        publisher.publish(Twist(Vector3(float(number))))
    eventually(lambda: node.commands == [*map(float, range(20))], "it hears each once")
    eventually(lambda: node.maps == ["hall"], "it hears what was latched")
    node.kind.publish(String("mobile"))
    assert both.ros("late").hear(String, "/r1/kind", latched=1).wait() == [String("mobile")]
    eventually(lambda: ends(ros, "SS", "base", "%r1%lights") == 1, "it serves")
    lit = ros.call("std/SetBool", "/r1/lights", SetBool.Request(True), SetBool.Response)
    assert lit == SetBool.Response(True, "bright")
    ros.serve("std/SetBool", "/r1/ask", SetBool.Request, lambda request: SetBool.Response(request.data, "from ROS"))
    assert node.ask(SetBool.Request(True)) == SetBool.Response(True, "from ROS")
    eventually(lambda: ends(ros, "SS", "base", "%r1%base%set_parameters") == 1, "it has parameters")
    assert others.messages == []  # what it hears of ROS is its own affair


def test_other_nodes_of_its_robot_are_not_in_ros(both: Both, stack: ExitStack) -> None:
    with both.node({"words": (String, "words"), "odom": (Odometry, "odom")}) as publish:
        node = started(both, stack)
        ros = both.ros("nav")
        heard = ros.hear(Odometry, "/r1/odom")
        eventually(lambda: ends(ros, "MP", "base", "%r1%odom") == 1, "it is there")
        link(node, heard)
        publish("odom", Odometry(child_frame_id="of another"))
        node.odom.publish(Odometry(child_frame_id="own"))
        assert frames(heard) == ["own"]
        assert not [one for one in ros.tokens() if "/publisher/" in one or one.endswith("/publisher")]


def test_beside_a_bridge_of_its_robot_all_is_there_once(both: Both) -> None:
    with both.node({"words": (String, "words")}) as publish:
        both.bridge(topics=EVERYTHING)
        ros = both.ros("nav")
        heard, words = ros.hear(Odometry, "/r1/odom"), ros.hear(String, "/r1/words")
        publisher = ros.publisher(Twist, "/r1/cmd")
        with ExitStack() as life:
            node: Base = life.enter_context(Base(name="base", namespace="r1", session=both.open(both.peer())))
            eventually(lambda: ends(ros, "MP", "base", "%r1%odom") == 1, "the bridge says it")
            with in_ros(node, both.ros_at, 0):
                eventually(
                    lambda: (
                        [one.split("/")[2] for one in ros.tokens() if one.endswith("/NN/%/%r1/base")]
                        == [str(session) for session in _sessions_alone(ros)]
                    ),
                    "it says it itself, and the bridge no more",
                )
                link(node, heard)
                node.odom.publish(Odometry(child_frame_id="base"))
                publish("words", String("of another node"))
                assert [one.data for one in words.wait()] == ["of another node"]
                assert frames(heard) == ["base"]
                eventually(lambda: ends(ros, "MP", "base", "%r1%odom") == 1, "it is there once")
                publisher.publish(Twist(Vector3(0.5)))
                eventually(lambda: node.commands == [0.5], "it hears it once, by the bridge")
            eventually(
                lambda: not _sessions_alone(ros) and ends(ros, "MP", "base", "%r1%odom") == 1,
                "the bridge says it again",
            )
            node.odom.publish(Odometry(child_frame_id="again"))
            assert frames(heard, 2) == ["base", "again"]
        assert node.commands == [0.5]


def test_a_node_whose_ends_are_seen_before_itself_is_there_once(both: Both) -> None:
    both.bridge(topics=EVERYTHING)
    ros = both.ros("nav")
    end = EndpointToken("r1", "base", "pub", "nav/Odometry", QoS.DEFAULT, "r1/odom", "7")
    seen = both.robo.liveliness().declare_token(end.key())
    eventually(lambda: ends(ros, "MP", "base", "%r1%odom") == 1, "the bridge says it")
    alone = ros.session.liveliness().declare_token(Scope("/r1/base", alone=True).key("5a"))
    eventually(lambda: not [one for one in ros.tokens() if "/%r1/base" in one], "the bridge says it no more")
    alone.undeclare()
    eventually(lambda: ends(ros, "MP", "base", "%r1%odom") == 1, "the bridge says it again")
    seen.undeclare()


def _sessions_alone(ros: RosNode) -> list[str]:
    found = ros.session.liveliness().get("@robo_ros2/**", timeout=5.0)
    whose = [who_of(str(one.ok.key_expr)) for one in found if one.ok is not None]
    return [session for session, node in whose if node == "/r1/base"]


def test_who_speaks_is_told_by_a_token() -> None:
    for scope, node in ((Scope("/r1/base", alone=True), "/r1/base"), (Scope("/r1/ros2_bridge"), "")):
        assert who_of(scope.key("5a")) == ("5a", node)
