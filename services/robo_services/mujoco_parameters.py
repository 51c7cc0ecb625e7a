"""How the base in MuJoCo is said: its parameters, and the models that follow from them."""

from pathlib import Path
from typing import Annotated

from msgspec import Meta

from robo import READ_ONLY, Unit
from robo_services import mjcf, world
from robo_services.simulator import SimulatorParameters

_MOST = {
    "radius": 10.0, "wheel_radius": 10.0, "wheel_separation": 10.0, "x": 1e4, "y": 1e4, "yaw": 1e6,
    "max_linear_velocity": 100.0, "max_angular_velocity": 100.0,
}  # fmt: skip


class MujocoParameters(SimulatorParameters):
    """The base, its sensors and its world."""

    world: Annotated[
        str, Meta(description="YAML file of walls, boxes and circles, or MJCF (.xml); empty: a 10 m room"), READ_ONLY
    ] = ""
    seed: Annotated[int, Meta(description="what all noise begins from: the same seed, the same noise"), READ_ONLY] = 0
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
    gyro_noise: Annotated[
        float, Meta(ge=0, le=10, description="standard deviation of an angular velocity"), Unit("rad/s"), READ_ONLY
    ] = 0.002
    accelerometer_noise: Annotated[
        float, Meta(ge=0, le=100, description="standard deviation of an acceleration"), Unit("m/s²"), READ_ONLY
    ] = 0.02
    camera: Annotated[bool, Meta(description="whether there is a camera"), READ_ONLY] = False
    camera_rate: Annotated[float, Meta(ge=0.1, le=100, description="pictures per second"), Unit("Hz")] = 10.0
    camera_width: Annotated[int, Meta(ge=16, le=4096, description="pixels in a row"), READ_ONLY] = 320
    camera_height: Annotated[int, Meta(ge=16, le=4096, description="rows of a picture"), READ_ONLY] = 240
    window: Annotated[bool, Meta(description="show MuJoCo's window; needs a screen"), READ_ONLY] = False
    paused: Annotated[bool, Meta(description="nothing moves, but by the service step")] = False
    world_frame: Annotated[str, Meta(min_length=1, description="the frame of ground_truth"), READ_ONLY] = "world"
    imu_frame: Annotated[str, Meta(min_length=1, description="the frame of imu"), READ_ONLY] = "imu_link"
    camera_frame: Annotated[str, Meta(min_length=1, description="the frame of pictures"), READ_ONLY] = "camera_optical"

    def __post_init__(self) -> None:
        """Refuse what would be no robot, or none that numbers can follow."""
        for name, most in _MOST.items():
            if abs(getattr(self, name)) > most:
                raise ValueError(f"{name} = {getattr(self, name):g}: MuJoCo can do with {most:g} at the most")
        for name in ("radius", "wheel_radius", "wheel_separation"):
            if getattr(self, name) < 0.01:
                raise ValueError(f"{name} = {getattr(self, name):g}: MuJoCo needs 0.01 m at the least")

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
        if self.world.endswith(".xml"):
            around: str | Path = Path(self.world)
        else:
            height = max(mjcf.WALL_HEIGHT, 2 * robot.laser_height)
            stands = world.load(self.world) if self.world else world.ROOM
            try:
                around = mjcf.world_mjcf(stands, friction=self.friction, height=height)
            except ValueError as error:
                raise world.WorldError(f"world file {self.world}: {error}") from None
        return around, Path(self.robot) if self.robot else mjcf.robot_mjcf(robot)
