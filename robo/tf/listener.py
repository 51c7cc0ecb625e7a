"""What knows where frames stand: the part of nodes that listens to transforms.

class Follower(Node):
    transforms = TransformListener()

    @subscribe("scan")
    def on_scan(self, scan: LaserScan) -> None:
        odom_laser = self.transforms.lookup("odom", scan.header.frame_id, scan.header.stamp, timeout=0.1)
"""

import threading

from robo.errors import TransformError
from robo.node.declare import subscribe
from robo.node.message_info import MessageInfo
from robo.node.part import Part
from robo.node.turn import paused
from robo.tf.broadcasters import DEPTH, TF, TF_STATIC
from robo.tf.buffer import Buffer, When
from robo.tf.transform import Transform3
from robo_messages import TFMessage

_TURN = "tf"
"""Transforms are taken in while a callback of the node computes: what it looks up then is not old."""


class TransformListener(Part):
    """Takes in what a robot's nodes say of its frames, and looks up where one stands in another."""

    def __init__(self, duration: float = 10.0) -> None:
        """`duration` is how long what has come is kept, s."""
        self.buffer = Buffer(duration)
        """All that has come: what it offers more than `lookup`."""
        self._warned = 0
        self._waiting: set[threading.Event] = set()

    @subscribe(TF, depth=DEPTH, turn=_TURN)
    def on_transforms(self, message: TFMessage, info: MessageInfo) -> None:
        """Take in frames that move."""
        self._take(message, info, static=False)

    @subscribe(TF_STATIC, latched=True, depth=DEPTH, turn=_TURN)
    def on_static_transforms(self, message: TFMessage, info: MessageInfo) -> None:
        """Take in frames that do not move."""
        self._take(message, info, static=True)

    def lookup(self, target: str, source: str, time: When = None, timeout: float = 0.0) -> Transform3:
        """Where `source` stands in `target`: the transform that takes coordinates in `source` to those in `target`.

        Args:
            target: the frame that coordinates are wanted in.
            source: the frame that they are in.
            time: when, such as a message's stamp; None is the newest time at which all between the two is known.
            timeout: how long to wait where that is not known yet, s; other callbacks of the node run meanwhile.

        Raises:
            TransformError: what is missing, too old or in the future, see `Buffer.lookup`.
        """
        if timeout <= 0.0:
            return self.buffer.lookup(target, source, time)
        clock, news = self.node.clock, threading.Event()
        until = clock.monotonic() + timeout
        self._waiting.add(news)
        try:
            with paused():
                while True:
                    jumps = clock.jumps
                    news.clear()
                    try:
                        return self.buffer.lookup(target, source, time)
                    except TransformError:
                        if clock.monotonic() >= until or self.node.stopping:
                            raise
                    clock.wait(news, until, jumps)
        finally:
            self._waiting.discard(news)

    def _take(self, message: TFMessage, info: MessageInfo, *, static: bool) -> None:
        self.buffer.insert_all(message.transforms, static, info.sender)
        if self.buffer.warning_count != self._warned:
            self._warned = self.buffer.warning_count
            warning = self.buffer.warnings()[-1]
            self.node.logger.warning("transforms: %s", warning.text, throttle=10.0)
        if self._waiting:
            for news in list(self._waiting):
                news.set()
            self.node.clock.wake()
