"""A log of CARMEN as a recording: what the node carmen_player says of it, each message at the time of its record."""

from pathlib import Path

import msgspec

from robo.bag.edit.output import new_file
from robo.bag.forms import carmen
from robo.bag.forms.converted import Added, Converted, Wanted
from robo.bag.forms.left_out import LeftOut
from robo.bag.mcap.compression import Compression
from robo.bag.options import TopicInFile
from robo.bag.progress import Tell, silent
from robo.bag.types import topic_of
from robo.errors import MessageError
from robo.interfaces import cdr
from robo.wire import names
from robo.wire.qos import KEEP_ALL, QoS
from robo_messages import (
    Header,
    Message,
    Odometry,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Vector3,
)

_EACH = 1_000
"""Lines from one time to the next that it is told how far it is."""


class Setting(msgspec.Struct, frozen=True, kw_only=True):
    """What a log does not say; as the parameters of carmen_player."""

    namespace: str = ""
    """Of the topics: r1."""
    range_max: float = 80.0
    """Longer ranges are no return, m."""
    odom_frame: str = "odom"
    base_frame: str = "base_link"
    laser_frame: str = "base_laser"


def from_carmen(
    path: str | Path,
    output: str | Path,
    setting: Setting | None = None,
    compression: Compression = "zstd",
    *,
    wanted: Wanted | None = None,
    force: bool = False,
    tell: Tell = silent,
) -> Converted:
    """Make a recording of a log, plain or gzip.

    Messages stand in the order of the log: one whose time steps back arrives together with the one before it, and
    keeps its own time as that of its publishing.

    Args:
        path: of the log.
        output: of the recording.
        setting: what the log does not say.
        compression: of the recording.
        wanted: which topics; None for all.
        force: take the place of a file of this name.
        tell: is told which line it is at.

    Raises:
        LogError: the log cannot be opened.
        BagError: nothing in it is a message, or `output` is there already or cannot be written.
    """
    with new_file(output, compression, force=force) as writer:
        log = _Log(Added(writer, str(path)), setting if setting is not None else Setting(), wanted)
        for record in carmen.read(path):
            log.take(record)
            if record.line % _EACH == 0:
                tell(record.line, 0)
        log.end()
        return log.added.done(str(output), log.notes())


class _Log:
    """Takes the records of a log, and adds what they say."""

    def __init__(self, added: Added, setting: Setting, wanted: Wanted | None) -> None:
        self.added = added
        self._setting = setting
        self._wanted = wanted
        self._arrived: int | None = None
        self._laser = dict.fromkeys(("x", "y", "yaw"), 0.0)
        self._laser_is_said = False
        self._numbers: dict[str, int] = {}
        self._topics: dict[str, TopicInFile] = {}
        self._left_out = LeftOut()

    def take(self, record: carmen.Record) -> None:
        """One more."""
        try:
            self._take(record)
        except MessageError as error:  # a range that no float32 can be
            self._left_out.add(record.line, str(error))

    def _take(self, record: carmen.Record) -> None:
        setting = self._setting
        if self._left_out.takes(record):
            return
        match record:
            case carmen.LaserOffset():
                self._laser[record.part] = record.value
                self._laser_is_said = False
            case carmen.Motion():
                self._come(record.time)
                odometry = carmen.odometry(record, setting.odom_frame, setting.base_frame)
                self._add("tf", TFMessage([_moved(odometry)]), record.time)
                self._add("odom", odometry, record.time)
            case carmen.Scan():
                self._come(record.time)
                self._add("scan", carmen.laser_scan(record, setting.laser_frame, setting.range_max), record.time)

    def end(self) -> None:
        """The log is over: where the laser stands is said, though it said so last."""
        if not self._laser_is_said and self._arrived is not None:
            self._say_where_laser_is(self._arrived)

    def notes(self) -> list[str]:
        """What is left out."""
        return self._left_out.notes()

    def _come(self, time: int) -> None:
        """A record is due; it comes after those before it, whatever its time."""
        self._arrived = max(time, 0) if self._arrived is None else max(self._arrived, time)
        if not self._laser_is_said:
            self._say_where_laser_is(time)

    def _say_where_laser_is(self, time: int) -> None:
        self._laser_is_said = True
        yaw = self._laser["yaw"]
        place = Vector3(self._laser["x"], self._laser["y"])
        where = Transform(place, carmen.turn(yaw))
        header = Header(Time.from_nanoseconds(time), self._setting.base_frame)
        self._add("tf_static", TFMessage([TransformStamped(header, self._setting.laser_frame, where)]), time)

    def _add(self, name: str, message: Message, time: int) -> None:
        topic = self._topic(name, type(message))
        if self._wanted is not None and not self._wanted(topic.name):
            return
        assert self._arrived is not None
        data = cdr.encoder(type(message))(message)
        sequence = self._numbers[name] = self._numbers.get(name, 0) + 1
        self.added.add(self.added.topic(topic), data, self._arrived, max(time, 0), sequence)

    def _topic(self, name: str, type_: type[Message]) -> TopicInFile:
        topic = self._topics.get(name)
        if topic is None:
            qos = QoS.LATCHED if name == "tf_static" else QoS(depth=KEEP_ALL)
            topic = self._topics[name] = topic_of(names.join(self._setting.namespace, name), type_, qos)
        return topic


def _moved(odometry: Odometry) -> TransformStamped:
    """Where the base stands, as a transform."""
    pose = odometry.pose.pose
    place = Vector3(pose.position.x, pose.position.y, pose.position.z)
    return TransformStamped(odometry.header, odometry.child_frame_id, Transform(place, pose.orientation))
