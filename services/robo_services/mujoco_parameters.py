"""How the base in MuJoCo is said: its parameters, and the models that follow from them."""

from pathlib import Path
from typing import Annotated

from msgspec import Meta

from robo import READ_ONLY, Unit
from robo_services import mjcf, world
from robo_services.simulator import SimulatorParameters

_MJCF = (".xml", ".mjcf")
"""What files of MuJoCo's models are called."""


class MujocoParameters(SimulatorParameters):
    """The base, its sensors and its world."""

    world: Annotated[
        str,
        Meta(description="YAML file of walls, boxes and circles, or MJCF (.xml, .mjcf); empty: a 10 m room"),
        READ_ONLY,
    ] = ""
    robot: Annotated[
        str, Meta(description="MJCF file of the robot; empty: a round base of the dimensions said here"), READ_ONLY
    ] = ""
    mass: Annotated[float, Meta(ge=0.1, le=1000, description="of the base"), Unit("kg"), READ_ONLY] = 5.0
    friction: Annotated[
        float,
        Meta(ge=0, le=10, description="between floor and wheels; of an MJCF world, as that says"),
        READ_ONLY,
    ] = 1.0
    max_wheel_torque: Annotated[
        float, Meta(ge=1e-3, le=10_000, description="a motor turns its wheel no harder"), Unit("N·m"), READ_ONLY
    ] = 2.0
    timestep: Annotated[
        float, Meta(ge=1e-4, le=0.004, description="the longest step of the physics"), Unit("s"), READ_ONLY
    ] = 0.002
    imu: Annotated[bool, Meta(description="publish imu, after every step"), READ_ONLY] = True
    ground_truth: Annotated[
        bool, Meta(description="publish ground_truth: where the base truly is and how it moves"), READ_ONLY
    ] = True
    camera: Annotated[bool, Meta(description="whether there is a camera"), READ_ONLY] = False
    camera_rate: Annotated[float, Meta(ge=0.1, le=100, description="pictures per second"), Unit("Hz")] = 10.0
    camera_width: Annotated[int, Meta(ge=16, le=4096, description="pixels in a row"), READ_ONLY] = 320
    camera_height: Annotated[int, Meta(ge=16, le=4096, description="rows of a picture"), READ_ONLY] = 240
    window: Annotated[bool, Meta(description="show MuJoCo's window; needs a screen"), READ_ONLY] = False
    paused: Annotated[bool, Meta(description="nothing moves, but by the service step")] = False
    camera_frame: Annotated[str, Meta(min_length=1, description="the frame of pictures"), READ_ONLY] = "camera_optical"

    def models(self) -> tuple[str | Path, str | Path]:
        """The world and the robot, as MJCF or as files of it.

        Raises:
            WorldError: the world file is missing or has mistakes.
        """
        robot = mjcf.Robot(
            radius=self.radius,
            wheel_radius=self.wheel_radius,
            wheel_separation=self.wheel_separation,
            mass=self.mass,
            max_wheel_torque=self.max_wheel_torque,
        )
        if Path(self.world).suffix.lower() in _MJCF:
            around: str | Path = Path(self.world)
        else:
            height = max(mjcf.WALL_HEIGHT, 2 * robot.laser_height)
            stands = world.load(self.world) if self.world else world.ROOM
            try:
                around = mjcf.world_mjcf(stands, friction=self.friction, height=height)
            except ValueError as error:
                raise world.WorldError(f"world file {self.world}: {error}") from None
        return around, Path(self.robot) if self.robot else mjcf.robot_mjcf(robot)
