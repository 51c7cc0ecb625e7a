"""`robo bridge foxglove` beside a robot, by a client that is not ours: the protocol's own, driven by node."""

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import closing
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest

from robo.bridges.foxglove.publications import type_of
from tests.conftest import free_port
from tests.npm import node_with
from tests.support import Command, robo, run_robo

viewers = pytest.importorskip("tests.viewers", reason="the extra foxglove is not installed")

pytestmark = pytest.mark.timeout(180)
ROOT = Path(__file__).parents[2]
CLIENT = ROOT / "tests" / "e2e" / "foxglove_client.cjs"
PACKAGES = ("@foxglove/ws-protocol", "@foxglove/rosmsg", "@foxglove/rosmsg2-serialization", "ws")


@pytest.fixture(scope="module")
def robot() -> Iterator[str]:
    """The reference robot, which stands; where its network is."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with robo("up", "--robot-name", "r1", "--listen", endpoint, "demo:=none") as up:
        up.wait_for("r1 is ready")
        yield endpoint


@pytest.fixture(scope="module")
def bridge(robot: str) -> Iterator[str]:
    """A bridge beside it; its address."""
    command = Command("bridge", "foxglove", "--connect", robot, "--listen", "127.0.0.1:0", "--json")
    with closing(command):
        address: str = json.loads(command.wait_for('"drive"'))["drive"]
        yield address


@pytest.mark.parametrize("subprotocol", ["foxglove.websocket.v1", "foxglove.sdk.v1"])
def test_an_independent_client_sees_and_drives_the_robot(bridge: str, subprotocol: str) -> None:
    node = node_with(PACKAGES)
    command = [node, str(CLIENT), bridge, "r1", subprotocol]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False, env=os.environ)
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout)
    assert found["subprotocol"] == subprotocol
    assert (found["odometry"], found["schemaName"]) == ("odom", "nav_msgs/msg/Odometry")
    assert found["latched"] == 1
    assert found["service"]["success"]
    assert found["before"][0]["name"] == "/r1/safety_monitor.max_speed"
    assert found["after"]["value"] == 0.75
    assert found["publishers"] == ["/r1/diff_drive_sim"]
    assert found["published"] == pytest.approx(0.3)
    assert found["drives"]
    assert found["failures"] == []


def named_by(layout: object, keys: tuple[str, ...]) -> Iterator[str]:
    """What a layout names by some keys."""
    if isinstance(layout, dict):
        for key, value in layout.items():
            if key in keys and isinstance(value, str) and value.startswith("/"):
                yield value
            elif key in keys and isinstance(value, dict):
                yield from value
            yield from named_by(value, keys)
    elif isinstance(layout, list):
        for one in layout:
            yield from named_by(one, keys)


PATHS = ("topic", "topicPath", "path", "value", "topicToRender", "topics")
"""Of panels that show, or publish on, a topic."""
MAYBE = {"/r1/map", "/r1/path"}
"""Of robots that have one."""


@pytest.mark.parametrize("viewer", ["foxglove", "lichtblick"])
def test_the_layouts_show_what_the_robot_has(bridge: str, viewer: str) -> None:
    done = run_robo("bridge", "foxglove", "--layout", viewer, "--robot-name", "r1")
    layout = json.loads(done.stdout)
    paths = {name: name.partition(".") for name in named_by(layout, PATHS)}
    wanted = {topic for topic, _, _ in paths.values()} - MAYBE
    services = {*named_by(layout, ("serviceName",))}
    assert len(wanted) >= 10
    assert services == {"/r1/emergency_stop", "/r1/reset_emergency_stop"}
    assert not [name for name in wanted if not name.startswith("/r1/")]
    with viewers.client.connect(bridge, subprotocols=[viewers.SDK], max_size=None) as socket:
        seen = viewers.Viewer(socket)
        seen.until(lambda: wanted <= {*seen.topics} and services <= {*seen.services})
    for topic, _, fields in paths.values():
        if topic in wanted and fields:
            attrgetter(fields)(type_of(seen.topics[topic]["schemaName"])())


def panels(layout: Any) -> set[str]:
    """The panels that stand in a layout."""
    if isinstance(layout, str):
        return {layout}
    return panels(layout["first"]) | panels(layout["second"])


@pytest.mark.parametrize("viewer", ["foxglove", "lichtblick"])
def test_each_panel_of_a_layout_is_described_and_stands_in_it(viewer: str) -> None:
    layout = json.loads((ROOT / "config" / f"{viewer}_layout.json").read_text(encoding="utf-8"))
    shown = panels(layout["layout"])
    for tab in layout["configById"]["Tab!more"]["tabs"]:
        shown |= panels(tab["layout"])
    assert shown == {*layout["configById"]}


def test_ctrl_c_ends_it_while_viewers_are_there(robot: str) -> None:
    with robo("bridge", "foxglove", "--connect", robot, "--listen", "127.0.0.1:0") as command:
        address = command.wait_for("viewers connect to").split()[-1]
        with viewers.client.connect(address, subprotocols=[viewers.SDK], max_size=None) as socket:
            seen = viewers.Viewer(socket)
            seen.next_of(seen.subscribe("/r1/odom"))
            command.process.send_signal(signal.SIGINT)
            assert command.wait() == 0
    assert "Traceback" not in command.output


def test_another_address_needs_a_token_or_says_that_it_is_open(robot: str, tmp_path: Path) -> None:
    where = ("bridge", "foxglove", "--connect", robot, "--listen", "0.0.0.0:0")
    with robo(*where, "--json") as command:
        said = json.loads(command.wait_for('"drive"'))
        assert not said["open"]
        assert "?token=" in said["drive"]
        assert said["view"] != said["drive"]
    with robo(*where, "--open") as command:
        command.wait_for("OPEN: whoever reaches this port drives the robot")
    with robo(*where, "--open", "--look") as command:
        command.wait_for("OPEN: whoever reaches this port sees all")
    short = tmp_path / "tokens"
    short.write_text("short\n", encoding="utf-8")
    done = run_robo(*where, "--token-file", str(short))
    assert (done.returncode, "at least" in done.stderr) == (2, True)
    done = run_robo(*where, "--token-file", str(short), "--open")
    assert (done.returncode, "say one of them" in done.stderr) == (2, True)


def test_mistakes_are_told_by_name(robot: str) -> None:
    done = run_robo("bridge", "foxglove", "--listen", "nowhere")
    assert (done.returncode, "HOST:PORT" in done.stderr) == (2, True)
    done = run_robo("bridge", "foxglove", "--layout", "rviz")
    assert (done.returncode, "lichtblick" in done.stderr) == (2, True)
    port = robot.rpartition(":")[2]  # which is taken
    done = run_robo("bridge", "foxglove", "--connect", robot, "--listen", f"127.0.0.1:{port}")
    assert (done.returncode, "--listen says another" in done.stderr) == (1, True)
