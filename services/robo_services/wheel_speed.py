"""What the board is told of one wheel: whole ticks per loop, right in the mean; and whether the wheel does it."""

import math

import msgspec

CORRECTION = 1.5
"""How quickly a wheel's speed is corrected, 1/s."""
PATIENCE = 1.0
"""A wheel may take this time until it turns as it is told, s."""
LEAST = 0.1
"""A wheel that counts a smaller share of what it is told does not turn, or nobody counts it."""
GLANCE = 0.25
"""Whether it does is seen over this time, s."""
FULL_DUTY = 255.0
"""What the board gives a motor at most; with half of it a wheel turns that can."""
LONG = 5.0
"""After this time, s, a wheel that does not turn is told of, however little power it is given."""
LONGEST_GAP = 0.5
"""What the wheel did in a longer silence nobody knows, s."""
SILENT = "does not count: encoder, wires, motor or its power"
BACKWARDS = "counts backwards: exchange the wires of its motor, or of its encoder"


class WheelLimits(msgspec.Struct, frozen=True, kw_only=True):
    """What may be told to a wheel."""

    period: float
    """It is told a speed once in this time, s."""
    loop_period: float
    """Of the board's loop, s."""
    trim: float
    """By at most so many ticks per loop it is told to turn faster or slower than wanted, where it does not."""
    fastest: float
    """Ticks per loop: it is told no more."""
    gain: float
    """By how much the board's loop changes the motor's duty, of 255, for each tick that is missing."""


class WheelSpeed:
    """Makes whole ticks per loop of a wheel's speed, right in the mean.

    What is rounded off is said next time. A board that computes with whole numbers does not mend errors that are
    smaller than ko / kp ticks per loop, 2.5 with the gains that the firmware comes with: what is missing by what the
    encoders say is added.

    The board gives a wheel more and more power until it counts what it is told to. So a wheel that does not count, for
    its encoder is dead, would race; one that is held would race once it is let go; one that counts backwards does so
    at once. `fault` says that before.
    """

    def __init__(self, limits: WheelLimits) -> None:
        """It stands."""
        self._limits = limits
        self.stand()

    def stand(self) -> None:
        """Begin anew."""
        self._trim = self._rest = self._wanted = 0.0
        self._said = 0
        self.fault = ""
        """What is wrong with how it turns; until it stands."""
        self.watch_anew()

    def watch_anew(self) -> None:
        """What it did up to now says nothing of what it does."""
        self._glance = 0.0, 0.0
        """When a glance began, s, and how far it had turned then, ticks."""
        self._told = self._duty = self._vain = 0.0
        """Ticks that it was told to turn in this glance; what the board has given its motor since it last counted, of
        255, and for how long, s.
        """
        self._heard = -math.inf

    def ticks(self, wanted: float, measured: float) -> int:
        """What to say.

        Args:
            wanted: ticks per loop.
            measured: likewise.
        """
        limits = self._limits
        if wanted * self._wanted <= 0.0:
            turns_back = bool(wanted * self._wanted)
            self.stand()
            self._duty = -FULL_DUTY if turns_back else 0.0  # the board first takes back what it gives the other way
        steady, self._wanted = abs(wanted - self._wanted) < 0.5, wanted
        if is_stop(wanted):
            self.stand()
            return 0
        missing = wanted - measured
        if steady and abs(missing) <= limits.trim + 1.0:  # what is more is a wheel that gains speed, or is held
            step = missing * CORRECTION * limits.period
            self._trim = max(-limits.trim, min(self._trim + step, limits.trim))
        exact = max(-limits.fastest, min(wanted + self._trim, limits.fastest))
        exact = max(exact, 0.0) if wanted > 0.0 else min(exact, 0.0)
        self._said = round(exact + self._rest)
        self._rest = max(-1.0, min(exact + self._rest - self._said, 1.0))
        return self._said

    def hear(self, turned: float, time: float) -> None:
        """Take note of how far it has turned.

        Args:
            turned: in all, ticks.
            time: when that was, s.
        """
        elapsed, self._heard = time - self._heard, time
        if not 0.0 <= elapsed <= LONGEST_GAP:
            self._glance, self._told = (time, turned), 0.0
            return
        loops = elapsed / self._limits.loop_period
        self._told += self._said * loops
        self._duty += abs(int(self._said * self._limits.gain)) * loops  # whole numbers, as the board computes
        self._vain += elapsed
        if time - self._glance[0] < GLANCE:
            return
        way, told = turned - self._glance[1], self._told
        self._glance, self._told = (time, turned), 0.0
        if way * told >= LEAST * told * told:
            self._duty = self._vain = 0.0
        elif self._vain > PATIENCE and (self._duty > FULL_DUTY / 2 or self._vain > LONG):
            is_backwards = way * told <= -LEAST * told * told
            self.fault = BACKWARDS if is_backwards else SILENT


def is_stop(wanted: float) -> bool:
    """Whether a speed, ticks per loop, is one to stand: slower than the board can count it would start and stop."""
    return not abs(wanted) >= 0.5 or math.isinf(wanted)
