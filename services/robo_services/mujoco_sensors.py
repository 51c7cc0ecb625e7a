"""What a robot in MuJoCo senses of its own motion, and what its sensors may lack."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from robo.errors import RunError

SEEN = (0, 1)
"""The groups of geoms that a laser sees."""
_GYRO, _VELOCITY = "robo/gyro", "robo/velocity"


class ModelError(RunError):
    """A world or a robot is none for MuJoCo, or lacks something; says what."""


class Imu(NamedTuple):
    """What an inertial measurement unit measures, in the frame of its site."""

    orientation: tuple[float, float, float, float]
    """From the world's axes to its own at the end of the last step, x, y, z, w."""
    angular_velocity: tuple[float, float, float]
    """rad/s, the mean over the last step."""
    linear_acceleration: tuple[float, float, float]
    """m/s², likewise; at rest 9.81 upwards."""


def add_sensors(mujoco: Any, spec: Any, site: str) -> None:
    """Let a model tell how one of its sites moves."""
    kinds, of_site = mujoco.mjtSensor, mujoco.mjtObj.mjOBJ_SITE
    spec.add_sensor(name=_GYRO, type=kinds.mjSENS_GYRO, objtype=of_site, objname=site)
    spec.add_sensor(name=_VELOCITY, type=kinds.mjSENS_VELOCIMETER, objtype=of_site, objname=site)


class Feeling:
    """An inertial measurement unit: means over a step, of what it is at several times within.

    MuJoCo's accelerometer says what is at one instant, and motors that are told something new every few
    milliseconds jerk. So the acceleration is that by which the velocity has changed over the step: in axes that turn,
    dv/dt + w x v, and what holds it against gravity.
    """

    def __init__(self, mujoco: Any, model: Any, data: Any, site: str) -> None:
        import numpy as np

        self._turned = np.zeros(4)
        self._mujoco, self._model, self._data = mujoco, model, data
        self._site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site)
        first = int(model.sensor_adr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, _GYRO)])
        self._motion = slice(first, first + 6)

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
        self._mujoco.mj_kinematics(self._model, self._data)  # sites stand where they were before the last step
        axes = self._data.site_xmat[self._site]
        self._mujoco.mju_mat2Quat(self._turned, axes)
        w, i, j, k = self._turned.tolist()
        down = (axes.reshape(3, 3).T @ self._model.opt.gravity).tolist()
        x, y, z = (change - pull for change, pull in zip(speeding, down, strict=True))
        return Imu((i, j, k, w), turning, (x, y, z))


def mean(felt: Sequence[Imu]) -> Imu:
    """Of several steps of the same length, as if they had been one."""
    turning, pulling = (
        [sum(column) / len(felt) for column in zip(*vectors, strict=True)]
        for vectors in ([one.angular_velocity for one in felt], [one.linear_acceleration for one in felt])
    )
    return Imu(felt[-1].orientation, (turning[0], turning[1], turning[2]), (pulling[0], pulling[1], pulling[2]))
