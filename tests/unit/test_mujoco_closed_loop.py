"""With the chain a robot in MuJoCo touches nothing in random worlds; without it it does."""

import os
import random

import pytest

from robo_services import mjcf
from robo_services.kinematics import Pose2
from robo_services.mujoco_laser import MujocoLaser
from robo_services.mujoco_physics import MujocoBase
from robo_services.simulated_base import DRIVE, BaseLimits
from robo_services.world import World
from tests.closed_loop import RADIUS, VARIANTS, Loop, Scanner
from tests.extras import needs_mujoco

pytestmark = needs_mujoco

SEED = int(os.environ.get("CLOSED_LOOP_SEED") or random.SystemRandom().randrange(10**9))
WORLDS = int(os.environ.get("CLOSED_LOOP_WORLDS") or 20)
ROBOT = mjcf.robot_mjcf(mjcf.Robot(radius=RADIUS, wheel_radius=DRIVE.wheel_radius, wheel_separation=0.3))


class Laser:
    """MuJoCo's laser looks from where the base is."""

    def __init__(self, base: MujocoBase, seed: int) -> None:
        self._laser = MujocoLaser(base, rays=360, range_min=0.05, range_max=12.0, noise=0.005, seed=seed)
        self.angle_min, self.angle_increment = self._laser.angle_min, self._laser.angle_increment
        self.range_min, self.range_max = self._laser.range_min, self._laser.range_max

    def scan(self, pose: Pose2) -> list[float]:  # noqa: ARG002 - it is there
        return self._laser.scan()


class MujocoLoop(Loop):
    """One drive, with MuJoCo's wheels, walls and rays in place of the simulated base and its laser."""

    def new_base(self, limits: BaseLimits, pose: Pose2) -> MujocoBase:
        self.physics = MujocoBase(mjcf.world_mjcf(self.world, friction=1.0), ROBOT, limits, DRIVE, pose)
        return self.physics

    def _laser_in(self, world: World) -> Scanner:  # noqa: ARG002 - it is the base's
        return Laser(self.physics, self.rng.randrange(2**32))


@pytest.mark.timeout(120 + 5 * WORLDS)
@pytest.mark.parametrize("name", ["plain", "late scans", "slow laser"])
def test_with_the_chain_nothing_is_touched(name: str) -> None:
    again = f"again by CLOSED_LOOP_SEED={SEED} CLOSED_LOOP_WORLDS={WORLDS}"
    driven = 0.0
    for seed in range(SEED, SEED + WORLDS):
        loop = MujocoLoop(VARIANTS[name], seed)
        drive = loop.drive()
        assert not drive.touched, f"{name}: touched in the drive of the seed {seed}; {again}"
        assert not loop.physics.touches, f"{name}: MuJoCo says that it touched something, seed {seed}; {again}"
        driven += drive.driven
    assert driven > 0.1 * WORLDS, f"{name}: it has hardly moved; {again}"


@pytest.mark.timeout(120 + 5 * WORLDS)
def test_without_the_chain_things_are_touched() -> None:
    loops = [MujocoLoop(VARIANTS["without"], seed) for seed in range(SEED, SEED + WORLDS)]
    touched = [loop.drive().touched for loop in loops]
    assert sum(touched) > WORLDS / 5, f"CLOSED_LOOP_SEED={SEED}"
    assert any(loop.physics.touches for loop in loops)


def test_the_same_seed_is_the_same_drive() -> None:
    first, second = MujocoLoop(VARIANTS["plain"], SEED), MujocoLoop(VARIANTS["plain"], SEED)
    assert first.drive() == second.drive()
    assert first.physics.data.qpos.tobytes() == second.physics.data.qpos.tobytes()
