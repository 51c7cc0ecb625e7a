"""What viewers drive and stop, and that whoever stops a robot ends their grips on it."""

import time
from collections.abc import Callable

import zenoh

from robo.bridges.foxglove.drivers import Drivers
from robo.dashboard.requests import STOP
from robo.dashboard.stops import Stops
from robo.wire import codec
from robo_messages import Bool, DiagnosticStatus, KeyValue

_STATE = "safety_state"
"""What a safety monitor says, once a second and more often."""
_LATCHED = KeyValue("reason", "emergency_stop")


class Driving:
    """Hears of emergency stops, whoever asks for them: on their topic, and from safety monitors."""

    def __init__(self, session: zenoh.Session, covers: Callable[[str], bool]) -> None:
        """
        Args:
            session: the network.
            covers: of which topics it is heard, by their keys.
        """
        self.drivers = Drivers()
        self.stops = Stops(session)
        """Nothing else is in their way, nor that of one robot in another one's."""
        self._covers = covers
        self._asked, self._told = codec.Decoder(Bool), codec.Decoder(DiagnosticStatus)
        at_once = zenoh.handlers.Callback(self._notice, indirect=False)
        self._subscribers = [session.declare_subscriber(f"**/{name}", at_once) for name in (STOP, _STATE)]

    def close(self) -> None:
        """Hear no more, and stop none any more."""
        self.stops.close()
        for one in self._subscribers:
            one.undeclare()

    def _notice(self, sample: zenoh.Sample) -> None:
        robot, _, name = str(sample.key_expr).rpartition("/")
        if sample.kind == zenoh.SampleKind.PUT and self._covers(str(sample.key_expr)):
            try:
                stopped = self._is_stop(sample) if name == STOP else self._is_latched(sample)
            except codec.Malformed:
                return  # a stranger's
            if stopped:
                self.drivers.end(robot, time.monotonic())

    def _is_stop(self, sample: zenoh.Sample) -> bool:
        return self._asked.decode(sample.payload.to_bytes(), str(sample.encoding)).data

    def _is_latched(self, sample: zenoh.Sample) -> bool:
        return _LATCHED in self._told.decode(sample.payload.to_bytes(), str(sample.encoding)).values
