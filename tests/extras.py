"""Tests that need an extra which not everybody installs."""

import pytest

from robo.packages.absent import absent
from robo_services.mujoco_physics import REQUIRES

HAS_MUJOCO = not absent(REQUIRES)
needs_mujoco = pytest.mark.skipif(not HAS_MUJOCO, reason="MuJoCo is not installed: pip install 'robo-zenoh[mujoco]'")
HAS_RAY = not absent({"ray": "robo-zenoh[ray]"})
needs_ray = pytest.mark.skipif(not HAS_RAY, reason="Ray is not installed: pip install 'robo-zenoh[ray]'")
needs_cryptography = pytest.mark.skipif(
    bool(absent({"cryptography": "robo-zenoh[security]"})),
    reason="cryptography is not installed: pip install 'robo-zenoh[security]'",
)
