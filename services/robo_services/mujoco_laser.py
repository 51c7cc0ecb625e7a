"""A laser by MuJoCo's ray casting."""

import math

from robo_services import mjcf
from robo_services.mujoco_physics import MujocoBase
from robo_services.mujoco_sensors import SEEN, ModelError


class MujocoLaser:
    """A planar laser that looks all around from the robot's site, by MuJoCo's ray casting."""

    def __init__(
        self, base: MujocoBase, *, rays: int, range_min: float, range_max: float, noise: float, seed: int
    ) -> None:
        """`noise` is the standard deviation of a range, m; the same seed gives the same noise.

        Raises:
            ModelError: the robot has no site for it.
        """
        import numpy as np

        self.rays, self.range_min, self.range_max = rays, range_min, range_max
        self.angle_min = -math.pi
        self.angle_increment = math.tau / rays
        self._base, self._noise, self._seed = base, noise, seed
        self._site = base.number_of_site(mjcf.LASER)
        if self._site < 0:
            raise ModelError(f"the robot has no site {mjcf.LASER!r}, from which its laser looks")
        angles = self.angle_min + np.arange(rays) * self.angle_increment
        self._directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(rays)], axis=1)
        self._groups = np.array([group in SEEN for group in range(6)], dtype=np.uint8)
        self._met, self._ranges = np.zeros(rays, dtype=np.int32), np.zeros(rays)
        self._normals = [None] if "normal:" in base.mujoco.mj_multiRay.__doc__ else []  # since MuJoCo 3.5
        self.reset()

    def reset(self) -> None:
        """Let the noise begin anew."""
        import numpy as np

        self._random = np.random.default_rng(self._seed & (2**64 - 1))

    def scan(self) -> list[float]:
        """The ranges that are seen now, m; REP-117: -inf too close, +inf no return."""
        import numpy as np

        mujoco, model, data = self._base.mujoco, self._base.model, self._base.data
        mujoco.mj_kinematics(model, data)  # sites stand where they were before the last step
        turned = np.ascontiguousarray(self._directions @ data.site_xmat[self._site].reshape(3, 3).T)
        furthest = min(self.range_max, 1e6)
        mujoco.mj_multiRay(
            model, data, data.site_xpos[self._site], turned.reshape(-1), self._groups, True, -1, self._met,
            self._ranges, *self._normals, self.rays, furthest,
        )  # fmt: skip
        ranges = np.where((self._ranges < 0) | (self._ranges > furthest), np.inf, self._ranges)
        if self._noise:
            ranges = ranges + self._random.normal(0.0, self._noise, self.rays)
        seen = np.where(np.isfinite(ranges), np.minimum(ranges, self.range_max), np.inf)
        found: list[float] = np.where(seen < self.range_min, -np.inf, seen).tolist()
        return found
