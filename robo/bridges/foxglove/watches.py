"""Changes of parameters, as nodes tell them."""

from collections.abc import Callable
from typing import Any

import zenoh

from robo.bridges.foxglove.calls import shown_parameter
from robo.bridges.foxglove.protocol import Parameter
from robo.wire import codec
from robo.wire.codec import Malformed
from robo.wire.keys import PARAMETER_EVENTS_TOPIC
from robo_messages import ParameterEvent


class ParameterWatch:
    """Hears of changes, while somebody wants to."""

    def __init__(
        self,
        session: zenoh.Session,
        changed: Callable[[list[Parameter]], None],
        covers: Callable[[str], bool] = lambda _: True,
    ) -> None:
        """
        Args:
            session: the network.
            changed: gets them by Zenoh's threads.
            covers: of which nodes, by their full names without a slash before them.
        """
        self._session, self._changed, self._covers = session, changed, covers
        self._decoder = codec.Decoder(ParameterEvent)
        self._subscriber: Any = None

    def set(self, wanted: bool) -> None:
        """Whether somebody wants to hear of them."""
        if wanted and self._subscriber is None:
            self._subscriber = self._session.declare_subscriber(f"**/{PARAMETER_EVENTS_TOPIC}", self._hear)
        elif not wanted:
            self.close()

    def close(self) -> None:
        """Hear no more."""
        if self._subscriber is not None:
            self._subscriber.undeclare()
            self._subscriber = None

    def _hear(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        try:
            event = self._decoder.decode(sample.payload.to_bytes(), str(sample.encoding))
        except Malformed:
            return  # a stranger's
        if not self._covers(event.node.strip("/")):
            return
        node = "/" + event.node.strip("/")
        changed = [
            shown_parameter(node, one.name, one.value) for one in (*event.new_parameters, *event.changed_parameters)
        ]
        self._changed([*changed, *(Parameter(f"{node}.{one.name}") for one in event.deleted_parameters)])
