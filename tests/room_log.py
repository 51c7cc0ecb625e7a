"""Makes `logs/room.log.gz`, the log that ships: `python -m tests.room_log`.

The simulated base drives its circle through the simulated room once, without a network and without a clock. What its
odometry and its laser say is written as a CARMEN log. The same code gives the same file.
"""

import gzip
import math
from collections.abc import Iterator
from pathlib import Path

from robo_services import world
from robo_services.kinematics import Pose2
from robo_services.simulated_base import BaseLimits, SimulatedBase

LOG = Path(__file__).parents[1] / "logs" / "room.log.gz"

SECONDS = 32
STEPS = 50
"""A second; every fifth gives odometry, every tenth a scan."""
LINEAR, ANGULAR = 0.5, 0.2
"""m/s, rad/s: what the velocity controller commands by default."""


def lines() -> Iterator[str]:
    """The lines of the log: 10 ODOM and 5 FLASER a second."""
    room = world.load(str(LOG.parents[1] / "config" / "room.yaml"))
    limits = BaseLimits(
        radius=0.2,
        max_linear_velocity=1.5,
        max_angular_velocity=3.0,
        linear_acceleration=1.0,
        linear_deceleration=5.0,
        angular_acceleration=6.0,
    )
    base = SimulatedBase(room, limits, Pose2())
    # One ray a degree; those of a CARMEN log look to the front, from right to left.
    laser = world.Laser(room, rays=360, range_min=0.05, range_max=12.0, noise=0.005, seed=0)
    yield "# The simulated base in the simulated room: made by tests/room_log.py"
    for step in range(SECONDS * STEPS):
        time = f"{1 + step / STEPS:.6f} robo {1 + step / STEPS:.6f}"
        pose = f"{base.pose.x:.4f} {base.pose.y:.4f} {base.pose.yaw:.5f}"
        if step % 5 == 0:
            yield f"ODOM {pose} {base.linear:.4f} {base.angular:.4f} 0 {time}"
        if step % 10 == 0:
            ranges = laser.scan(base.pose)[90:271]
            assert all(map(math.isfinite, ranges)), "the room is closed"
            yield f"FLASER {len(ranges)} {' '.join(f'{r:.2f}' for r in ranges)} {pose} {pose} {time}"
        base.step(LINEAR, ANGULAR, 1 / STEPS)


if __name__ == "__main__":
    LOG.write_bytes(gzip.compress("".join(f"{line}\n" for line in lines()).encode(), mtime=0))
