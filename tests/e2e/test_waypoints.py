"""The course through the hall, driven by the processes of a robot: each waypoint is reached, and nothing is touched."""

import math
from itertools import pairwise
from pathlib import Path

import pytest

from robo.testing import Launch, Robot
from robo_messages import Point
from robo_services import courses, world

CONFIG = Path(__file__).parents[2] / "config"
FAST = 5.0
"""How fast simulated time runs."""
PATIENT = 2.0
"""Timeouts, s of simulated time: a machine that is busy for a moment is not to look like a fault."""

OPTIONS = [
    *("-p", "waypoint_follower.laps:=1", "-p", "waypoint_follower.speed:=0.8"),
    *("-p", f"waypoint_follower.odom_timeout:={PATIENT}"),
    *("-p", f"twist_mux.topics.autonomy.timeout:={PATIENT}"),
    *("-p", f"velocity_smoother.velocity_timeout:={PATIENT}"),
    *("-p", f"safety_monitor.command_timeout:={PATIENT}", "-p", f"safety_monitor.scan_timeout:={PATIENT}"),
    *("-p", f"diff_drive_sim.cmd_vel_timeout:={PATIENT}"),
]


LONGEST_STEP = 0.1
"""Between two positions that come one after the other, m: it drives 0.016 m from one to the next."""


def driven(launch: Launch) -> tuple[Robot, list[Point]]:
    """A robot that has driven its course, and where it was all the time."""
    for _ in range(3):
        robot = launch("robot.yaml", use_sim_time=True, real_time_factor=FAST, options=OPTIONS)
        robot.wait_for("follower_state", lambda state: state.values[0].value == "finished", timeout=90.0)
        track = [one.pose.pose.position for one in robot.messages("odom")]
        if all(math.hypot(b.x - a.x, b.y - a.y) < LONGEST_STEP for a, b in pairwise(track)):
            return robot, track
        # Who listens too slowly, as on a busy machine, is not waited for: where the robot was then is not known.
    pytest.fail("messages were lost on each of three drives")


@pytest.mark.timeout(300)
def test_the_course_of_twenty_waypoints_is_reached(launch: Launch) -> None:
    robot, track = driven(launch)
    course = courses.load(str(CONFIG / "course.yaml"))
    misses = [min(math.hypot(p.x - w.x, p.y - w.y) for p in track) for w in course.waypoints]
    assert len(misses) == 20
    assert max(misses) <= 0.25, misses
    hall = world.load(str(CONFIG / "hall.yaml"))
    nearest = min(world.clearance(hall.segments(), hall.circles, p.x, p.y) for p in track)
    assert nearest > 0.2 + 0.3, "the base has a radius of 0.2 m"
    print(f"largest miss {max(misses):.3f} m, clearance {nearest:.3f} m, {len(track) / 50:.1f} s")
    assert "pushes against" not in robot.output
