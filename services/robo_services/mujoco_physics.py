"""A base in MuJoCo: stepped from outside, and for the same steps the same to the last bit.

    base = MujocoBase(world_mjcf(…), robot_mjcf(…), limits, drive, Pose2())
    base.step(0.5, 0.0, 0.02)                       # as `SimulatedBase`: m/s, rad/s, s
    base.pose, base.wheels, base.imu                # where it truly is; how far its wheels have turned; what it feels

MuJoCo and numpy are imported when a base is made, not with this module.
"""

import importlib
import importlib.util
import math
from pathlib import Path
from typing import Any

from robo.errors import RunError
from robo.packages.absent import absent
from robo.tf import Transform3
from robo_services import mjcf
from robo_services.drives import DiffDrive, Wheels
from robo_services.kinematics import Pose2, Twist2
from robo_services.limits import clamp, ramp
from robo_services.mujoco_sensors import SEEN, Feeling, Imu, ModelError, add_sensors
from robo_services.simulated_base import BaseLimits

PREFIX = "robot/"
"""Before every name of the robot's, so that a world may have the same ones."""
LOOK = 0.01
"""How often the motors' controllers, the inertial measurement unit and what is touched are looked at, s."""
SETTLING = 0.1
"""For so long it stands before anything is reckoned, s."""
TIMESTEP = 0.002
"""Of the physics, s; no longer than this unless somebody says so."""

_VISIBLE, _ROBOT = 2, 2
"""Groups of geoms: the last one that is shown, and that of the robot; a world's are moved out of that."""
_INTEGRAL, _NEAR = 10.0, 1.0
"""Of the motors' controllers: by how much of an error they add, 1/s, and up to which error, rad/s."""
_STEEP = 0.7
"""A contact whose normal leans less, as the part of it that points up, is with something that stands around."""


REQUIRES = {"mujoco": "robo-zenoh[mujoco]"}


class Diverged(RunError):
    """The physics has come to numbers that mean nothing."""


def is_installed() -> bool:
    """Whether MuJoCo is there; it is not imported."""
    return importlib.util.find_spec("mujoco") is not None


def import_mujoco() -> Any:
    """The module of MuJoCo.

    Raises:
        RunError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        missing = absent(REQUIRES) or [f"needs MuJoCo, which cannot be imported: {error}"]
        raise RunError(f"mujoco_sim {missing[0]}") from None


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
        self.model = _model(mujoco, world, robot, pose)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.data = mujoco.MjData(self.model)
        self.touches = 0
        """How often it was seen to touch something that stands around, of the looks at it."""
        self.bumped = False
        """Whether it did in the last step."""
        self.imu: Imu
        """What its inertial measurement unit has felt in the last step."""
        self._limits, self._drive, self._timestep = limits, drive, timestep
        self._at = _Places(mujoco, self.model)
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
        return self._in_base(self.data.site_xpos[number], self.data.site_xmat[number]) if number >= 0 else None

    def camera(self, name: str) -> Transform3 | None:
        """Where a camera's picture stands in the base: z into it, x right, y down; None where there is none."""
        number = self.mujoco.mj_name2id(self.model, self.mujoco.mjtObj.mjOBJ_CAMERA, PREFIX + name)
        if number < 0:
            return None
        # MuJoCo's cameras look along -z, with y up.
        return self._in_base(self.data.cam_xpos[number], self.data.cam_xmat[number]) @ Transform3(qx=1.0, qw=0.0)

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


class _Places:
    """Where in MuJoCo's arrays the robot is."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        import numpy as np

        base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, PREFIX + mjcf.BASE)
        free = model.body_jntadr[base]
        if free < 0 or model.jnt_type[free] != mujoco.mjtJoint.mjJNT_FREE:
            raise ModelError(f"the robot's body {mjcf.BASE!r} has no free joint")
        position, velocity = model.jnt_qposadr[free], model.jnt_dofadr[free]
        self.base = base
        self.base_position = slice(position, position + 7)
        self.base_velocity = slice(velocity, velocity + 6)
        self.left, self.left_velocity, self.left_motor = _wheel(mujoco, model, mjcf.LEFT)
        self.right, self.right_velocity, self.right_motor = _wheel(mujoco, model, mjcf.RIGHT)
        self._of_robot = model.body_rootid[model.geom_bodyid] == model.body_rootid[base]
        self._stands = ~self._of_robot & (model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE))
        # What the robot's geoms are not in, a laser may see: it never sees its own robot, nor what is invisible.
        groups = model.geom_group
        visible = groups <= _VISIBLE
        groups[self._of_robot & visible] = _ROBOT
        groups[~self._of_robot & (groups == _ROBOT)] = SEEN[-1]
        self._abs = np.abs

    def touching(self, contacts: Any) -> bool:
        """Whether the robot touches what stands around."""
        pairs = contacts.geom
        if not self._stands[pairs].any():
            return False  # it is on the floor, as nearly always
        mine = self._of_robot[pairs]
        steep = self._abs(contacts.frame[:, 2]) < _STEEP
        return bool((steep & (mine[:, 0] != mine[:, 1]) & (contacts.dist <= 0.0)).any())


def _transform(position: list[float], rotation: list[float]) -> Transform3:
    """From a place and a quaternion in MuJoCo's order, w, x, y, z."""
    (x, y, z), (w, i, j, k) = position, rotation
    return Transform3(x, y, z, i, j, k, w)


def _wheel(mujoco: Any, model: Any, name: str) -> tuple[int, int, int]:
    """The places of a wheel's position, of its velocity and of its motor."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, PREFIX + name)
    if joint < 0:
        raise ModelError(f"the robot has no joint {name!r}; it needs {mjcf.LEFT} and {mjcf.RIGHT}")
    of_joints = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    (motors,) = (of_joints & (model.actuator_trnid[:, 0] == joint)).nonzero()
    if len(motors) != 1:
        raise ModelError(f"the robot's joint {name!r} has {len(motors)} actuators; it needs one that takes a velocity")
    return int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint]), int(motors[0])


def _model(mujoco: Any, world: str | Path, robot: str | Path, pose: Pose2) -> Any:
    """Both as one model, with the sensors of an inertial measurement unit."""
    whole, part = _spec(mujoco, world, "world"), _spec(mujoco, robot, "robot")
    try:
        turned = [math.cos(pose.yaw / 2), 0.0, 0.0, math.sin(pose.yaw / 2)]
        frame = whole.worldbody.add_frame(pos=[pose.x, pose.y, 0.0], quat=turned)
        whole.attach(part, prefix=PREFIX, frame=frame)
        base = whole.body(PREFIX + mjcf.BASE)
        if base is None:
            raise ModelError(f"the robot has no body {mjcf.BASE!r}")
        if PREFIX + mjcf.IMU not in {site.name for site in whole.sites}:
            base.add_site(name=PREFIX + mjcf.IMU)
        add_sensors(mujoco, whole, PREFIX + mjcf.IMU)
        return whole.compile()
    except (ValueError, KeyError) as error:
        raise ModelError(f"MuJoCo cannot put the robot into the world: {_line(error)}") from None


def _spec(mujoco: Any, source: str | Path, what: str) -> Any:
    try:
        if isinstance(source, Path):
            return mujoco.MjSpec.from_file(str(source))
        return mujoco.MjSpec.from_string(source)
    except ValueError as error:
        where = f"{what} file {source}" if isinstance(source, Path) else f"the {what}"
        raise ModelError(f"{where} is no model for MuJoCo: {_line(error)}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def _ignore(_text: str) -> None:
    """MuJoCo's warnings; those that count are counted in its data."""
