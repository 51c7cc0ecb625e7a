"""Publishers of the bridge, in either network: plain ones, and such as keep what they said last."""

import time
from collections.abc import Callable
from typing import Any

import zenoh

from robo.bridges.ros2 import stamps
from robo.bridges.ros2.quality import RosQoS
from robo.node.topics import LONGEST_AGE
from robo.wire import codec, sources
from robo.wire.keys import EndpointToken, source_id
from robo.wire.latched import LatchedPublisher
from robo.wire.names import split
from robo.wire.qos import QoS, zenoh_priority

CDR = "application/cdr"


class RoboOutlet:
    """Publishes on a topic of robo's, under the bridge's own name: what ROS's nodes are called drives nothing."""

    def __init__(
        self, session: zenoh.Session, node: str, key: str, type_name: str, qos: QoS, *, to_itself: bool = False
    ) -> None:
        """
        Args:
            session: robo's network.
            node: the bridge's full name.
            key: of the topic.
            type_name: of its messages.
            qos: what it latches, and what it keeps.
            to_itself: whether nobody hears it but this very session, which keeps what it has heard by itself.
        """
        encoding = f"{codec.MSGPACK};{type_name}"
        control = zenoh.CongestionControl.BLOCK if qos.reliable else zenoh.CongestionControl.DROP
        priority = zenoh_priority(qos.priority)
        self._publisher: zenoh.Publisher | LatchedPublisher
        keeps = qos.latched and not to_itself
        if keeps:
            self._publisher = LatchedPublisher(session, key, qos.depth, encoding, control, priority)
        else:
            reach = zenoh.Locality.SESSION_LOCAL if to_itself else zenoh.Locality.ANY
            self._publisher = session.declare_publisher(
                key, encoding=encoding, congestion_control=control, priority=priority, allowed_destination=reach
            )
        self.qos = qos
        self.id = source_id(self._publisher.id)
        """By which its messages are known."""
        token = EndpointToken(*split(node), "pub", type_name, qos, key, self.id)
        self._token = None if to_itself else session.liveliness().declare_token(token.key())
        self._put: Callable[..., None] = self._publisher.put
        # A latched publisher says by itself whose its messages are.
        self._source = None if keeps else sources.counted(self._publisher.id)
        self._number = 0

    def send(self, payload: bytes, age: float = 0.0) -> None:
        """Publish a message.

        Args:
            payload: as MessagePack.
            age: how long ago it was said, s; infinite where nobody knows.
        """
        self._number += 1
        stamp = codec.pack_attachment(self._number, time.time_ns() - int(min(age, LONGEST_AGE) * 1e9))
        if self._source is None:
            self._put(payload, attachment=stamp)
        else:
            self._put(payload, attachment=stamp, source_info=self._source())

    @property
    def is_heard(self) -> bool:
        """Whether anybody listens."""
        status: Any = self._publisher.matching_status  # zenoh's stub says bool, it is an object
        return bool(status.matching)

    def close(self) -> None:
        """Publish no more."""
        if self._token is not None:
            self._token.undeclare()
        self._publisher.undeclare()


class RosOutlet:
    """Publishes on a topic of ROS's, as rmw_zenoh does."""

    def __init__(self, session: zenoh.Session, key: str, gid: bytes, quality: RosQoS) -> None:
        """
        Args:
            session: ROS's network.
            key: of the topic's messages.
            gid: the id of the end that is announced for it.
            quality: that it promises.
        """
        # As rmw_zenoh: what keeps all waits for a reader that is busy, and nothing else does.
        waits = quality.reliable and quality.keep_all
        control = zenoh.CongestionControl.BLOCK if waits else zenoh.CongestionControl.DROP
        self._publisher: Any
        if quality.transient_local:
            from zenoh import ext

            self._publisher = ext.declare_advanced_publisher(
                session,
                key,
                encoding=CDR,
                congestion_control=control,
                cache=ext.CacheConfig(max_samples=quality.depth),
                publisher_detection=True,
            )
        else:
            self._publisher = session.declare_publisher(key, encoding=CDR, congestion_control=control)
        self._put: Callable[..., None] = self._publisher.put
        self._keeps = quality.transient_local
        self._gid = gid
        self._number = 0

    @property
    def is_heard(self) -> bool:
        """Whether anybody listens, or may later hear what is said now."""
        status: Any = self._keeps or self._publisher.matching_status  # zenoh's stub says bool, it is an object
        return status is True or bool(status.matching)

    def send(self, data: bytes, said: int) -> None:
        """Publish a message.

        Args:
            data: CDR.
            said: when it was said, ns since the epoch.
        """
        self._number += 1
        self._put(data, attachment=stamps.pack(self._number, said, self._gid))

    def close(self) -> None:
        """Publish no more."""
        self._publisher.undeclare()
