"""A robot in MuJoCo's world: how both become one model, and where in MuJoCo's arrays the robot is."""

import math
from pathlib import Path
from typing import Any

from robo_services import mjcf
from robo_services.kinematics import Pose2
from robo_services.mujoco_sensors import SEEN, ModelError, add_sensors

PREFIX = "robot/"
"""Before every name of the robot's, so that a world may have the same ones."""

_VISIBLE, _ROBOT = 2, 2
"""Groups of geoms: the last one that is shown, and that of the robot; a world's are moved out of that."""
_DEEP = 0.01
"""What is further than this within something at the start was put there, m."""
_STEEP = 0.7
"""A contact whose normal leans less, as the part of it that points up, is with something that stands around."""


class Places:
    """Where in MuJoCo's arrays the robot is."""

    def __init__(self, mujoco: Any, model: Any, data: Any) -> None:
        """`data`: as at the start.

        Raises:
            ModelError: it is no robot that can be driven; says what to write instead.
        """
        import numpy as np

        mujoco.mj_forward(model, data)
        base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, PREFIX + mjcf.BASE)
        free = model.body_jntadr[base]
        if free < 0 or model.jnt_type[free] != mujoco.mjtJoint.mjJNT_FREE:
            raise ModelError(f"the robot's body {mjcf.BASE!r} has no free joint")
        position, velocity = model.jnt_qposadr[free], model.jnt_dofadr[free]
        self.base = base
        self.base_position = slice(position, position + 7)
        self.base_velocity = slice(velocity, velocity + 6)
        self.left, self.left_velocity, self.left_motor = _wheel(mujoco, model, data, base, mjcf.LEFT)
        self.right, self.right_velocity, self.right_motor = _wheel(mujoco, model, data, base, mjcf.RIGHT)
        self._of_robot = model.body_rootid[model.geom_bodyid] == model.body_rootid[base]
        self._stands = ~self._of_robot & (model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE))
        # What the robot's geoms are not in, a laser may see: it never sees its own robot, nor what is invisible.
        groups = model.geom_group
        visible = groups <= _VISIBLE
        groups[self._of_robot & visible] = _ROBOT
        groups[~self._of_robot & (groups == _ROBOT)] = SEEN[-1]
        self._abs = np.abs
        pairs = data.contact.geom
        of_both = self._of_robot[pairs].any(axis=1) & self._stands[pairs].any(axis=1)
        self.starts_inside = bool((of_both & (data.contact.dist < -_DEEP)).any())

    def touching(self, contacts: Any) -> bool:
        """Whether the robot touches what stands around."""
        pairs = contacts.geom
        if not self._stands[pairs].any():
            return False  # it is on the floor, as nearly always
        mine = self._of_robot[pairs]
        steep = self._abs(contacts.frame[:, 2]) < _STEEP
        return bool((steep & (mine[:, 0] != mine[:, 1]) & (contacts.dist <= 0.0)).any())


def _wheel(mujoco: Any, model: Any, data: Any, base: int, name: str) -> tuple[int, int, int]:
    """The places of a wheel's position, of its velocity and of its motor."""
    joint = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, PREFIX + name)
    if joint < 0:
        raise ModelError(f"the robot has no joint {name!r}; it needs {mjcf.LEFT} and {mjcf.RIGHT}")
    of_joints = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    (motors,) = (of_joints & (model.actuator_trnid[:, 0] == joint)).nonzero()
    if len(motors) != 1:
        raise ModelError(f"the robot's joint {name!r} has {len(motors)} actuators; it needs one that takes a velocity")
    _check_motor(mujoco, model, int(motors[0]), name)
    to_the_left = data.xmat[base].reshape(3, 3)[:, 1]
    if model.jnt_type[joint] != int(mujoco.mjtJoint.mjJNT_HINGE) or data.xaxis[joint] @ to_the_left <= 0:
        raise ModelError(f'the robot\'s joint {name!r} has to be a hinge about y, which turns forward: axis="0 1 0"')
    return int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint]), int(motors[0])


def _check_motor(mujoco: Any, model: Any, motor: int, joint: str) -> None:
    """That an actuator takes the velocity of its joint.

    Raises:
        ModelError: it takes something else, or more or less of it; says what to write.
    """
    gain = model.actuator_gainprm[motor, 0].item()
    push, by_place, by_velocity = model.actuator_biasprm[motor, :3].tolist()
    is_affine = model.actuator_biastype[motor] == int(mujoco.mjtBias.mjBIAS_AFFINE)
    takes_velocity = gain > 0 and push == by_place == 0 and abs(gain + by_velocity) <= 1e-9 * gain
    if not (is_affine and takes_velocity):
        wanted = f'<velocity joint="{joint}" kv="…"/>'
        raise ModelError(f"the actuator of the robot's joint {joint!r} takes no velocity: it has to be {wanted}")
    if (gear := model.actuator_gear[motor, 0].item()) != 1:
        raise ModelError(
            f"the actuator of the robot's joint {joint!r} has a gear of {gear:g}: leave it out, for it is told the "
            "velocity of the wheel, and kv and forcerange are those at the wheel"
        )
    if model.actuator_ctrllimited[motor]:
        raise ModelError(
            f"the actuator of the robot's joint {joint!r} has a ctrlrange: leave it out, for max_linear_velocity and "
            "max_angular_velocity say how fast the base is"
        )


def model_of(mujoco: Any, world: str | Path, robot: str | Path, pose: Pose2) -> Any:
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
        raise ModelError(f"MuJoCo cannot put the robot into the world: {one_line(error)}") from None


def _spec(mujoco: Any, source: str | Path, what: str) -> Any:
    try:
        if isinstance(source, Path):
            return mujoco.MjSpec.from_file(str(source))
        return mujoco.MjSpec.from_string(source)
    except ValueError as error:
        where = f"{what} file {source}" if isinstance(source, Path) else f"the {what}"
        raise ModelError(f"{where} is no model for MuJoCo: {one_line(error)}") from None


def one_line(error: Exception) -> str:
    """What an error of MuJoCo's says."""
    return " ".join(str(error).split())
