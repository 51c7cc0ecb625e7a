"""Whether a message is a transform: looked at where it is sent, and where a buffer takes it."""

from robo.errors import InvalidTransform
from robo.tf import faults
from robo.tf.history import MOST_NS
from robo.tf.screw import Seven
from robo.tf.transform import unit
from robo_messages import TransformStamped


def checked(message: TransformStamped, parent: str, child: str, ns: int) -> Seven:
    """The numbers of a transform that can be one.

    Raises:
        InvalidTransform: they cannot, or its names or its stamp cannot.
    """
    if not parent:
        raise InvalidTransform("header.frame_id is empty, and names the parent frame")
    if not child:
        raise InvalidTransform("child_frame_id is empty, and names the child frame")
    if parent == child:
        raise InvalidTransform("a frame cannot stand in itself; header.frame_id names its parent")
    if abs(ns) > MOST_NS:
        raise InvalidTransform(f"its stamp, {faults.seconds(ns)}, is further from 1970 than 146 years")
    p, q = message.transform.translation, message.transform.rotation
    return unit((p.x, p.y, p.z, q.x, q.y, q.z, q.w))
