"""What a robot in MuJoCo senses: an inertial measurement unit, and a laser by MuJoCo's ray casting."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from robo.errors import RunError
from robo_services import mjcf

if TYPE_CHECKING:
    from robo_services.mujoco_physics import MujocoBase

SEEN = (0, 1)
"""The groups of geoms that a laser sees."""
_GYRO, _VELOCITY, _ORIENTATION = (f"robo/{name}" for name in ("gyro", "velocity", "orientation"))


class ModelError(RunError):
    """A world or a robot is none for MuJoCo, or lacks something; says what."""


class Imu(NamedTuple):
    """What an inertial measurement unit measures, in the frame of its site."""

    orientation: tuple[float, float, float, float]
    """From the world's axes to its own, x, y, z, w."""
    angular_velocity: tuple[float, float, float]
    """rad/s, the mean over the last step."""
    linear_acceleration: tuple[float, float, float]
    """m/s², likewise; at rest 9.81 upwards."""


def add_sensors(mujoco: Any, spec: Any, site: str) -> None:
    """Let a model tell how one of its sites moves."""
    kinds, of_site = mujoco.mjtSensor, mujoco.mjtObj.mjOBJ_SITE
    spec.add_sensor(name=_GYRO, type=kinds.mjSENS_GYRO, objtype=of_site, objname=site)
    spec.add_sensor(name=_VELOCITY, type=kinds.mjSENS_VELOCIMETER, objtype=of_site, objname=site)
    spec.add_sensor(name=_ORIENTATION, type=kinds.mjSENS_FRAMEQUAT, objtype=of_site, objname=site)


class Feeling:
    """An inertial measurement unit: means over a step, of what it is at several times within.

    MuJoCo's accelerometer says what is at one instant, and motors that are told something new every few
    milliseconds jerk. So the acceleration is that by which the velocity has changed over the step: in axes that turn,
    dv/dt + w x v, and what holds it against gravity.
    """

    def __init__(self, mujoco: Any, model: Any, data: Any, site: str) -> None:
        self._model, self._data = model, data
        self._site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site)
        first = int(model.sensor_adr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, _GYRO)])
        self._motion, self._orientation = slice(first, first + 6), slice(first + 6, first + 10)

    def begin_anew(self) -> Imu:
        """Forget what was."""
        self._looks: list[tuple[float, ...]] = []
        self._velocity = self._data.sensordata[self._motion].tolist()[3:]
        return self._imu((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    def look(self) -> None:
        """Take note of how it moves now."""
        a, b, c, x, y, z = self._data.sensordata[self._motion].tolist()
        self._looks.append((a, b, c, b * z - c * y, c * x - a * z, a * y - b * x, x, y, z))

    def felt(self, dt: float) -> Imu:
        """What it has felt since the last time, `dt` s ago."""
        count = len(self._looks)
        a, b, c, *swung = (sum(column) / count for column in list(zip(*self._looks, strict=True))[:6])
        before, self._velocity = self._velocity, list(self._looks[-1][6:])
        self._looks.clear()
        x, y, z = ((new - old) / dt + swing for old, new, swing in zip(before, self._velocity, swung, strict=True))
        return self._imu((a, b, c), (x, y, z))

    def _imu(self, turning: tuple[float, float, float], speeding: tuple[float, float, float]) -> Imu:
        w, i, j, k = self._data.sensordata[self._orientation].tolist()
        down = (self._data.site_xmat[self._site].reshape(3, 3).T @ self._model.opt.gravity).tolist()
        x, y, z = (change - pull for change, pull in zip(speeding, down, strict=True))
        return Imu((i, j, k, w), turning, (x, y, z))


class MujocoLaser:
    """A planar laser that looks all around from the robot's site, by MuJoCo's ray casting."""

    def __init__(
        self, base: "MujocoBase", *, rays: int, range_min: float, range_max: float, noise: float, seed: int
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
