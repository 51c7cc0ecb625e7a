"""What nodes of bases have in common in how they are tuned: whom they obey, and their wheels."""

from typing import Annotated

from msgspec import Meta

import robo
from robo import READ_ONLY, Unit
from robo_services.arrivals import Unstamped
from robo_services.drives import DiffDrive
from robo_services.uncertainty import NOISE, Noise

Length = Annotated[float, Meta(ge=0.001, le=100), Unit("m"), READ_ONLY]
Multiplier = Annotated[float, Meta(ge=0.1, le=10), READ_ONLY]
WheelVelocity = Annotated[
    float,
    Meta(ge=0.01, le=10_000, description="a faster command is scaled down on its curve; no wheel turns faster"),
    Unit("rad/s"),
    READ_ONLY,
]


class CommandedParameters(robo.Parameters):
    """Whom a base obeys, and for how long."""

    cmd_vel_timeout: Annotated[
        float, Meta(ge=0.01, le=10, description="stand still without a command for this long"), Unit("s")
    ] = 0.5
    command_source: Annotated[
        str,
        Meta(description="whose commands alone move it: a node, plain (Zenoh clients), or empty: the first node"),
        READ_ONLY,  # else whoever may set a parameter may drive
    ] = ""


class WheeledParameters(CommandedParameters):
    """A base that knows where it is by its wheels, two sides of them."""

    wheel_separation: Annotated[Length, Meta(description="between the wheels of the two sides")] = 0.3
    wheel_radius: Annotated[Length, Meta(description="radius of a wheel")] = 0.05
    wheel_separation_multiplier: Annotated[
        Multiplier, Meta(description="corrects it, as found by turning on the spot; 1.5 to 2 for a skid steer")
    ] = 1.0
    left_wheel_radius_multiplier: Annotated[
        Multiplier, Meta(description="corrects it, as found by driving straight")
    ] = 1.0
    right_wheel_radius_multiplier: Annotated[Multiplier, Meta(description="likewise")] = 1.0
    max_wheel_velocity: WheelVelocity = 100.0
    unstamped: Unstamped = True
    noise: Noise = NOISE
    odom_frame_id: Annotated[str, Meta(description="the frame of odometry's poses"), READ_ONLY] = "odom"
    base_frame_id: Annotated[str, Meta(description="the frame of odometry's velocities"), READ_ONLY] = "base_link"
    enable_odom_tf: Annotated[bool, Meta(description="whether tf says where the base stands in odom")] = True

    def drive(self) -> DiffDrive:
        """Between the base's motion and that of its wheels."""
        return DiffDrive(
            wheel_separation=self.wheel_separation,
            wheel_radius=self.wheel_radius,
            wheel_separation_multiplier=self.wheel_separation_multiplier,
            left_wheel_radius_multiplier=self.left_wheel_radius_multiplier,
            right_wheel_radius_multiplier=self.right_wheel_radius_multiplier,
            max_wheel_velocity=self.max_wheel_velocity,
        )
