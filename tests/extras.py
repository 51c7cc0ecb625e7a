"""Tests that need an extra which not everybody installs."""

import pytest

from robo.packages.absent import absent
from robo_services.mujoco_physics import REQUIRES

HAS_MUJOCO = not absent(REQUIRES)
needs_mujoco = pytest.mark.skipif(not HAS_MUJOCO, reason="MuJoCo is not installed: pip install 'robo-zenoh[mujoco]'")
