"""`robo tf` beside running nodes: what people and programs read of frames."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from robo.node.declare import timer
from robo.node.node import Node
from robo.tf import StaticTransformBroadcaster, Transform3, TransformBroadcaster
from robo_messages import Header, JointState, TransformStamped
from tests.support import PATIENCE, eventually, robo, run_robo

pytestmark = pytest.mark.timeout(120)


class Base(Node):
    """Drives on a line, with a laser 0.2 m before its middle."""

    frames = TransformBroadcaster()
    fixed_frames = StaticTransformBroadcaster()

    def on_start(self) -> None:
        self.fixed_frames.send(Transform3(x=0.2).to_stamped(Header(self.now(), "base_link"), "laser"))

    @timer(rate=50.0)
    def move(self) -> None:
        self.frames.send(Transform3.planar(1.0, 2.0, 0.5).to_stamped(Header(self.now(), "odom"), "base_link"))


@pytest.fixture
def base(session: zenoh.Session) -> Iterator[Base]:
    with Base(namespace="r1", session=session) as node:
        yield node


@pytest.mark.usefixtures("base")
def test_the_tree(endpoint: str) -> None:
    text = run_robo("tf", "tree", "--connect", endpoint).stdout.splitlines()
    assert text[0] == "odom"
    assert text[1].startswith("└─ base_link  ")
    assert text[1].endswith(" s old, by /r1/base")
    assert text[2] == "   └─ laser   static, by /r1/base"
    found = json.loads(run_robo("tf", "tree", "--json", "--robot-name", "r1", "--connect", endpoint).stdout)
    assert [(one["parent"], one["child"], one["static"]) for one in found] == [
        ("odom", "base_link", False),
        ("base_link", "laser", True),
    ]
    with robo("tf", "monitor", "--json", "--interval", "0.2", "--connect", endpoint) as monitor:
        for _ in range(2):
            assert "base_link" in monitor.wait_for('"child"')
        monitor.interrupt()
        assert monitor.wait() == 130


@pytest.mark.usefixtures("base")
def test_where_a_frame_stands(endpoint: str) -> None:
    once = run_robo("tf", "echo", "odom", "laser", "--once", "--json", "--connect", endpoint)
    found = json.loads(once.stdout)
    assert found["translation"] == pytest.approx({"x": 1.1755165123780747, "y": 2.0958851077208406, "z": 0.0})
    assert found["yaw"] == pytest.approx(0.5)
    text = run_robo("tf", "echo", "odom", "laser", "--once", "--connect", endpoint).stdout.splitlines()
    assert text[1:] == [
        "  translation  x 1.1755  y 2.0959  z 0.0000 m",
        "  rotation     x 0.0000  y 0.0000  z 0.2474  w 0.9689",
        "               roll 0.00°  pitch 0.00°  yaw 28.65°",
    ]
    with robo("tf", "echo", "base_link", "laser", "--interval", "0.1", "--connect", endpoint) as echo:
        echo.wait_for("at all times", PATIENCE)
        echo.interrupt()
        assert echo.wait() == 130


def test_why_it_is_not_known(endpoint: str, session: zenoh.Session, base: Base) -> None:
    lost = run_robo("tf", "echo", "odom", "lasre", "--duration", "2", "--connect", endpoint)
    assert lost.returncode == 1
    assert lost.stdout == ""
    assert "there is no frame lasre; did you mean laser?" in lost.stderr
    with Base(namespace="r2", session=session):
        which = run_robo("tf", "tree", "--connect", endpoint)
        assert which.returncode == 2
        assert "error: r1, r2 have transforms; say which with --robot-name" in which.stderr
    base.fixed_frames.send(TransformStamped(Header(base.now(), "map"), "base_link"))
    told = run_robo("tf", "tree", "--connect", endpoint)
    assert "base_link" in told.stderr, "it moves in one frame, and stands still in another"


def test_nobody_says_where_frames_stand(endpoint: str, session: zenoh.Session) -> None:
    with Node(name="quiet", namespace="r1", session=session):
        none = run_robo("tf", "tree", "--connect", endpoint)
    assert none.returncode == 1
    assert none.stderr == "error: no node publishes transforms (tf2/TFMessage on tf or tf_static)\n"


URDF = """<robot name="mast">
  <link name="base_link"/>
  <link name="mast"/>
  <link name="camera"/>
  <joint name="mast_joint" type="fixed">
    <parent link="base_link"/>
    <child link="mast"/>
  </joint>
  <joint name="pan_joint" type="revolute">
    <parent link="mast"/>
    <child link="camera"/>
    <axis xyz="0 0 1"/>
  </joint>
</robot>
"""
STATE_PUBLISHER = "robo_services.robot_state_publisher"


def test_the_frames_of_a_urdf(endpoint: str, base: Base, tmp_path: Path) -> None:
    (tmp_path / "mast.urdf").write_text(URDF)
    words = ("--robot-name", "r1", "-p", f"urdf:={tmp_path / 'mast.urdf'}", "--connect", endpoint)
    with robo("run", STATE_PUBLISHER, *words) as publisher:
        publisher.wait_for("mast has 3 links from base_link on, 1 joints move")
        joints = base.create_publisher(JointState, "joint_states")
        eventually(lambda: joints.has_subscribers, "they have met")
        joints.publish(JointState(Header(base.now()), ["pan_joint"], [0.5]))
        text = run_robo("tf", "tree", "--connect", endpoint).stdout.splitlines()
        assert [line.split("  ")[0] for line in text[:2]] == ["odom", "└─ base_link"]
        said_by = "by /r1/robot_state_publisher"
        assert [(line.strip("├└│─ ").partition(" ")[0], line.endswith(said_by)) for line in text[2:]] == [
            ("laser", False),
            ("mast", True),
        ], "who comes later does not know how the camera moved"
        with robo("tf", "monitor", "--json", "--interval", "0.2", "--connect", endpoint) as monitor:
            monitor.wait_for('"child"')
            joints.publish(JointState(Header(base.now()), ["pan_joint"], [0.5]))
            monitor.wait_for('"camera"')
        publisher.interrupt()
        assert publisher.wait() == 0


def test_a_urdf_with_mistakes_is_no_robot(endpoint: str, tmp_path: Path) -> None:
    file = tmp_path / "mast.urdf"
    file.write_text(URDF.replace('"mast"/>\n  <link', '"mats"/>\n  <link').replace("0 0 1", "0 0 0"))
    run = run_robo("run", STATE_PUBLISHER, "-p", f"urdf:={file}", "--listen", endpoint)
    assert run.returncode == 1
    assert run.stderr.splitlines() == [
        f"error: {file}:5:3: joint 'mast_joint': its child 'mast' is no link; did you mean mats?",
        f"{file}:9:3: joint 'pan_joint': its parent 'mast' is no link; did you mean mats?",
        f"{file}:12:5: joint 'pan_joint' has an axis of length 0, which has no direction",
    ]


def test_the_frames_of_a_replay(endpoint: str) -> None:
    with robo("up", "replay.yaml", "--robot-name", "r1", "--listen", endpoint) as replay:
        replay.wait_for(" at tcp/")
        with robo("tf", "monitor", "--json", "--interval", "0.2", "--connect", endpoint) as monitor:
            monitor.wait_for('"base_link"')
            monitor.wait_for('"base_laser"')
        text = run_robo("tf", "tree", "--connect", endpoint).stdout.splitlines()
        assert [line.split("  ")[0] for line in text[:2]] == ["odom", "└─ base_link"]
        assert text[2].endswith("static, by /r1/carmen_player")
        replay.interrupt()
        assert replay.wait() == 130
