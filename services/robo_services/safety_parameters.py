"""How the safety monitor is tuned: its zones, its sources and the robot's shape, as parameters and as what decides."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

import robo
from robo import READ_ONLY, Unit
from robo_services.arrivals import Unstamped
from robo_services.collision import Body
from robo_services.contact import Shape, disc, polygon
from robo_services.safety import Limits
from robo_services.zones import Zone

LASER = "scan"
"""The source to which `laser`, `min_distance`, `warning_distance` and `sector` belong."""

UNLIMITED = 100.0
"""No robot is as fast, m/s or rad/s."""

Corners = Annotated[
    list[float],
    Meta(max_length=200, description="x, y of one corner after the other, in the base's frame"),
    Unit("m"),
]
Length = Annotated[float, Meta(ge=-100, le=100), Unit("m")]


class FootprintParameters(msgspec.Struct, frozen=True):
    """The robot's outline, in the base's frame."""

    radius: Annotated[float, Meta(ge=0, le=100, description="of a round robot"), Unit("m")] = 0.2
    polygon: Corners = msgspec.field(default_factory=list)
    margin: Annotated[
        float,
        Meta(ge=0.01, le=10, description="how far from everything it is to stay; where it is nearer, half"),
        Unit("m"),
    ] = 0.05

    def __post_init__(self) -> None:
        """Refuse what is no shape."""
        self.shape()

    def shape(self) -> Shape:
        """The polygon where there is one, else the circle."""
        return polygon(_pairs(self.polygon)) if self.polygon else disc(self.radius)


class BrakingParameters(msgspec.Struct, frozen=True):
    """How the robot comes to a stand, at the worst."""

    reaction_time: Annotated[float, Meta(ge=0, le=10, description="until the base does what it is told"), Unit("s")] = (
        0.15
    )
    deceleration: Annotated[float, Meta(ge=0.01, le=1000, description="how it brakes at the least"), Unit("m/s²")] = 2.0
    angular_deceleration: Annotated[
        float, Meta(ge=0.01, le=1000, description="how it stops turning at the least"), Unit("rad/s²")
    ] = 3.0
    obstacle_speed: Annotated[
        float, Meta(ge=0, le=10, description="how fast obstacles may be; the robot leaves room for it"), Unit("m/s")
    ] = 0.3


class SourceParameters(msgspec.Struct, frozen=True):
    """A sensor that sees obstacles, and where it stands on the robot."""

    topic: Annotated[str, Meta(description="what it publishes; empty: the source's name"), READ_ONLY] = ""
    type: Annotated[
        Literal["scan", "range", "pointcloud"],
        Meta(description="sensor/LaserScan, sensor/Range or sensor/PointCloud2, which needs numpy"),
        READ_ONLY,
    ] = "scan"
    timeout: Annotated[
        float, Meta(ge=0, le=10, description="an older message stops the robot; 0: scan_timeout"), Unit("s")
    ] = 0.0
    x: Annotated[Length, Meta(description="where it stands in the base's frame, forward")] = 0.0
    y: Annotated[Length, Meta(description="where it stands, to the left")] = 0.0
    yaw: Annotated[float, Meta(ge=-7, le=7, description="where it looks, to the left"), Unit("rad")] = 0.0
    min_range: Annotated[
        float, Meta(ge=0, le=100, description="what is nearer to it is the robot itself"), Unit("m")
    ] = 0.0
    max_range: Annotated[float, Meta(ge=0, le=1000, description="what is further away does not count"), Unit("m")] = (
        100.0
    )
    min_height: Annotated[
        Length, Meta(description="of a cloud's points that count, above it, with use_tf above the base")
    ] = 0.05
    max_height: Annotated[
        Length, Meta(description="of a cloud's points that count, above it, with use_tf above the base")
    ] = 2.0


class ZoneParameters(msgspec.Struct, frozen=True):
    """A place around the robot, and what is done while something is in it."""

    action: Annotated[
        Literal["stop", "slow_down", "limit", "approach"],
        Meta(
            description="stop, slow_down to `share`, limit to `max_speed` and `max_turn`, approach: `time` to contact"
        ),
    ]
    radius: Annotated[float, Meta(ge=0, le=100, description="of a circle around the base"), Unit("m")] = 0.0
    polygon: Corners = msgspec.field(default_factory=list)
    time: Annotated[
        float,
        Meta(ge=0, le=10, description="approach: the least time to contact; else it grows by what it covers in it"),
        Unit("s"),
    ] = 0.0
    share: Annotated[float, Meta(ge=0, le=1, description="slow_down: of what is commanded")] = 0.5
    max_speed: Annotated[float, Meta(ge=0, le=100, description="limit: no faster"), Unit("m/s")] = UNLIMITED
    max_turn: Annotated[float, Meta(ge=0, le=100, description="limit: turns no faster"), Unit("rad/s")] = UNLIMITED
    min_points: Annotated[int, Meta(ge=1, le=100_000, description="fewer points in it are noise")] = 1
    sources: Annotated[list[str], Meta(description="whose points count; empty for all")] = msgspec.field(
        default_factory=list
    )
    enabled: Annotated[bool, Meta(description="false: as if it were not there")] = True

    def __post_init__(self) -> None:
        """Refuse what is no zone."""
        if bool(self.polygon) == (self.radius > 0.0):
            raise ValueError(f"a zone has a polygon or a radius{', not both' if self.polygon else ''}")
        if self.action == "approach" and self.time <= 0.0:
            raise ValueError("a zone with the action approach has a time of more than 0")
        if self.action == "limit" and self.max_speed == self.max_turn == UNLIMITED:
            raise ValueError("a zone with the action limit has a max_speed, a max_turn, or both")
        self.shape()

    def shape(self) -> Shape:
        """The polygon where there is one, else the circle."""
        return polygon(_pairs(self.polygon)) if self.polygon else disc(self.radius)

    def zone(self, name: str) -> Zone:
        """As it decides."""
        return Zone(
            name=name,
            action=self.action,
            shape=self.shape(),
            time=self.time,
            share=self.share,
            max_speed=self.max_speed,
            max_turn=self.max_turn,
            min_points=self.min_points,
            sources=tuple(self.sources),
        )


class SafetyParameters(robo.Parameters):
    """What is safe."""

    min_distance: Annotated[float, Meta(ge=0, description="stop for an obstacle this near"), Unit("m")] = 0.3
    warning_distance: Annotated[float, Meta(ge=0, description="slow down for one nearer than this"), Unit("m")] = 0.5
    max_speed: Annotated[float, Meta(gt=0, description="faster commands are slowed down to it"), Unit("m/s")] = 1.0
    sector: Annotated[
        float,
        Meta(gt=0, le=2 * math.pi, description="angle around the motion in which obstacles count"),
        Unit("rad"),
    ] = 2.0
    scan_timeout: Annotated[float, Meta(ge=0.01, le=10, description="an older scan stops the robot"), Unit("s")] = 0.25
    command_timeout: Annotated[
        float, Meta(ge=0.01, le=10, description="an older command stops the robot"), Unit("s")
    ] = 0.5
    unstamped: Unstamped = True
    rate: Annotated[float, Meta(ge=1, le=1000, description="decisions per second"), Unit("Hz")] = 50.0
    laser: Annotated[
        bool, Meta(description="false for a base without one: obstacles do not stop it, all else does"), READ_ONLY
    ] = True
    wait_for_laser: Annotated[
        bool,
        Meta(description="false: it drives before the first scan; from that on a laser that falls silent stops it"),
        READ_ONLY,
    ] = True
    on_rival: Annotated[
        Literal["warn", "stop"], Meta(description="what is done while somebody else commands the base too")
    ] = "warn"
    emergency_button: Annotated[
        int, Meta(ge=-1, le=1000, description="button of `joy` that is an emergency stop; -1: none"), READ_ONLY
    ] = -1
    use_tf: Annotated[
        bool, Meta(description="sensors stand where tf_static says, instead of their x, y, yaw"), READ_ONLY
    ] = False
    base_frame: Annotated[str, Meta(description="the frame of the robot, its footprint and zones"), READ_ONLY] = (
        "base_link"
    )
    footprint: FootprintParameters = FootprintParameters()
    braking: BrakingParameters = BrakingParameters()
    sources: dict[str, SourceParameters] = msgspec.field(default_factory=lambda: {LASER: SourceParameters()})
    zones: dict[str, ZoneParameters] = msgspec.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what contradicts itself."""
        _refuse_unknown_sources(self)


