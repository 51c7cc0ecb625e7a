"""Who drives: one browser at a time, for as long as it says so. Pure: who asks says what time it is."""

import math

LEASE = 1.0
"""For how long somebody drives after a last word, s."""
MOST_AGE = 0.25
"""An older command is refused, s: the network held it up, or the browser slept."""
SILENCE = 0.25
"""Without a command for so long the robot is told to stand, s."""
ZEROS = 5
"""How often it is told so: one may get lost."""
_APART = 0.04
"""So far at least, s: else a single burst of loss would take them all."""
_AHEAD = 0.05
"""So much may two clocks differ in how fast they run, between two beats, s."""


class Lease:
    """Who drives, and what the robot is to be told."""

    def __init__(self) -> None:
        self.driver: str | None = None
        """Who it is; None while nobody does."""
        self._until = 0.0
        self._last = -math.inf
        self._zeros = 0
        self._next_zero = -math.inf
        self._moves = False

    @property
    def is_idle(self) -> bool:
        """Whether nobody drives, and the robot need not be told anything more."""
        return self.driver is None and not self._moves and not self._zeros

    def is_due(self, now: float) -> bool:
        """Whether a zero is to be sent by now."""
        return bool(self._zeros) and now >= self._next_zero

    def take(self, who: str, now: float) -> bool:
        """Begin to drive, or go on. Returns whether `who` is the one who does."""
        if self.driver not in (None, who) and now < self._until:
            return False
        if self.driver != who:
            self._stand()
        self.driver, self._until = who, now + LEASE
        return True

    def give(self, who: str) -> None:
        """Drive no more: let go, gone, or asleep. The robot is told to stand."""
        if self.driver == who:
            self.driver = None
            self._stand()

    def end(self) -> str | None:
        """Whoever drives does so no more, unasked, and the robot is told to stand. Returns who that was."""
        who = self.driver
        if who is not None:
            self.give(who)
        return who

    def is_over(self, now: float) -> bool:
        """Whether its driver has been silent for too long."""
        return self.driver is not None and now >= self._until

    def expire(self, now: float) -> bool:
        """End it where its driver has been silent for too long; whether that is so."""
        return self.is_over(now) and self.end() is not None

    def command(self, who: str, now: float) -> bool:
        """A command has come that may be carried out; whether it may, since nobody else drives."""
        if not self.take(who, now):
            return False
        self._last, self._moves, self._zeros = now, True, 0
        return True

    def is_to_stand(self, now: float) -> bool:
        """Whether the robot is to be told now to stand: asked some twenty times a second, or more often."""
        self.expire(now)
        if self._moves and now - self._last > SILENCE:
            self._stand()
        if self.is_due(now):
            self._zeros -= 1
            self._next_zero = now + _APART
            return True
        return False

    @property
    def stands(self) -> bool:
        """Whether all has been said: it was told to stand, or never to move."""
        return not (self._moves or self._zeros)

    def _stand(self) -> None:
        if self._moves:
            self._moves, self._zeros, self._next_zero = False, ZEROS, -math.inf


class Beats:
    """Numbered beats to a browser, by which the age of what it says is known without its clock being right."""

    def __init__(self, most: int = 100) -> None:
        self._sent: dict[int, float] = {}
        self._most = most
        self._number = 0

    def next(self, now: float) -> int:
        """The number of a beat that is sent now."""
        self._number += 1
        self._sent[self._number] = now
        if len(self._sent) > self._most:
            del self._sent[next(iter(self._sent))]
        return self._number

    def age(self, heard: int, since: float, now: float) -> float:
        """How old a word can be at most that was said `since` s after beat `heard` had come; inf where that is unknown.

        The way of the beat to the browser counts too, since nobody can tell it from the way back.
        """
        sent = self._sent.get(heard)
        if sent is None or not 0.0 <= since <= now - sent + _AHEAD:
            return math.inf  # nobody can have waited longer than the beat is old
        return max(0.0, now - sent - since)
