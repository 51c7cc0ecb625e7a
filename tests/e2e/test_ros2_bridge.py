"""`robo bridge ros2`, and `bridges:` in a manifest, beside a robot, with nodes of ROS's that are processes' equals."""

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tests.conftest import free_port
from tests.support import Command, Desk, eventually, robo, run_robo

pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

import zenoh

from robo.bridges.ros2 import tokens
from robo.bridges.ros2.forms import form_of, service_form
from robo.bridges.ros2.rules import crossings_of
from robo.launch.plan import Ros2Plan
from robo.wire.keys import EndpointToken, parse_token
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Odometry, String, Trigger, Twist, Vector3
from tests.ros2 import RosNode

pytestmark = pytest.mark.timeout(240)

MANIFEST = """
args: {ros: tcp/127.0.0.1:7447}
include: {file: robot.yaml, args: {demo: none}}
bridges:
  ros2:
    connect: ${ros}
    topics:
      odom: /odom
      cmd_vel_key: {ros: /cmd_vel, direction: from_ros, depth: 1}
    services:
      "*": /robot/*
"""


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[str]:
    """The reference robot with a bridge; where both networks are, for they are one."""
    (tmp_path / "bridged.yaml").write_text(MANIFEST)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    words = ("bridged.yaml", "--robot-name", "r1", "--listen", endpoint, f"ros:={endpoint}")
    with robo("up", *words, cwd=str(tmp_path)) as up:
        up.wait_for("r1 is ready")
        yield endpoint


def test_a_manifest_bridges_a_robot_which_ros_sees_and_drives(robot: str) -> None:
    with closing(RosNode(robot, "nav", "up/there")) as ros:
        heard = ros.hear(Odometry, "/odom")
        publisher = ros.publisher(Twist, "/cmd_vel")
        eventually(lambda: any("/MS/%/%r1/twist_mux/%cmd_vel/" in one for one in ros.tokens()), "the mux is seen")
        wanted = {"%r1/twist_mux", "%r1/safety_monitor", "%r1/ros2_bridge", "%up%there/nav"}
        eventually(
            lambda: wanted <= {one.rpartition("/NN/%/")[2] for one in ros.tokens() if "/NN/" in one}, "the nodes are"
        )

        def drives() -> bool:
            publisher.publish(Twist(linear=Vector3(x=0.2)))
            return bool(heard.messages) and heard.messages[-1].twist.twist.linear.x > 0.1

        eventually(drives, "the robot drives")
        stopped = ros.call("std/Trigger", "/robot/emergency_stop", Trigger.Request(), Trigger.Response)
        assert stopped.success
        listed = run_robo("node", "list", "--connect", robot)
        assert "/ros2/up/there/nav" in listed.stdout
        about = run_robo("node", "info", "/ros2/up/there/nav", "--connect", robot)
        assert about.returncode == 0, about.stderr
        assert "a node of ROS 2, as a bridge shows it" in about.stdout
        assert "r1/cmd_vel_key" in about.stdout
        assert "Hz" not in about.stdout
        for words in (["ps", "--json"], ["ps", "--fleet", "--json"], ["net", "--json"], ["param", "list"]):
            done = run_robo(*words, "--connect", robot)
            assert done.returncode == 0, (words, done.stderr)
            assert "/ros2/" not in done.stdout
        info = run_robo("topic", "info", "r1/cmd_vel_key", "--connect", robot)
        assert "/r1/ros2_bridge" in info.stdout
        assert "/ros2/up/there/nav" in info.stdout
        status = run_robo("topic", "echo", "--once", "r1/ros2_bridge_state", "--connect", robot, "--json")
        assert json.loads(status.stdout)["message"]["message"] == "connected"
        second = run_robo("bridge", "ros2", "--robot-name", "r1", "--connect", robot, "--ros-connect", robot)
        assert second.returncode == 1
        assert "/r1/ros2_bridge runs already" in second.stderr
        assert "one bridge is enough for a robot" in second.stderr
        of_all = run_robo("bridge", "ros2", "--connect", robot, "--ros-connect", robot)
        assert "/r1/ros2_bridge runs already" in of_all.stderr


End = tuple[str, str, str, str]
"""The full name of a node, the kind of its end as ROS has it, the name in ROS without its leading slash, the type."""


def ends_in_robo(session: zenoh.Session) -> set[End]:
    """What robo's nodes have, as ROS is to see it."""
    rules = crossings_of(Ros2Plan(), "r1")
    found: set[End] = set()
    for reply in session.liveliness().get("@robo/**", timeout=10.0):
        token = parse_token(str(reply.ok.key_expr)) if reply.ok is not None else None
        if not isinstance(token, EndpointToken) or token.node == "ros2_bridge" or token.namespace == "ros2":
            continue
        if token.kind in ("pub", "sub") and (topic := rules.topics.to_ros(token.topic)) is not None:
            kind = "MP" if token.kind == "pub" else "MS"
            found.add((token.full_name, kind, topic.name, form_of(token.type_name).type))
        if token.kind in ("srv", "cli") and (called := rules.services.to_ros(token.topic)) is not None:
            kind = "SS" if token.kind == "srv" else "SC"
            found.add((token.full_name, kind, called.name, service_form(token.type_name).type))
    return found


def ends_in_ros(ros: RosNode) -> set[End]:
    """What ROS sees of robo's nodes, without what each has for its parameters."""
    ends = [one for one in map(tokens.parse, ros.tokens()) if isinstance(one, tokens.EndToken)]
    return {
        (one.node.full_name, one.kind, one.topic, one.type)
        for one in ends
        if one.node.name not in ("ros2_bridge", "nav") and "rcl_interfaces::srv" not in one.type
    }


