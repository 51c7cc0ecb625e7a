"""What a viewer is told first: what can be done here, and whether that is another session than it knows."""

import secrets

from robo.bridges.foxglove import protocol
from robo.bridges.foxglove.client import Client
from robo.bridges.foxglove.playback import Place


class About:
    """What holds for all viewers at a time."""

    def __init__(self, name: str) -> None:
        """`name` is what viewers show."""
        self._name = name
        self._session_id = secrets.token_hex(8)
        self._has_clock = False
        self._place: Place | None = None

    def look(self, *, has_clock: bool, place: Place | None) -> bool:
        """See what times are told: of a clock, of a recording that is at a place, of none.

        Returns:
            Whether viewers begin anew, since all times are other ones.
        """
        before = self._has_clock, _span(self._place)
        self._has_clock, self._place = has_clock, place
        is_new = before != (has_clock, _span(place))
        if is_new:
            self._session_id = secrets.token_hex(8)
        return is_new

    def info(self, client: Client) -> str:
        """For a viewer."""
        capabilities = ["parameters", "parametersSubscribe", "connectionGraph"]
        if client.drives:
            capabilities += ["clientPublish", "services"]
        if self._has_clock or self._place is not None:
            capabilities.append("time")
        span = None
        if self._place is not None and client.knows_playback and client.drives:
            capabilities.append("playbackControl")
            span = _span(self._place)
        return protocol.server_info(self._name, capabilities, self._session_id, span)


def _span(place: Place | None) -> tuple[int, int] | None:
    return (place.begin, place.end) if place is not None else None
