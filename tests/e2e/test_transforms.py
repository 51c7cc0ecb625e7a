"""`robo tf` beside running nodes: what people and programs read of frames."""

import json
from collections.abc import Iterator

import pytest
import zenoh

from robo.node.declare import timer
from robo.node.node import Node
from robo.tf import StaticTransformBroadcaster, Transform3, TransformBroadcaster
from robo_messages import Header, TransformStamped
from tests.support import PATIENCE, robo, run_robo

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