def test_the_graph_is_the_same_from_both_sides(tmp_path: Path) -> None:
    (tmp_path / "bridged.yaml").write_text(
        "args: {ros: tcp/127.0.0.1:7447}\ninclude: {file: robot.yaml, args: {demo: none}}\n"
        "bridges: {ros2: {connect: '${ros}', actions: {}}}\n"
    )
    robo_at, ros_at = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with closing(Command("router", "--listen", ros_at)) as router:
        router.wait_for("router at")
        words = ("bridged.yaml", "--robot-name", "r1", "--listen", robo_at, f"ros:={ros_at}")
        with robo("up", *words, cwd=str(tmp_path)) as up:
            up.wait_for("r1 is ready")
            session = open_session(Network(mode="client", connect=(robo_at,)))
            with closing(RosNode(ros_at, "nav")) as ros:
                wanted = ends_in_robo(session)
                assert {one[1] for one in wanted} == {"MP", "MS", "SS"}
                assert len({one[0] for one in wanted}) == 5
                eventually(lambda: ends_in_ros(ros) == wanted, "ROS sees the same")
            close_session(session)


def test_by_hand_it_tells_how_it_goes_as_json(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    where = ("--connect", endpoint, "--ros-connect", endpoint)
    with robo("up", "--robot-name", "r1", "--listen", endpoint, "demo:=none", cwd=str(tmp_path)) as up:
        up.wait_for("r1 is ready")
        with closing(Command("bridge", "ros2", "--robot-name", "r1", "--json", *where)) as command:
            line = command.wait_for('"key":"r1/odom"')
            status = json.loads(line)
            assert (status["domain"], status["ros_is_there"], status["faults"]) == (0, True, [])
            found = next(one for one in status["topics"] if one["key"] == "r1/odom")
            assert (found["name"], found["way"]) == ("r1/odom", "to_ros")
            command.interrupt()
            assert command.wait() in (0, 130)
            assert "Traceback" not in command.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--topic", "odom=/odom,sideways"], "sideways is not known"),
        (["--topic", "a b"], "name 'a b' holds ' '"),
        (["--topic", "odom,depth=x"], "depth"),
        (["--topic", "a=/x", "--topic", "b=/x"], "are both /x in ROS"),
        (["--parameters", "some"], "use none, read or write"),
        (["--ros-connect", "nowhere"], "nowhere"),
        (["--domain", "300"], "300"),
    ],
)
def test_words_that_make_no_sense_are_told_before_anything_is_dialled(words: list[str], said: str) -> None:
    done = run_robo("bridge", "ros2", "--robot-name", "r1", *words)
    assert done.returncode != 0
    assert said in done.stderr
    assert "Traceback" not in done.stderr


NODE = """
import robo
from robo import Node, Publisher, subscribe
from robo_messages import String

class Echo(Node):
    said = Publisher(String, "said")

    @subscribe("heard")
    def on_heard(self, message: String) -> None:
        self.said.publish(message)

if __name__ == "__main__":
    robo.run(Echo)
"""


def test_a_node_is_in_ros_by_itself_before_its_router_and_after(tmp_path: Path) -> None:
    (tmp_path / "echo.py").write_text(NODE)
    robo_at, ros_at = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    words = ("run", "echo.py", "--robot-name", "r1", "--listen", robo_at, "--ros2", "--ros-connect", ros_at)
    with closing(Command(*words, cwd=str(tmp_path))) as node:
        node.wait_for(f"not in the graph of ROS 2: nobody answers at {ros_at}, domain 0")
        with closing(Command("router", "--listen", ros_at)):
            node.wait_for(f"in the graph of ROS 2 at {ros_at}, domain 0")
            with closing(RosNode(ros_at, "nav")) as ros:
                heard, publisher = ros.hear(String, "/r1/said"), ros.publisher(String, "/r1/heard")
                eventually(lambda: any("/MS/%/%r1/echo/%r1%heard/" in one for one in ros.tokens()), "it is there")
                publisher.publish(String("hello"))
                assert heard.wait() == [String("hello")]
        node.interrupt()
        assert node.wait() in (0, 130)
        assert "Traceback" not in node.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--ros-domain", "3"], "add --ros2"),
        (["--ros-connect", "tcp/127.0.0.1:7"], "add --ros2"),
        (["--ros2", "--ros-domain", "300"], "write a number from 0 to 232"),
        (["--ros2", "--ros-connect", "nowhere"], "nowhere"),
    ],
)
def test_where_ros_is_makes_sense_or_the_node_does_not_start(words: list[str], said: str) -> None:
    done = run_robo("run", "robo_services.twist_mux", *words)
    assert done.returncode != 0
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_a_robots_door_for_others_is_not_taken_for_ros(desk: Desk) -> None:
    up = desk.start("robo up --robot-name r1")
    up.wait_for("r1 is ready")
    code, said = desk.run("robo bridge ros2 --robot-name r1")
    assert code == 1
    assert "at tcp/localhost:7447 is no router of ROS 2 but a robot's door for others, who only look" in said
    assert "rmw_zenohd" in said
    up.interrupt()
    up.wait()
    (desk.folder / "bridged.yaml").write_text("include: robot.yaml\nbridges: {ros2: {}}\n")
    bridged = desk.start("robo up bridged.yaml --robot-name r1")
    bridged.wait_for("no router of ROS 2 but a robot's door for others")
