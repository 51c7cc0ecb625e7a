"""What others may ask a player: services under its name, `r1/bag_player/pause` and so on."""

from collections.abc import Callable
from typing import Any

import zenoh

from robo.node.services import ServiceServer, service_token
from robo.node.turn import Turn
from robo.recording.play.player import Player
from robo.wire import names
from robo_messages import GetPlayback, GetRate, IsPaused, Seek, SetRate, Time, Trigger


class PlayerServices:
    """Answers while it is there."""

    def __init__(self, session: zenoh.Session, player: Player, node: str, on_stop: Callable[[], None]) -> None:
        """
        Args:
            session: the network.
            player: who is asked.
            node: its full name.
            on_stop: called when somebody wants it to end.
        """
        self._player = player
        self._on_stop = on_stop
        namespace, name = names.split(node)
        turn = Turn()
        served: list[tuple[str, Any, Callable[[Any], Any]]] = [
            ("pause", Trigger, self._pause),
            ("resume", Trigger, self._resume),
            ("toggle_paused", Trigger, self._toggle),
            ("step", Trigger, self._step),
            ("play_next", Trigger, self._step),  # as ROS calls it
            ("stop", Trigger, self._stop),
            ("seek", Seek, self._seek),
            ("set_rate", SetRate, self._set_rate),
            ("get_rate", GetRate, self._get_rate),
            ("is_paused", IsPaused, self._is_paused),
            ("get_playback", GetPlayback, self._get_playback),
        ]
        self._servers: list[ServiceServer[Any, Any]] = []
        try:
            for word, type_, handler in served:
                key = names.join(namespace, name, word)
                token = service_token(namespace, name, "srv", type_.Request, type_.Response, key)
                self._servers.append(
                    ServiceServer(session, token, type_.Request, type_.Response, turn, handler, _told_to_the_caller)
                )
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Answer no more."""
        for server in self._servers:
            server.stop(0.5)

    def _pause(self, _: Trigger.Request) -> Trigger.Response:
        self._player.pause()
        return Trigger.Response()

    def _resume(self, _: Trigger.Request) -> Trigger.Response:
        self._player.resume()
        return Trigger.Response()

    def _toggle(self, _: Trigger.Request) -> Trigger.Response:
        self._player.toggle()
        return Trigger.Response(message="paused" if self._player.state.paused else "playing")

    def _step(self, _: Trigger.Request) -> Trigger.Response:
        done = self._player.step()
        return Trigger.Response(done, "" if done else "it is not paused, or at the end")

    def _stop(self, _: Trigger.Request) -> Trigger.Response:
        self._on_stop()
        return Trigger.Response()

    def _seek(self, request: Seek.Request) -> Seek.Response:
        at = request.time.to_nanoseconds()
        return Seek.Response(self._player.seek(at) == at)

    def _set_rate(self, request: SetRate.Request) -> SetRate.Response:
        self._player.change_rate(request.rate)
        return SetRate.Response(success=True)

    def _get_rate(self, _: GetRate.Request) -> GetRate.Response:
        return GetRate.Response(self._player.state.rate)

    def _is_paused(self, _: IsPaused.Request) -> IsPaused.Response:
        return IsPaused.Response(self._player.state.paused)

    def _get_playback(self, _: GetPlayback.Request) -> GetPlayback.Response:
        state = self._player.state
        begin, end, position = map(Time.from_nanoseconds, (*self._player.span, state.position))
        return GetPlayback.Response(begin, end, position, state.rate, state.paused)


def _told_to_the_caller(_: BaseException) -> None:
    """What a request brings about is told to whoever asked, and to nobody else."""
