"""What is said of a base that is calibrated, and of how it drives meanwhile."""

from typing import Annotated

from msgspec import Meta

import robo
from robo import READ_ONLY, Subscribes, Unit
from robo_messages import Odometry
from robo_services.calibration import MEASURING_ERROR


class CalibrateBaseParameters(robo.Parameters):
    """The ways, and what is known of the base."""

    length: Annotated[float, Meta(ge=2, le=100, description="of the straight line"), Unit("m"), READ_ONLY] = 4.0
    side: Annotated[float, Meta(ge=1, le=100, description="of the squares"), Unit("m"), READ_ONLY] = 2.0
    repeats: Annotated[int, Meta(ge=1, le=20, description="how often all three are driven"), READ_ONLY] = 1
    controller: Annotated[
        str,
        Meta(description="whose odometry and wheels: a node, plain (Zenoh clients), or empty: the first node"),
        READ_ONLY,
    ] = ""
    wheel_separation: Annotated[
        float,
        Meta(ge=0, le=100, description="as odometry takes it, where its sender has no such parameter; 0: not said"),
        Unit("m"),
        READ_ONLY,
    ] = 0.0
    measuring_error: Annotated[
        float, Meta(ge=0.0001, le=0.1, description="standard deviation of where it is measured to be"), Unit("m")
    ] = MEASURING_ERROR
    ground_truth: Annotated[
        str,
        Meta(description="who says where the base really is, as odometry; empty: measured by hand"),
        Subscribes(Odometry),
        READ_ONLY,
    ] = ""
    speed: Annotated[float, Meta(ge=0.05, le=2, description="how fast it drives"), Unit("m/s")] = 0.2
    turning_speed: Annotated[float, Meta(ge=0.1, le=3, description="how fast it turns"), Unit("rad/s")] = 0.5
    acceleration: Annotated[float, Meta(ge=0.05, le=5, description="how it gains and loses speed"), Unit("m/s²")] = 0.2
    turning_acceleration: Annotated[
        float, Meta(ge=0.1, le=10, description="how its turning changes"), Unit("rad/s²")
    ] = 0.5
    odom_timeout: Annotated[
        float, Meta(ge=0.05, le=10, description="without odometry for so long it stops"), Unit("s")
    ] = 0.5
