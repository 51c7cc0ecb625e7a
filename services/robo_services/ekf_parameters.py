"""How the filter is tuned: its sources and its noise, as parameters."""

import math
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from robo import READ_ONLY, Unit
from robo_services.ekf import QUANTITIES

Angle = Annotated[float, Meta(ge=-7, le=7), Unit("rad"), READ_ONLY]

WAY: frozenset[str] = frozenset({"x", "y", "vx", "vy"})
HEADING: frozenset[str] = frozenset({"yaw", "vyaw"})

CAN_SAY: dict[str, frozenset[str]] = {
    "odometry": frozenset({"x", "y", "yaw", "vx", "vy", "vyaw"}),
    "imu": frozenset({"yaw", "vyaw", "ax", "ay"}),
    "pose": frozenset({"x", "y", "yaw"}),
    "twist": frozenset({"vx", "vy", "vyaw"}),
}
"""What messages of a type hold."""

PROCESS_NOISE = (0.0, 0.0, 0.0, 1.0, 1e-3, 4.0, 10.0, 10.0)
"""Per second, of x, y, yaw, vx, vy, vyaw, ax, ay: a base's speed may change by 1 m/s in a second, and its turning by 2
rad/s; its pose changes by moving, and by nothing else.
"""
INITIAL = (1e-6, 1e-6, 1e-6, 1.0, 0.01, 1.0, 1.0, 1.0)
"""Variances at the start: it is at the origin, and how it moves is not known."""
ANYWHERE = (1e6, 1e6, 10.0)
"""Of a pose that a source is to say, m² and rad²: its first one is taken wherever that is."""

MOST = 1e9
"""No variance is larger."""

_IN_THREE_DIMENSIONS = (0, 1, 5, 6, 7, 11, 12, 13)
"""Where the eight stand among robot_localization's fifteen."""


class SourceParameters(msgspec.Struct, frozen=True):
    """Who measures something of how the base moves."""

    topic: Annotated[str, Meta(min_length=1, description="what it publishes"), READ_ONLY]
    use: Annotated[
        list[str],
        Meta(min_length=1, max_length=8, description="what is taken of it: x, y, yaw, vx, vy, vyaw, ax, ay"),
        READ_ONLY,
    ]
    type: Annotated[
        Literal["odometry", "imu", "pose", "twist"],
        Meta(description="nav/Odometry, sensor/Imu, or geometry/Pose- or TwistWithCovarianceStamped"),
        READ_ONLY,
    ] = "odometry"
    differential: Annotated[
        bool, Meta(description="its poses are taken for the velocities between them"), READ_ONLY
    ] = False
    relative: Annotated[bool, Meta(description="its poses count from its first one"), READ_ONLY] = False
    rejection_threshold: Annotated[
        float, Meta(ge=0, le=1e6, description="what is so many standard deviations away is left out; 0: never")
    ] = 0.0
    remove_gravitational_acceleration: Annotated[
        bool, Meta(description="an IMU's accelerations hold gravity, which its orientation tells apart"), READ_ONLY
    ] = False
    rest_bias: Annotated[
        float,
        Meta(ge=0, le=1, description="a turning up to this that a gyro says while wheels stand is its bias; 0: none"),
        Unit("rad/s"),
    ] = 0.05
    roll: Annotated[Angle, Meta(description="how an IMU is mounted; π is upside down")] = 0.0
    pitch: Annotated[Angle, Meta(description="how an IMU is mounted")] = 0.0
    yaw: Annotated[Angle, Meta(description="how an IMU is mounted")] = 0.0

    def __post_init__(self) -> None:
        """Refuse what such messages do not hold."""
        if missing := [one for one in self.use if one not in CAN_SAY[self.type]]:
            there = ", ".join(one for one in QUANTITIES if one in CAN_SAY[self.type])
            raise ValueError(f"{self.type} says no {', '.join(missing)}; it says {there}")
        if self.differential and self.relative:
            raise ValueError("poses are differential or relative, not both")

    @property
    def threshold(self) -> float:
        """Infinite where nothing is left out."""
        return self.rejection_threshold or math.inf

    def is_absolute(self, quantity: str) -> bool:
        """Whether it says that itself, of a pose."""
        return quantity in self.use and not self.differential and not self.relative


def diagonal(values: list[float], default: tuple[float, ...]) -> tuple[float, ...]:
    """The eight variances that a list means.

    Args:
        values: eight of them, or robot_localization's fifteen, or its fifteen by fifteen; nothing for the default.
        default: eight.

    Raises:
        ValueError: there are as many as none of these, or one is no variance.
    """
    if not values:
        return default
    if len(values) == 225:
        values = values[::16]
    if len(values) == 15:
        values = [values[i] for i in _IN_THREE_DIMENSIONS]
    if len(values) != len(default):
        raise ValueError(f"{len(values)} numbers: 8 variances, of {', '.join(QUANTITIES)}, or robot_localization's 15")
    if not all(0.0 <= one <= MOST for one in values):
        raise ValueError(f"a variance is 0 to {MOST:g}")
    return tuple(values)
