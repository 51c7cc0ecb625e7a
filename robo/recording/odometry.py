"""Transforms made of odometry, where nobody publishes them: viewers draw robots by transforms alone. Pure."""

from collections.abc import Callable

from robo.bag.options import CDR, TopicInFile
from robo.bag.types import topic_of
from robo.errors import RoboError
from robo.interfaces import cdr
from robo.recording.conversion import Converted
from robo.text.unreadable import UNREADABLE
from robo.wire import names
from robo.wire.qos import QoS
from robo_messages import Header, Odometry, Quaternion, TFMessage, Transform, TransformStamped, Vector3

SOURCE = "robo bag record"
"""Who says them, in the counts of a recording."""

PATIENCE = 1_000_000_000
"""How long it is waited, ns, whether those who publish transforms of a robot tell of this one too."""

_ODOMETRY, _TRANSFORMS = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
_READ = frozenset((_ODOMETRY, _TRANSFORMS))
_TF = "tf"
_MOST_LINKS = 1_000

_Link = tuple[str, str]
"""A namespace, and the frame that stands in another."""


class TransformsOfOdometry:
    """Makes a `tf` of each odometry that has none."""

    def __init__(
        self, is_published: Callable[[str], bool] = lambda _: False, is_wanted: Callable[[str], bool] = lambda _: True
    ) -> None:
        """
        Args:
            is_published: says whether a node tells that it publishes a topic which is recorded.
            is_wanted: says whether transforms are to be made that stand on a topic.
        """
        self._is_published = is_published
        self._is_wanted = is_wanted
        self.made: dict[str, str] = {}
        """Topics of transforms that were made, with the odometry that they were made of."""
        self._of: dict[_Link, str] = {}
        """The topic that tells where a frame stands: several odometries may tell of one."""
        self._published: set[_Link] = set()
        self._begin: dict[_Link, int] = {}
        self._topics: dict[str, TopicInFile | None] = {}
        """Where transforms are told; None where nobody wants them."""
        self._numbers: dict[str, int] = {}
        self._decode = cdr.decoder(Odometry)
        self._decode_transforms = cdr.decoder(TFMessage)
        self._encode = cdr.encoder(TFMessage)

    def take(self, message: Converted) -> Converted | None:
        """See a message; what is to be written behind it, if anything."""
        topic = message.topic
        schema = topic.schema
        if schema not in _READ or topic.encoding != CDR:
            return None
        try:
            if schema == _ODOMETRY:
                return self._of_odometry(message)
            self._learn(message)
        except (ValueError, RoboError, *UNREADABLE):  # a viewer has to do without
            pass
        return None

    def _learn(self, message: Converted) -> None:
        """Somebody publishes transforms: which of them need not be made."""
        namespace, _, name = message.topic.name.rpartition("/")
        if name != _TF:
            return
        if not any(link[0] == namespace and link not in self._published for link in self._begin):
            return
        for transform in self._decode_transforms(message.data).transforms:
            link = namespace, transform.child_frame_id
            if link in self._begin:
                self._published.add(link)

    def _of_odometry(self, message: Converted) -> Converted | None:
        odometry = self._decode(message.data)
        topic = message.topic.name
        namespace = topic.rpartition("/")[0]
        parent, child = odometry.header.frame_id, odometry.child_frame_id
        link = namespace, child
        if not parent or not child or link in self._published or not self._tells(link, topic):
            return None
        begin = self._begin.setdefault(link, message.arrived)
        tf = names.join(namespace, _TF)
        if message.arrived - begin < PATIENCE and self._is_published(tf):
            return None
        if tf not in self._topics:
            self._topics[tf] = topic_of(tf, TFMessage, QoS(depth=100)) if self._is_wanted(tf) else None
        topic_of_transforms = self._topics[tf]
        return self._made(topic_of_transforms, odometry, message) if topic_of_transforms is not None else None

    def _tells(self, link: _Link, topic: str) -> bool:
        """Whether this odometry says where a frame stands: the first one of several, or the one that is called odom."""
        teller = self._of.get(link)
        if (teller is None and len(self._of) < _MOST_LINKS) or (teller != topic and topic.rpartition("/")[2] == "odom"):
            self._of[link] = teller = topic
        return teller == topic

    def _made(self, topic: TopicInFile, odometry: Odometry, message: Converted) -> Converted:
        pose = odometry.pose.pose
        place, turn = pose.position, pose.orientation
        header = Header(odometry.header.stamp, odometry.header.frame_id)
        stands = Transform(Vector3(place.x, place.y, place.z), Quaternion(turn.x, turn.y, turn.z, turn.w))
        data = self._encode(TFMessage([TransformStamped(header, odometry.child_frame_id, stands)]))
        self.made[topic.name] = message.topic.name
        self._numbers[topic.name] = number = self._numbers.get(topic.name, 0) + 1
        return Converted(topic, data, message.arrived, message.published, number, SOURCE)
