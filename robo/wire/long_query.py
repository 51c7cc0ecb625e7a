"""A question whose answer may take long: the result of a goal. It outlives a link that is lost for a moment.

The answer comes on one of Zenoh's threads, which does no more than note it. Where the question ends without one, it is
asked again, as soon as somebody looks: the router in between may have started again. Where nobody answers for GRACE,
whoever was asked is gone. What is asked just after a loss may still go by the link that is being lost, and Zenoh does
not end that: so it is asked once more when it has stood for GRACE. An answer counts whichever time of asking it is to:
the news that a server leaves may come before what it has answered last.
"""

from __future__ import annotations

from collections.abc import Callable

import zenoh

from robo.wire import queries
from robo.wire.queries import Fault
from robo.wire.targets import OF_ONE

LONGEST = 3600.0
"""How long one question stays open, s; then it is asked again."""

GRACE = 2.0
"""For how long nobody may answer, s."""

PERIOD = 0.2
"""How often it is asked again meanwhile, s."""


class Gone(Exception):
    """Nobody is there who could answer."""


class _Try:
    """One time of asking."""

    def __init__(
        self, answer: Callable[[zenoh.Sample | Fault], None], changed: Callable[[], None], now: Callable[[], float]
    ) -> None:
        self.lapsed = False
        self.ended_at: float | None = None
        self._answer = answer
        self._changed = changed
        self._now = now
        self.asked_at = now()

    def take(self, reply: zenoh.Reply) -> None:
        answer = reply.ok if reply.ok is not None else queries.read_fault(reply)
        self.lapsed = answer is None
        if answer is not None:
            self._answer(answer)

    def end(self) -> None:
        if self.ended_at is None:
            self.ended_at = self._now()
        self._changed()

    @property
    def stood(self) -> bool:
        """Whether somebody was there to answer, for a while."""
        return self.ended_at is not None and self.ended_at - self.asked_at >= PERIOD


class LongQuery:
    """Asks until there is an answer, or nobody who could give one."""

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        payload: bytes,
        encoding: str,
        changed: Callable[[], None],
        now: Callable[[], float],
    ) -> None:
        """
        Args:
            session: the network.
            key: whom to ask.
            payload: what.
            encoding: of the payload.
            changed: is called, on any thread, when it is time to `look`.
            now: the time, s.
        """
        self._session = session
        self._key = key
        self._payload = payload
        self._encoding = encoding
        self._changed = changed
        self._now = now
        self._answer: zenoh.Sample | Fault | None = None
        self._lost_since: float | None = None
        self._losses = 0
        self._try = self._ask()

    def look(self) -> zenoh.Sample | Fault | None:
        """The answer, if it is there.

        Raises:
            Gone: nobody answers any more.
        """
        if self._answer is not None:
            return self._answer
        current, now = self._try, self._now()
        if current.ended_at is None:
            if now < self.look_again_at:
                return None
            self._lost_since = None  # this time goes by a link that is there
        elif current.lapsed:
            self._lost_since = None
        elif self._lost_since is None or current.stood:
            self._lost_since = now
        elif current.ended_at - self._lost_since >= GRACE:
            raise Gone
        elif now < self.look_again_at:
            return None
        losses = self._losses
        self._try = self._ask()
        if self._losses != losses:
            self._try.end()
        return None

    def lose(self) -> None:
        """Whoever was asked is not there just now: no answer to that time of asking will come.

        Zenoh ends what a server holds that is killed, and then hands it for a moment what is asked again: that it
        does not end. So it counts for who is just asking, too.
        """
        self._losses += 1
        self._try.end()

    @property
    def look_again_at(self) -> float:
        """By when to look again, if nothing changes before; infinity where that is not needed."""
        if self._answer is not None:
            return float("inf")
        if self._try.ended_at is not None:
            return self._try.asked_at + PERIOD
        return self._try.asked_at + GRACE if self._lost_since is not None else float("inf")

    def _take(self, answer: zenoh.Sample | Fault) -> None:
        if self._answer is None:
            self._answer = answer
            self._changed()

    def _ask(self) -> _Try:
        asked = _Try(self._take, self._changed, self._now)
        self._session.get(
            self._key,
            zenoh.handlers.Callback(asked.take, asked.end, indirect=False),
            payload=self._payload,
            encoding=self._encoding,
            timeout=LONGEST,
            **OF_ONE,
        )
        return asked
