"""A base in MuJoCo: stepped from outside, and for the same steps the same to the last bit.

    base = MujocoBase(world_mjcf(…), robot_mjcf(…), limits, drive, Pose2())
    base.step(0.5, 0.0, 0.02)                       # as `SimulatedBase`: m/s, rad/s, s
    base.pose, base.wheels, base.imu                # where it truly is; how far its wheels have turned; what it feels

MuJoCo and numpy are imported when a base is made, not with this module.
"""

import importlib
import math
import os
from pathlib import Path
from typing import Any

from robo.errors import RunError
from robo.packages.absent import absent
from robo.tf import Transform3
from robo_services import mjcf
from robo_services.drives import DiffDrive, Wheels
from robo_services.kinematics import Pose2, Twist2
from robo_services.limits import clamp, ramp
from robo_services.mujoco_drawing import VARIABLE, choose_drawing
from robo_services.mujoco_robot import PREFIX, Places, model_of, one_line
from robo_services.mujoco_sensors import Feeling, Imu
from robo_services.simulated_base import BaseLimits

LOOK = 0.01
"""How often the motors' controllers, the inertial measurement unit and what is touched are looked at, s."""
SETTLING = 0.1
"""For so long it stands before anything is reckoned, s."""
TIMESTEP = 0.002
"""Of the physics, s; no longer than this unless somebody says so."""

_INTEGRAL, _NEAR = 10.0, 1.0
"""Of the motors' controllers: by how much of an error they add, 1/s, and up to which error, rad/s."""

REQUIRES = {"mujoco": "robo-zenoh[mujoco]"}


class Diverged(RunError):
    """The physics has come to numbers that mean nothing."""


def import_mujoco() -> Any:
    """The module of MuJoCo.

    Raises:
        RunError: it is not installed, and names the extra; or it cannot be imported, and says why.
    """
    choose_drawing()
    try:
        return importlib.import_module("mujoco")
    except Exception as error:  # what is to draw is imported with it, and has errors of its own
        way = os.environ.get(VARIABLE)
        asked = f"; {VARIABLE} is {way!r}: it may be egl, osmesa or glfw, or not be said" if way else ""
        why = absent(REQUIRES) or [f"needs MuJoCo, which cannot be imported: {one_line(error)}{asked}"]
        raise RunError(f"mujoco_sim {why[0]}") from None


