"""Pictures of a running robot: `robo topic plot --svg`, `robo graph --svg`."""

import signal
from pathlib import Path
from xml.etree import ElementTree

import pytest
import zenoh

import robo_messages
from robo.testing import Launch, Robot
from robo_messages import LaserScan
from tests.support import Command, robo, run_robo

PROBE = ("--field", "ranges[1]", "--window", "60")
SVG = "{http://www.w3.org/2000/svg}"

pytestmark = pytest.mark.timeout(120)


@pytest.fixture(scope="module")
def robot(module_launch: Launch) -> Robot:
    """The reference robot."""
    return module_launch("robot.yaml", demo="arc")


def texts(svg: str) -> set[str]:
    return {element.text or "" for element in ElementTree.fromstring(svg).iter(f"{SVG}text")}


def hears(plotting: Command, robot: Robot, *messages: bytes) -> None:
    """Let a plot of `r1/probe` hear messages; of what it has heard nothing is seen before its end."""
    plotting.wait_for("waiting for r1/probe")  # it listens
    for message in messages:
        robot.session.put("r1/probe", message, encoding=zenoh.Encoding("application/msgpack;sensor/LaserScan"))
    robot.clear()
    robot.wait_for_count("odom", 25)


def test_a_plot_is_written_at_its_end_however_it_ends(robot: Robot, tmp_path: Path) -> None:
    field = ("--field", "twist.twist.linear.x", "--connect", robot.endpoint, "--theme", "dark")
    words = ("topic", "plot", "r1/odom", *field)
    result = run_robo(*words, "--duration", "1", "--svg", "now.svg", cwd=str(tmp_path))
    assert (result.returncode, result.stderr) == (0, "now.svg is written\n")
    svg = (tmp_path / "now.svg").read_text()
    assert {"m/s", "twist.twist.linear.x", "r1/odom  nav/Odometry"} <= texts(svg)
    assert "prefers-color-scheme" not in svg
    assert [file.name for file in tmp_path.iterdir()] == ["now.svg"]
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        file = tmp_path / f"{number}.svg"
        with robo("topic", "plot", "r1/probe", *PROBE, "--connect", robot.endpoint, "--svg", str(file)) as plotting:
            hears(plotting, robot, robo_messages.encode(LaserScan(ranges=[1.0, 2.0])))
            plotting.process.send_signal(number)
            plotting.wait_for("is written")
        assert "ranges[1]" in texts(file.read_text())


def test_messages_that_lack_a_field_are_left_out(robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "ranges.svg"
    with robo("topic", "plot", "r1/probe", *PROBE, "--connect", robot.endpoint, "--svg", str(file)) as plotting:
        scans = [robo_messages.encode(LaserScan(ranges=ranges)) for ranges in ([], [1.0, 2.0], [1.0])]
        hears(plotting, robot, *scans, b"\xc1")
        plotting.interrupt()
        plotting.wait_for("1 message could not be read; the first: ")
        plotting.wait_for("not there: ranges[1] of 2 messages")
        plotting.wait_for("is written")


def test_a_graph_is_a_picture(robot: Robot, tmp_path: Path) -> None:
    words = ("graph", "--robot-name", "r1", "--hide-system", "--connect", robot.endpoint)
    result = run_robo(*words, "--svg", "graph.svg", cwd=str(tmp_path))
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("graph.svg: ")
    assert {"/r1/safety_monitor", "r1/odom", "nav/Odometry"} <= texts((tmp_path / "graph.svg").read_text())
    printed = run_robo(*words, "--svg", "-", "--theme", "light")
    assert {"/r1/safety_monitor", "r1/odom"} <= texts(printed.stdout)


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (("topic", "plot", "r1/odom", "--svg", "-"), "-: end its name in .svg"),
        (("topic", "plot", "r1/odom", "--svg", "no/such/x.svg"), "there is no folder no/such"),
        (("topic", "plot", "r1/odom", "--theme", "dark"), "--theme: say --svg FILE"),
        (("graph", "--theme", "dark"), "--theme: say --svg FILE"),
        (("graph", "--svg", "a.svg", "--json"), "--svg and --format json: say one of both"),
        (("graph", "--svg", "a.txt"), "end its name in .svg"),
    ],
)
def test_what_makes_no_sense_is_told_before_anything_is_dialled(
    words: tuple[str, ...], wanted: str, endpoint: str
) -> None:
    result = run_robo(*words, "--connect", endpoint)
    assert (result.returncode, result.stdout) == (2, "")
    assert wanted in result.stderr
