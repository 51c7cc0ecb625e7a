"""What simulators of a base have in common: how it, its sensors and its world are said, and which command holds."""

from collections.abc import Iterable
from typing import Annotated, NamedTuple

from msgspec import Meta

from robo import READ_ONLY, Unit
from robo_messages import Twist
from robo_services.base_parameters import CommandedParameters
from robo_services.simulated_base import BaseLimits
from robo_services.simulated_errors import ImuNoise

MOST_STEPS = 50
"""Steps made up for at once after the process was held up; beyond them simulated time falls behind."""


REMEMBERED = 64
"""Commands, for the steps that are made up for."""


class Command(NamedTuple):
    """A velocity command."""

    twist: Twist
    sent: float
    """By the base's clock, s; -inf where that is not known."""


def in_force(commands: Iterable[Command], moment: float, timeout: float) -> Twist:
    """The velocity that holds at a moment: that of the last command before it, if it is no older than `timeout` s."""
    twist = Twist()
    for command in commands:
        if command.sent <= moment + 1e-6:
            twist = command.twist if moment - command.sent <= timeout else Twist()
    return twist


class SimulatorParameters(CommandedParameters):
    """The base, its sensors and its world."""

    world: Annotated[str, Meta(description="YAML file of walls, boxes and circles; empty: a 10 m room"), READ_ONLY] = ""
    x: Annotated[
        float, Meta(ge=-1e4, le=1e4, description="where it starts, along x of the world"), Unit("m"), READ_ONLY
    ] = 0.0
    y: Annotated[float, Meta(ge=-1e4, le=1e4, description="where it starts, along y"), Unit("m"), READ_ONLY] = 0.0
    yaw: Annotated[float, Meta(ge=-1e6, le=1e6, description="where it looks at the start"), Unit("rad"), READ_ONLY] = (
        0.0
    )
    seed: Annotated[int, Meta(description="what all noise begins from: the same seed, the same noise"), READ_ONLY] = 0
    wheel_separation: Annotated[
        float, Meta(ge=0.01, le=10, description="between the wheels of the two sides"), Unit("m"), READ_ONLY
    ] = 0.3
    wheel_radius: Annotated[float, Meta(ge=0.01, le=10, description="radius of a wheel"), Unit("m"), READ_ONLY] = 0.05
    joint_states: Annotated[
        bool, Meta(description="publish joint_states: how far wheels have turned and are steered"), READ_ONLY
    ] = False
    radius: Annotated[float, Meta(ge=0.01, le=10, description="radius of the round base"), Unit("m"), READ_ONLY] = 0.2
    max_linear_velocity: Annotated[
        float, Meta(gt=0, le=100, description="it drives no faster"), Unit("m/s"), READ_ONLY
    ] = 1.5
    max_angular_velocity: Annotated[
        float, Meta(gt=0, le=100, description="it turns no faster"), Unit("rad/s"), READ_ONLY
    ] = 3.0
    linear_acceleration: Annotated[float, Meta(gt=0, description="how it gains speed"), Unit("m/s²"), READ_ONLY] = 2.0
    linear_deceleration: Annotated[float, Meta(gt=0, description="how it brakes"), Unit("m/s²"), READ_ONLY] = 5.0
    angular_acceleration: Annotated[
        float, Meta(gt=0, description="how its turning changes"), Unit("rad/s²"), READ_ONLY
    ] = 6.0
    odom_rate: Annotated[
        float, Meta(ge=1, le=1000, description="steps and odometry messages per second"), Unit("Hz"), READ_ONLY
    ] = 50.0
    laser: Annotated[bool, Meta(description="whether there is a laser")] = True
    scan_rate: Annotated[float, Meta(ge=0.1, le=100, description="scans per second"), Unit("Hz")] = 10.0
    rays: Annotated[int, Meta(ge=1, le=10_000, description="rays of a scan, over the full turn"), READ_ONLY] = 360
    range_min: Annotated[float, Meta(ge=0, description="the laser measures nothing nearer"), Unit("m"), READ_ONLY] = (
        0.05
    )
    range_max: Annotated[float, Meta(gt=0, description="the laser measures nothing further"), Unit("m"), READ_ONLY] = (
        12.0
    )
    range_noise: Annotated[float, Meta(ge=0, description="standard deviation of a range"), Unit("m"), READ_ONLY] = 0.005
    imu: Annotated[bool, Meta(description="publish imu, after every step"), READ_ONLY] = False
    imu_noise: ImuNoise = ImuNoise()
    ground_truth: Annotated[
        bool, Meta(description="publish ground_truth: where the base truly is and how it moves"), READ_ONLY
    ] = False
    enable_odom_tf: Annotated[
        bool, Meta(description="say on tf where the base stands in odom; false where a filter does")
    ] = True
    publish_clock: Annotated[
        bool, Meta(description="publish /clock: time is what is simulated, for nodes with use_sim_time"), READ_ONLY
    ] = False
    real_time_factor: Annotated[
        float, Meta(ge=0.01, le=100, description="how fast the published time runs, 1 is real time"), READ_ONLY
    ] = 1.0
    odom_frame: Annotated[str, Meta(min_length=1, description="the frame of odometry's poses"), READ_ONLY] = "odom"
    base_frame: Annotated[str, Meta(min_length=1, description="the frame of odometry's velocities"), READ_ONLY] = (
        "base_link"
    )
    laser_frame: Annotated[str, Meta(min_length=1, description="the frame of scans"), READ_ONLY] = "base_laser"
    imu_frame: Annotated[str, Meta(min_length=1, description="the frame of imu"), READ_ONLY] = "imu_link"
    world_frame: Annotated[
        str, Meta(min_length=1, description="the frame of ground_truth; no frame leads there"), READ_ONLY
    ] = "world"
    publish_laser_tf: Annotated[
        bool,
        Meta(description="say on tf_static where the laser stands; false where a robot_state_publisher does"),
        READ_ONLY,
    ] = True

    def __post_init__(self) -> None:
        """Refuse a laser that would measure nothing."""
        if self.range_min >= self.range_max:
            raise ValueError(f"range_min = {self.range_min:g} has to be less than range_max = {self.range_max:g}")

    @property
    def limits(self) -> BaseLimits:
        """What the base can do."""
        return BaseLimits(
            radius=self.radius,
            max_linear_velocity=self.max_linear_velocity,
            max_angular_velocity=self.max_angular_velocity,
            linear_acceleration=self.linear_acceleration,
            linear_deceleration=self.linear_deceleration,
            angular_acceleration=self.angular_acceleration,
        )
