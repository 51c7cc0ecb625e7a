"""Transforms as they travel (ROS: tf2_msgs). Imported when its type is asked for."""

from robo_messages._registry import Message, message
from robo_messages.geometry import TransformStamped


@message("tf2/TFMessage")
class TFMessage(Message):
    """Where frames stand in their parents: what `tf` and `tf_static` carry."""

    transforms: list[TransformStamped] = []
    """In any order; each with a parent, a child and a time of its own."""