class MujocoBase:
    """A differential drive in MuJoCo, as `SimulatedBase` for whoever drives it."""

    def __init__(
        self,
        world: str | Path,
        robot: str | Path,
        limits: BaseLimits,
        drive: DiffDrive,
        pose: Pose2,
        *,
        timestep: float = TIMESTEP,
    ) -> None:
        """
        Args:
            world: MJCF, or a file with it.
            robot: likewise; see `mjcf` for the names that it needs.
            limits: what the base's controller does with a velocity; its `radius` is not used.
            drive: the base's wheels.
            pose: where it begins.
            timestep: the longest step of the physics, s.

        Raises:
            ModelError: the world or the robot is none.
            RunError: MuJoCo is not installed.
        """
        self.mujoco = mujoco = import_mujoco()
        mujoco.set_mju_user_warning(_ignore)  # else it writes a file into the current folder; `_check` asks instead
        self.model = model_of(mujoco, world, robot, pose)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.data = mujoco.MjData(self.model)
        self.touches = 0
        """How often it was seen to touch something that stands around, of the looks at it."""
        self.bumped = False
        """Whether it did in the last step."""
        self.imu: Imu
        """What its inertial measurement unit has felt in the last step."""
        self._limits, self._drive, self._timestep = limits, drive, timestep
        self._at = Places(mujoco, self.model, self.data)
        self.starts_inside = self._at.starts_inside
        """Whether the robot stands in something at the start."""
        self._feeling = Feeling(mujoco, self.model, self.data, PREFIX + mjcf.IMU)
        self._commanded, self._added = Twist2(), [0.0, 0.0]
        self.reset()

    def reset(self) -> None:
        """Back to where it began, standing still, with its weight on its wheels."""
        self.model.opt.timestep = self._timestep
        self.mujoco.mj_resetData(self.model, self.data)
        self.mujoco.mj_step(self.model, self.data, math.ceil(SETTLING / self._timestep))
        self.data.time = 0.0
        self.bumped, self.touches = False, 0
        self._commanded, self._added = Twist2(), [0.0, 0.0]
        self.imu = self._feeling.begin_anew()

    def step(self, linear: float, angular: float, dt: float) -> None:
        """Drive for `dt` s towards the wanted velocities (m/s, rad/s).

        Raises:
            Diverged: the physics has come to nothing.
        """
        mujoco, model, data, places = self.mujoco, self.model, self.data, self._at
        looks = max(1, round(dt / LOOK))
        steps = max(1, math.ceil(dt / looks / self._timestep - 1e-9))
        model.opt.timestep = dt / looks / steps
        touches = self.touches
        for _ in range(looks):
            self._commanded = self._towards(linear, angular, dt / looks)
            self._tell_motors(self._drive.wheels(self._commanded), dt / looks)
            mujoco.mj_step(model, data, steps)
            self._feeling.look()
            self.touches += places.touching(data.contact)
        self.bumped = self.touches > touches
        self.imu = self._feeling.felt(dt)
        self._check()

    @property
    def time(self) -> float:
        """Simulated since the last reset, s."""
        return float(self.data.time)

    @property
    def pose(self) -> Pose2:
        """Where it truly is."""
        x, y, _, w, i, j, k = self.data.qpos[self._at.base_position].tolist()
        return Pose2(x, y, math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k)))

    @property
    def linear(self) -> float:
        """How fast it truly moves ahead, m/s."""
        vx, vy = self.data.qvel[self._at.base_velocity][:2].tolist()
        yaw = self.pose.yaw
        return float(vx * math.cos(yaw) + vy * math.sin(yaw))

    @property
    def sideways(self) -> float:
        """How fast it slides to the left, m/s."""
        vx, vy = self.data.qvel[self._at.base_velocity][:2].tolist()
        yaw = self.pose.yaw
        return float(vy * math.cos(yaw) - vx * math.sin(yaw))

    @property
    def angular(self) -> float:
        """How fast it truly turns, rad/s."""
        return float(self.data.qvel[self._at.base_velocity][5])

    @property
    def wheels(self) -> Wheels:
        """How far they have turned, rad."""
        return Wheels(float(self.data.qpos[self._at.left]), float(self.data.qpos[self._at.right]))

    @property
    def wheel_velocities(self) -> Wheels:
        """rad/s."""
        return Wheels(float(self.data.qvel[self._at.left_velocity]), float(self.data.qvel[self._at.right_velocity]))

    @property
    def wheel_torques(self) -> Wheels:
        """Of the motors, N·m."""
        force = self.data.actuator_force
        return Wheels(float(force[self._at.left_motor]), float(force[self._at.right_motor]))

    def number_of_site(self, name: str) -> int:
        """MuJoCo's number of a site of the robot's; -1 where there is none."""
        return int(self.mujoco.mj_name2id(self.model, self.mujoco.mjtObj.mjOBJ_SITE, PREFIX + name))

    def site(self, name: str) -> Transform3 | None:
        """Where a site of the robot's stands in its base; None where there is none."""
        number = self.number_of_site(name)
        self._look_around()
        return self._in_base(self.data.site_xpos[number], self.data.site_xmat[number]) if number >= 0 else None

    def camera(self, name: str) -> Transform3 | None:
        """Where a camera's picture stands in the base: z into it, x right, y down; None where there is none."""
        number = self.mujoco.mj_name2id(self.model, self.mujoco.mjtObj.mjOBJ_CAMERA, PREFIX + name)
        if number < 0:
            return None
        self._look_around()
        # MuJoCo's cameras look along -z, with y up.
        return self._in_base(self.data.cam_xpos[number], self.data.cam_xmat[number]) @ Transform3(qx=1.0, qw=0.0)

    @property
    def tilt(self) -> float:
        """How far it leans to any side, 0 to pi rad."""
        *_, i, j, _ = self.data.qpos[self._at.base_position].tolist()
        return 2 * math.asin(min(1.0, math.hypot(i, j)))

    def _look_around(self) -> None:
        """Let MuJoCo say where everything is; after a step it says it of the time before that."""
        self.mujoco.mj_kinematics(self.model, self.data)
        self.mujoco.mj_camlight(self.model, self.data)

    def _in_base(self, position: Any, rotation: Any) -> Transform3:
        import numpy as np

        turned = np.zeros(4)
        self.mujoco.mju_mat2Quat(turned, rotation)
        there = _transform(position.tolist(), turned.tolist())
        base = _transform(self.data.xpos[self._at.base].tolist(), self.data.xquat[self._at.base].tolist())
        return base.inverse() @ there

    def _towards(self, linear: float, angular: float, dt: float) -> Twist2:
        """What the base's controller asks of the wheels, `dt` s later."""
        limits, now = self._limits, self._commanded
        turning, change = clamp(angular, limits.max_angular_velocity), limits.angular_acceleration
        driving = clamp(linear, limits.max_linear_velocity)
        return Twist2(
            ramp(now.linear, driving, dt, limits.linear_acceleration, limits.linear_deceleration),
            ramp(now.angular, turning, dt, change, change),
        )

    def _tell_motors(self, wanted: Wheels, dt: float) -> None:
        """A motor's controller adds up by how much its wheel is too slow, so that it is not slower under a load."""
        places, data = self._at, self.data
        for side, (target, velocity, motor) in enumerate(
            (
                (wanted.left, places.left_velocity, places.left_motor),
                (wanted.right, places.right_velocity, places.right_motor),
            )
        ):
            error = target - data.qvel[velocity].item()
            if abs(error) < _NEAR:
                self._added[side] = clamp(self._added[side] + _INTEGRAL * error * dt, _NEAR)
            data.ctrl[motor] = target + self._added[side]

    def _check(self) -> None:
        bad = self.mujoco.mjtWarning
        if any(
            self.data.warning[int(one)].number for one in (bad.mjWARN_BADQPOS, bad.mjWARN_BADQVEL, bad.mjWARN_BADQACC)
        ):
            raise Diverged(f"the physics has come to numbers that mean nothing after {self.data.time:.3f} s")


def _transform(position: list[float], rotation: list[float]) -> Transform3:
    """From a place and a quaternion in MuJoCo's order, w, x, y, z."""
    (x, y, z), (w, i, j, k) = position, rotation
    return Transform3(x, y, z, i, j, k, w)


def _ignore(_text: str) -> None:
    """MuJoCo's warnings; those that count are counted in its data."""
