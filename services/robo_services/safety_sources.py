"""The sensors that a safety monitor listens to: what each has said last, where it stands, and how the base moves."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from robo import MessageInfo, Node
from robo_messages import LaserScan, PointCloud2, Range, Twist
from robo_services.arrivals import Arrivals, Newest
from robo_services.collision import Sighting
from robo_services.contact import Velocity
from robo_services.kinematics import Pose2
from robo_services.obstacles import Obstacle, Place, Track, from_cloud, from_range, from_scan
from robo_services.safety import is_usable, velocity_of
from robo_services.safety_parameters import LASER, SafetyParameters, SourceParameters, sources_of

if TYPE_CHECKING:
    from robo_messages import TFMessage

Sensed = LaserScan | Range | PointCloud2
TYPES: dict[str, type[Sensed]] = {"scan": LaserScan, "range": Range, "pointcloud": PointCloud2}

MOST_SPEED = 1e3
"""No base moves faster, m/s or rad/s: odometry that says so says nothing."""

ODOMETRY_SILENT = 0.3
"""How long after its last odometry the base is taken to do what it is commanded, s."""


class Unclear(ValueError):
    """A message says nothing of where obstacles are."""


def obstacles_of(message: Sensed, source: SourceParameters, place: Place) -> list[Obstacle]:
    """Where obstacles are, in the base's frame, the nearest first.

    Raises:
        Unclear: the message does not say.
    """
    ranges = source.min_range, source.max_range
    if isinstance(message, PointCloud2):
        try:
            return from_cloud(message, place, (source.min_height, source.max_height), ranges)
        except ValueError as error:
            raise Unclear(str(error)) from None
    pose = place.pose
    if pose is None:
        raise Unclear("the sensor does not stand upright, which only a point cloud's may")
    if isinstance(message, LaserScan) and is_usable(message):
        return from_scan(message, pose, *ranges)
    if isinstance(message, Range) and message.range == message.range and message.max_range > 0.0:
        return from_range(message, pose, *ranges)
    raise Unclear("it holds no valid range")


class Motion:
    """How the base moves: as odometry says or, where that is silent, as it is commanded."""

    def __init__(self) -> None:
        self._track = Track()
        self._heard = -math.inf

    @property
    def velocity(self) -> Velocity:
        """The last that is known."""
        return self._track.velocity

    def measured(self, twist: Twist, sent: float) -> None:
        """Odometry says that it moved so at a moment, s; what cannot be, or is of an unknown age, is silence."""
        velocity = velocity_of(twist)
        if sent > -math.inf and all(abs(value) <= MOST_SPEED for value in velocity):  # no NaN either
            self._heard = sent
            self._track.add(sent, velocity)

    def commanded(self, twist: Twist, now: float) -> None:
        """It is commanded so."""
        if not 0.0 <= now - self._heard <= ODOMETRY_SILENT:
            velocity = velocity_of(twist)
            self._track.add(now, Velocity(*(max(-MOST_SPEED, min(MOST_SPEED, value)) for value in velocity)))

    def forget(self) -> None:
        """Time was set: what was known of earlier moments is of another time."""
        self._track, self._heard = Track(), -math.inf

    def moved(self, since: float, now: float) -> Pose2:
        """Where the base is, in its frame at an earlier moment."""
        return self._track.moved(since, now)


class Source:
    """One sensor."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.newest: Newest[Sensed] = Newest()
        self.yaw = 0.0
        """Where it looked when it said that, in the base's frame, rad."""
        self._obstacles: list[Obstacle] = []

    def sighting(self, now: float, motion: Motion) -> Sighting | None:
        """What it has said last; None where it has said nothing."""
        if self.newest.message is None:
            return None
        age = self.newest.age(now)
        moved = motion.moved(now - age, now) if age < math.inf else Pose2()
        return Sighting(source=self.name, obstacles=self._obstacles, age=age, moved=moved)

    def take(self, message: Sensed, obstacles: list[Obstacle], yaw: float, sent: float, now: float) -> None:
        """Take what it says, if it is newer than what there is."""
        self.newest.take(message, sent, now)
        if self.newest.message is message:
            self._obstacles, self.yaw = obstacles, yaw


