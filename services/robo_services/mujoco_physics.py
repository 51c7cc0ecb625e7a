"""A base and its laser in MuJoCo: stepped from outside, and for the same steps the same to the last bit.

    base = MujocoBase(world_mjcf(…), robot_mjcf(…), limits, drive, Pose2())
    base.step(0.5, 0.0, 0.02)                       # as `SimulatedBase`: m/s, rad/s, s
    base.pose, base.wheels, base.imu                # where it truly is; how far its wheels have turned; what it feels

MuJoCo and numpy are imported when a base is made, not with this module.
"""

import importlib
import importlib.util
import math
from pathlib import Path
from typing import Any, NamedTuple

from robo.errors import RunError
from robo.tf import Transform3
from robo_services import mjcf
from robo_services.drives import DiffDrive, Wheels
from robo_services.kinematics import Pose2, Twist2
from robo_services.limits import clamp, ramp
from robo_services.simulated_base import BaseLimits

MISSING = "needs MuJoCo, which is not installed: pip install 'robo-zenoh[mujoco]'"
PREFIX = "robot/"
"""Before every name of the robot's, so that a world may have the same ones."""
SETTLING = 0.1
"""For so long it stands before anything is reckoned, s."""
TIMESTEP = 0.002
"""Of the physics, s; no longer than this unless somebody says so."""

_SEEN, _HIDDEN, _ROBOT = (0, 1), 2, 2
"""Groups of geoms: those that a laser sees; a world's may not be in the robot's."""
_INTEGRAL, _NEAR = 10.0, 1.0
"""Of the motors' controllers: by how much of an error they add, 1/s, and up to which error, rad/s."""
_STEEP = 0.7
"""A contact whose normal leans less, as the part of it that points up, is with something that stands around."""


class ModelError(RunError):
    """A world or a robot is none for MuJoCo, or lacks something; says what."""


class Diverged(RunError):
    """The physics has come to numbers that mean nothing."""


class Imu(NamedTuple):
    """What an inertial measurement unit measures, in the frame of its site."""

    orientation: tuple[float, float, float, float]
    """From the world's axes to its own, x, y, z, w."""
    angular_velocity: tuple[float, float, float]
    """rad/s, the mean over the last step."""
    linear_acceleration: tuple[float, float, float]
    """m/s², likewise; at rest 9.81 upwards."""


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
        why = MISSING if not is_installed() else f"needs MuJoCo, which cannot be imported: {error}"
        raise RunError(f"mujoco_sim {why}") from None


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
        """In how many steps of the physics it has touched something that stands around."""
        self.bumped = False
        """Whether it did in the last step."""
        self._limits, self._drive, self._timestep = limits, drive, timestep
        self._at = _Places(mujoco, self.model)
        self._commanded, self._added = Twist2(), [0.0, 0.0]
        self._felt = [0.0] * 6
        self.reset()

    def reset(self) -> None:
        """Back to where it began, standing still, with its weight on its wheels."""
        self.model.opt.timestep = self._timestep
        self.mujoco.mj_resetData(self.model, self.data)
        self.mujoco.mj_step(self.model, self.data, math.ceil(SETTLING / self._timestep))
        self.data.time = 0.0
        self.bumped, self.touches = False, 0
        self._commanded, self._added = Twist2(), [0.0, 0.0]
        self._felt = [float(value) for value in self.data.sensordata[self._at.sensors]]

    def step(self, linear: float, angular: float, dt: float) -> None:
        """Drive for `dt` s towards the wanted velocities (m/s, rad/s).

        Raises:
            Diverged: the physics has come to nothing.
        """
        mujoco, model, data, places = self.mujoco, self.model, self.data, self._at
        substeps = max(1, math.ceil(dt / self._timestep - 1e-9))
        short = model.opt.timestep = dt / substeps
        felt = 0.0
        touches = self.touches
        for _ in range(substeps):
            self._commanded = self._towards(linear, angular, short)
            self._tell_motors(self._drive.wheels(self._commanded), short)
            mujoco.mj_step(model, data)
            felt = felt + data.sensordata[places.sensors]
            if places.touching(data.contact):
                self.touches += 1
        self.bumped = self.touches > touches
        self._felt = [float(value) / substeps for value in felt]  # type: ignore[attr-defined]
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

    @property
    def imu(self) -> Imu:
        """What its inertial measurement unit has felt in the last step."""
        w, x, y, z = self.data.sensordata[self._at.orientation].tolist()
        a, b, c, d, e, f = self._felt
        return Imu((x, y, z, w), (a, b, c), (d, e, f))

    def site(self, name: str) -> Transform3 | None:
        """Where a site of the robot's stands in its base; None where there is none."""
        number = self.mujoco.mj_name2id(self.model, self.mujoco.mjtObj.mjOBJ_SITE, PREFIX + name)
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
        w, x, y, z = turned.tolist()
        there = Transform3(*position.tolist(), x, y, z, w)
        w, x, y, z = self.data.xquat[self._at.base].tolist()
        return Transform3(*self.data.xpos[self._at.base].tolist(), x, y, z, w).inverse() @ there

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
        self._site = base.mujoco.mj_name2id(base.model, base.mujoco.mjtObj.mjOBJ_SITE, PREFIX + mjcf.LASER)
        if self._site < 0:
            raise ModelError(f"the robot has no site {mjcf.LASER!r}, from which its laser looks")
        angles = self.angle_min + np.arange(rays) * self.angle_increment
        self._directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(rays)], axis=1)
        self._groups = np.array([group in _SEEN for group in range(6)], dtype=np.uint8)
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
        first = model.sensor_adr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, _GYRO)]
        self.sensors, self.orientation = slice(first, first + 6), slice(first + 6, first + 10)
        self._of_robot = model.body_rootid[model.geom_bodyid] == model.body_rootid[base]
        self._stands = ~self._of_robot & (model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE))
        # What the robot's geoms are not in, a laser may see: it never sees its own robot, nor what is invisible.
        groups = model.geom_group
        visible = groups <= _HIDDEN
        groups[self._of_robot & visible] = _ROBOT
        groups[~self._of_robot & (groups == _ROBOT)] = _SEEN[-1]
        self._abs = np.abs

    def touching(self, contacts: Any) -> bool:
        """Whether the robot touches what stands around."""
        pairs = contacts.geom
        if not self._stands[pairs].any():
            return False  # it is on the floor, as nearly always
        mine = self._of_robot[pairs]
        steep = self._abs(contacts.frame[:, 2]) < _STEEP
        return bool((steep & (mine[:, 0] != mine[:, 1]) & (contacts.dist <= 0.0)).any())


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


_GYRO, _ACCELERATION, _ORIENTATION = (f"robo/{name}" for name in ("gyro", "acceleration", "orientation"))


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
        kinds = mujoco.mjtSensor
        for name, kind in (
            (_GYRO, kinds.mjSENS_GYRO), (_ACCELERATION, kinds.mjSENS_ACCELEROMETER),
            (_ORIENTATION, kinds.mjSENS_FRAMEQUAT),
        ):  # fmt: skip
            whole.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=PREFIX + mjcf.IMU)
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
