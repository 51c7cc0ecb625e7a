"""Transforms between coordinate frames: a buffer of what came, and lookups at any time (ROS: tf2).

The buffer needs no network; nodes have it, and broadcasters, as parts.

from robo.tf import Buffer, Transform3, transform_point

buffer = Buffer()
buffer.insert_all(message.transforms, source="odometry")
odom_laser = buffer.lookup("odom", "laser", scan.header.stamp)
x, y, z = odom_laser.apply(1.0, 0.0, 0.0)
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robo.errors import (
        ExtrapolationError,
        FrameLoop,
        FramesNotConnected,
        InTheFuture,
        InvalidTransform,
        NoTransformData,
        TooOld,
        TransformError,
        UnknownFrame,
    )
    from robo.tf.apply import scan_array, scan_points, transform_point, transform_pose, transform_vector
    from robo.tf.broadcasters import StaticTransformBroadcaster, TransformBroadcaster
    from robo.tf.buffer import Buffer
    from robo.tf.frames import FrameInfo
    from robo.tf.listener import TransformListener
    from robo.tf.notes import TransformWarning
    from robo.tf.transform import IDENTITY, Transform3, interpolate

__all__ = [
    "IDENTITY",
    "Buffer",
    "ExtrapolationError",
    "FrameInfo",
    "FrameLoop",
    "FramesNotConnected",
    "InTheFuture",
    "InvalidTransform",
    "NoTransformData",
    "StaticTransformBroadcaster",
    "TooOld",
    "Transform3",
    "TransformBroadcaster",
    "TransformError",
    "TransformListener",
    "TransformWarning",
    "UnknownFrame",
    "interpolate",
    "scan_array",
    "scan_points",
    "transform_point",
    "transform_pose",
    "transform_vector",
]

_HOMES = {
    "tf.apply": ("scan_array", "scan_points", "transform_point", "transform_pose", "transform_vector"),
    "tf.broadcasters": ("StaticTransformBroadcaster", "TransformBroadcaster"),
    "tf.buffer": ("Buffer",),
    "tf.frames": ("FrameInfo",),
    "tf.listener": ("TransformListener",),
    "tf.notes": ("TransformWarning",),
    "tf.transform": ("IDENTITY", "Transform3", "interpolate"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import what is asked for: who keeps a buffer needs no more than that."""
    if name not in __all__:
        raise AttributeError(f"module 'robo.tf' has no attribute {name!r}")
    value: object = getattr(importlib.import_module(f"robo.{_HOME.get(name, 'errors')}"), name)
    globals()[name] = value
    return value