class Sources:
    """All sensors of a monitor: subscribes to those that its class does not declare, and turns what comes into points.

    What a sensor says and nobody can use counts as silence, so that it stops the robot when its timeout is over.
    """

    def __init__(
        self, node: Node, parameters: Callable[[], SafetyParameters], arrivals: Arrivals, motion: Motion
    ) -> None:
        """`parameters` tells those that hold now."""
        self._parameters = parameters
        self._node, self._arrivals, self._motion = node, arrivals, motion
        self._wall = node.clock.wall
        self._refused = 0
        self._places = _PlacesOfFrames(node, parameters().base_frame) if parameters().use_tf else None
        self._by_name = {name: Source(name) for name in parameters().sources}
        for name, source in parameters().sources.items():
            if name != LASER:
                self._listen(name, source)

    def _listen(self, name: str, source: SourceParameters) -> None:
        if source.type == "pointcloud":
            import robo_messages.arrays  # noqa: F401  # where numpy is missing this says so now, not while it drives
        topic = source.topic or name

        def on_message(message: Sensed, info: MessageInfo) -> None:
            self.take(name, message, info)

        self._node.create_subscription(TYPES[source.type], topic, on_message, depth=1)

    def take(self, name: str, message: Sensed, info: MessageInfo) -> None:
        """Remember what a source says and when that was sent."""
        source = self._parameters().sources.get(name)
        if source is None:
            return
        try:
            place = self._place(message, source)
            if name == LASER and isinstance(message, LaserScan) and not is_usable(message):
                obstacles = []  # the decision says so at once
            else:
                obstacles = obstacles_of(message, source, place)
        except Unclear as error:
            self._refused += 1
            text = "the source %s says nothing of obstacles, and so it counts as silent: %s; %d such messages so far"
            self._node.logger.warning(text, name, error, self._refused, throttle=5.0)
            return
        now = self._node.clock.monotonic()
        sent = self._arrivals.sent(info, now, self._wall.monotonic())
        self._by_name[name].take(message, obstacles, place.yaw, sent, now)

    @property
    def laser(self) -> Source:
        """The one to which the parameters of a scan belong."""
        return self._by_name[LASER]

    def sightings(self, now: float) -> list[Sighting]:
        """What each has said last, but for those that are silent so far."""
        there = sources_of(self._parameters())  # without a laser, what somebody says on its topic does not count
        found = (source.sighting(now, self._motion) for source in self._by_name.values() if source.name in there)
        return [sighting for sighting in found if sighting is not None]

    def _place(self, message: Sensed, source: SourceParameters) -> Place:
        if self._places is not None:
            return self._places.of(message.header.frame_id)
        return Place.planar(Pose2(source.x, source.y, source.yaw))


class _PlacesOfFrames:
    """Where frames stand in the base's, as `tf_static` says. Only who asks for it carries what transforms need."""

    def __init__(self, node: Node, base_frame: str) -> None:
        from robo.tf import Buffer
        from robo.tf.broadcasters import DEPTH, TF_STATIC
        from robo_messages import TFMessage

        self._buffer, self._base = Buffer(), base_frame
        self._known: dict[str, Place] = {}
        node.create_subscription(TFMessage, TF_STATIC, self._on_frames, depth=DEPTH, latched=True, turn="tf")

    def _on_frames(self, message: "TFMessage", info: MessageInfo) -> None:
        self._buffer.insert_all(message.transforms, True, info.sender)
        self._known = {}

    def of(self, frame: str) -> Place:
        """Where a frame stands.

        Raises:
            Unclear: nobody has said so.
        """
        from robo.errors import TransformError

        known = self._known
        if frame not in known:
            try:
                base_frame = self._buffer.lookup(self._base, frame)
            except TransformError as error:
                raise Unclear(str(error)) from None
            known[frame] = _place(*(base_frame.apply(*point) for point in _ORIGIN_AND_AXES))
        return known[frame]


_Point = tuple[float, float, float]
_ORIGIN_AND_AXES: tuple[_Point, ...] = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _place(origin: _Point, x: _Point, y: _Point, z: _Point) -> Place:
    """By where a frame's origin and the ends of its axes stand."""
    rows = [(x[i] - origin[i], y[i] - origin[i], z[i] - origin[i], origin[i]) for i in range(3)]
    return Place(rows[0], rows[1], rows[2])
