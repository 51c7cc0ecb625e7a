"""What says where frames stand: the parts of nodes that broadcast transforms."""

from robo.node.declare import Publisher
from robo.node.part import Part
from robo.tf.check import checked
from robo_messages import TFMessage, TransformStamped

TF, TF_STATIC = "tf", "tf_static"
"""The topics of transforms, as in ROS: relative, so that each robot has its own."""

DEPTH = 100
"""Messages that may wait: from many frames at a high rate, in a burst."""


class TransformBroadcaster(Part):
    """Says where frames stand that move."""

    tf = Publisher(TFMessage, TF, depth=DEPTH)
    """Where frames stand in others, m."""

    def send(self, *transforms: TransformStamped) -> None:
        """Say where frames stand, each at the time of its header.

        Raises:
            InvalidTransform: an empty name, a number that is not finite, a rotation that is none.
        """
        self.tf.publish(_checked(transforms))


class StaticTransformBroadcaster(Part):
    """Says where frames stand that never move, to whoever comes, whenever he comes."""

    tf_static = Publisher(TFMessage, TF_STATIC, latched=True)
    """Where frames stand in others at all times, m."""

    def __init__(self) -> None:
        self._said: dict[str, TransformStamped] = {}

    def send(self, *transforms: TransformStamped) -> None:
        """Say where frames stand, beside those that were said before.

        Raises:
            InvalidTransform: as `TransformBroadcaster.send`.
        """
        _checked(transforms)
        # The last message is what latecomers get, so it says all.
        self._said |= {transform.child_frame_id: transform for transform in transforms}
        self.tf_static.publish(TFMessage(list(self._said.values())))


def _checked(transforms: tuple[TransformStamped, ...]) -> TFMessage:
    for transform in transforms:
        header = transform.header
        checked(transform, header.frame_id, transform.child_frame_id, header.stamp.to_nanoseconds())
    return TFMessage(list(transforms))
