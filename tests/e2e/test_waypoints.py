"""The course through the hall, driven by the processes of a robot: each waypoint is reached, and nothing is touched."""

import math
from pathlib import Path

import pytest

from robo.testing import Launch
from robo_services import courses, world

CONFIG = Path(__file__).parents[2] / "config"
FAST = 5.0
"""How fast simulated time runs."""
PATIENT = 2.0
"""Timeouts, s of simulated time: a machine that is busy for a moment is not to look like a fault."""

MANIFEST = f"""
groups:
  robot:
    params:
      - {{world: {CONFIG}/hall.yaml, file: {CONFIG}/course.yaml, publish_clock: true, real_time_factor: {FAST}}}
      - {{cmd_vel_timeout: {PATIENT}, velocity_timeout: {PATIENT}, command_timeout: {PATIENT}}}
      - {{scan_timeout: {PATIENT}, odom_timeout: {PATIENT}, command_source: safety_monitor}}
    nodes:
      diff_drive_sim: {{service: robo_services.diff_drive_sim}}
      safety_monitor: {{service: robo_services.safety_monitor, params: {{use_sim_time: true}}}}
      velocity_smoother:
        service: robo_services.velocity_smoother
        remap: {{cmd_vel: cmd_vel_nav, cmd_vel_smoothed: cmd_vel_raw}}
        params: {{use_sim_time: true}}
      waypoint_follower:
        service: robo_services.waypoint_follower
        remap: {{cmd_vel: cmd_vel_nav}}
        params: {{use_sim_time: true, speed: 0.8}}
        needs: {{velocity_smoother: ready, safety_monitor: ready, diff_drive_sim: ready}}
"""


@pytest.mark.timeout(120)
def test_the_course_of_twenty_waypoints_is_reached(launch: Launch, tmp_path: Path) -> None:
    (tmp_path / "hall.yaml").write_text(MANIFEST)
    robot = launch(tmp_path / "hall.yaml")
    robot.wait_for("follower_state", lambda state: state.values[0].value == "finished", timeout=90.0)
    track = [one.pose.pose.position for one in robot.messages("odom")]
    course = courses.load(str(CONFIG / "course.yaml"))
    misses = [min(math.hypot(p.x - w.x, p.y - w.y) for p in track) for w in course.waypoints]
    assert len(misses) == 20
    assert max(misses) <= 0.25, misses
    hall = world.load(str(CONFIG / "hall.yaml"))
    nearest = min(world.clearance(hall.segments(), hall.circles, p.x, p.y) for p in track)
    assert nearest > 0.2 + 0.3, "the base has a radius of 0.2 m"
    print(f"largest miss {max(misses):.3f} m, clearance {nearest:.3f} m, {len(track) / 50:.1f} s")
    assert "pushes against" not in robot.output