def sources_of(p: SafetyParameters) -> dict[str, SourceParameters]:
    """The sources that there are."""
    return {name: source for name, source in p.sources.items() if p.laser or name != LASER}


def limits_of(p: SafetyParameters, *, laser_heard: bool = False) -> Limits:
    """What is safe, once a laser was heard or before."""
    timeouts = {name: source.timeout or p.scan_timeout for name, source in sources_of(p).items()}
    braking = p.braking
    return Limits(
        min_distance=p.min_distance,
        warning_distance=p.warning_distance,
        max_speed=p.max_speed,
        sector=p.sector,
        scan_timeout=timeouts.get(LASER, p.scan_timeout),
        command_timeout=p.command_timeout,
        laser=p.laser and (p.wait_for_laser or laser_heard),
        body=Body(
            footprint=p.footprint.shape(),
            margin=p.footprint.margin,
            reaction_time=braking.reaction_time + 1.0 / p.rate,
            deceleration=braking.deceleration,
            angular_deceleration=braking.angular_deceleration,
            obstacle_speed=braking.obstacle_speed,
        ),
        zones=tuple(zone.zone(name) for name, zone in p.zones.items() if zone.enabled),
        timeouts=tuple((name, timeout) for name, timeout in timeouts.items() if name != LASER),
    )


def _refuse_unknown_sources(p: SafetyParameters) -> None:
    """Raises ValueError where a zone speaks of a source that there is not, or the laser is no laser."""
    there = sources_of(p)
    for name, zone in p.zones.items():
        for source in zone.sources:
            if source not in there:
                raise ValueError(
                    f"zones.{name}.sources: there is no source {source!r}; there are {', '.join(there) or 'none'}"
                )
    if LASER in p.sources and p.sources[LASER].type != "scan":
        raise ValueError(f"sources.{LASER} is the laser, of type scan; give a source of another type another name")
    if LASER in p.sources and p.sources[LASER].topic not in ("", LASER):
        raise ValueError(f"sources.{LASER}.topic: it is {LASER}; remap that to {p.sources[LASER].topic}")


def _pairs(values: Sequence[float]) -> list[tuple[float, float]]:
    if len(values) % 2:
        raise ValueError("a polygon is x and y of one corner after the other: an even number of values")
    if not all(map(math.isfinite, values)):
        raise ValueError("a polygon with a corner that is no number")
    return list(zip(values[::2], values[1::2], strict=True))
