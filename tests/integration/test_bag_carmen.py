"""A log of CARMEN as a recording says what the node says that plays it."""

from pathlib import Path
from typing import Any

from robo import bag
from robo.bag.forms.from_carmen import from_carmen
from robo.testing import RunNode
from robo_messages import Time
from robo_services.carmen_player import CarmenPlayer
from tests.random_messages import rounded

LOG = """PARAM robot_frontlaser_offset 0.25 nohost 0
PARAM robot_frontlaser_angular_offset -0.5 nohost 0
ODOM 1 2 0.5 0.25 -0.125 0 100.0 robot 0.1
FLASER 3 1 2.5 81.75 0 0 0 0 0 0 100.1 robot 0.2
ODOM 2 2 -9.25 0 0 0 100.2 robot 0.3
PARAM robot_frontlaser_side_offset 0.5 nohost 0
ODOM 3 2 3.5 0 0 0 100.1 robot 0.3
"""


def test_a_recording_of_a_log_says_what_its_player_says(run_node: RunNode, tmp_path: Path) -> None:
    log, path = tmp_path / "a.log", tmp_path / "a.mcap"
    log.write_text(LOG)
    from_carmen(log, path, None, "none")
    player = run_node(CarmenPlayer, parameters={"log": str(log), "rate": 0.0})
    player.wait_for("odom", lambda odometry: odometry.pose.pose.position.x == 3.0)
    said: dict[str, list[Any]] = {name: list(player.published(name)) for name in ("odom", "scan", "tf", "tf_static")}
    with bag.open(path) as opened:
        recorded: dict[str, list[Any]] = {
            name: [message.value for message in opened.messages(name)] for name in opened.topics
        }
    for messages in (said["tf_static"], recorded["tf_static"]):
        for message in messages:
            for one in message.transforms:
                one.header.stamp = Time()  # the player says it when it starts, the recording when the log does
    assert recorded["tf_static"][0] == said["tf_static"][0]
    assert recorded["tf_static"][-1] == said["tf_static"][-1]
    for name in ("odom", "scan", "tf"):
        assert recorded[name] == [rounded(message) for message in said[name]]
