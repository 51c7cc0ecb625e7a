"""Whoever plays a recording on this network, as viewers see it: its place in time, and their controls."""

import threading
import time
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import zenoh

import robo_messages
from robo.bridges.foxglove import protocol
from robo.bridges.foxglove.protocol import Control
from robo.errors import MessageError, RoboError
from robo.node import services
from robo.wire import codec, names
from robo.wire.codec import Malformed
from robo_messages import GetPlayback, Message, Seek, SetRate, Time, Trigger

A = TypeVar("A", bound=Message)

PERIOD = 0.25
"""How often a player is asked how far it has come, s."""
_TIMEOUT = 2.0
"""s."""
_PATIENCE = 10_000_000_000
"""A player that is there and does not answer is believed so long to go on, ns: viewers forget all when it is gone."""
_JUMP = 1_000_000_000
"""Whoever is so far, ns, from where he should be has jumped."""


class Place(NamedTuple):
    """How far a recording is played."""

    begin: int
    end: int
    position: int
    """These in ns since the epoch."""
    rate: float
    paused: bool
    asked: int
    """When, ns by the monotonic clock."""

    def at(self, now: int) -> int:
        """How far it has come since, ns since the epoch.

        Args:
            now: ns, by the monotonic clock.
        """
        if self.paused or self.rate <= 0:
            return self.position
        return min(self.end, self.position + round((now - self.asked) * self.rate))

    def state(self, request: str = "", *, jumped: bool = False) -> bytes:
        """As viewers are told it."""
        ended = self.position >= self.end
        status = protocol.ENDED if ended else protocol.PAUSED if self.paused else protocol.PLAYING
        return protocol.playback(status, self.position, self.rate, request, jumped=jumped)

    def continues(self, before: "Place") -> bool:
        """Whether it is where it had to be by what was told before."""
        same = (self.begin, self.end, self.rate, self.paused) == (before.begin, before.end, before.rate, before.paused)
        return same and abs(self.position - before.at(self.asked)) < _JUMP


class Playback:
    """The player of this network, if there is one."""

    def __init__(self, session: zenoh.Session, told: Callable[[Place | None, bool], None]) -> None:
        """
        Args:
            session: the network.
            told: gets by a thread how far the recording is played, now and then and when somebody has changed
                something, and whether it has jumped; None where it is over.
        """
        self._session, self._told = session, told
        self._changed = threading.Condition()
        self._player = ""
        self._over = False
        self._telling = threading.Lock()
        self._last = 0
        """What time was told last, ns since the epoch."""
        self.place: Place | None = None
        """As it was told last."""
        self._controls = 0
        """How often somebody has changed something: an answer of before does not hold."""
        self._thread = threading.Thread(target=self._run, name="robo-foxglove-playback", daemon=True)
        self._thread.start()

    def follow(self, player: str) -> None:
        """Follow the player of this name, or none where it is empty."""
        with self._changed:
            if player != self._player:
                self._player = player
                self._changed.notify()

    def now(self) -> int | None:
        """How far it has come, ns since the epoch; None where nothing is played."""
        with self._telling:
            place = self.place
            if place is None:
                return None
            at, last = place.at(time.monotonic_ns()), self._last
            # Between two looks it is reckoned. Where that was a little too much, time stands: viewers that see it go
            # back forget all that they show.
            self._last = last if 0 < last - at < _JUMP else at
            return self._last

    def control(self, asked: Control) -> Place:
        """Do what a viewer wants; it blocks. Returns where that is.

        Raises:
            ServiceError: the player refuses, or does not answer.
            MessageError: there is none, or it answers what makes no sense.
        """
        player = self._player
        if not player:
            raise MessageError("nobody plays a recording any more")
        before = self._ask(player)
        if asked.rate > 0 and abs(asked.rate - before.rate) > 1e-6:
            self._call(player, "set_rate", SetRate.Request(float(asked.rate)), SetRate.Response)
        if not asked.plays and not before.paused:
            self._call(player, "pause", Trigger.Request(), Trigger.Response)
        if asked.seek is not None:
            self._call(player, "seek", Seek.Request(Time.from_nanoseconds(asked.seek)), Seek.Response)
        if asked.plays and before.paused:
            self._call(player, "resume", Trigger.Request(), Trigger.Response)
        place = self._ask(player)
        with self._telling:
            self.place = place
            self._controls += 1
            if asked.seek is not None:
                self._last = 0
        return place

    def close(self) -> None:
        """Ask no more."""
        with self._changed:
            self._over = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                if self.place is None and not self._player:
                    self._changed.wait_for(lambda: self._over or bool(self._player))
                else:
                    self._changed.wait_for(lambda: self._over, PERIOD)
                if self._over:
                    return
                player = self._player
            self._look(player)

    def _look(self, player: str) -> None:
        with self._telling:
            before, controls = self.place, self._controls
        try:
            place = self._ask(player) if player else None
        except (RoboError, zenoh.ZError):
            if before is not None and time.monotonic_ns() - before.asked < _PATIENCE:
                return  # whether it is gone, its token says
            place = None
        with self._telling:
            if controls != self._controls:
                return
            self.place = place
        if place is None or before is None:
            if place is not before:
                self._told(place, False)
        elif not place.continues(before):
            self._told(place, abs(place.position - before.at(place.asked)) >= _JUMP)

    def _ask(self, player: str) -> Place:
        said = self._call(player, "get_playback", GetPlayback.Request(), GetPlayback.Response)
        begin, end, position = (one.to_nanoseconds() for one in (said.begin, said.end, said.position))
        return Place(begin, end, position, said.rate, said.paused, time.monotonic_ns())

    def _call(self, player: str, word: str, request: Message, response: type[A]) -> A:
        payload = robo_messages.encode(request), codec.pack_attachment(1, time.time_ns())
        encoding = codec.encoding_of(type(request))
        sample = services.ask(self._session, names.join(player, word), payload, encoding, _TIMEOUT, _TIMEOUT)
        try:
            return codec.Decoder(response).decode(sample.payload.to_bytes(), str(sample.encoding))
        except Malformed as reason:
            raise MessageError(f"the answer of {player} cannot be read: {reason}") from None
