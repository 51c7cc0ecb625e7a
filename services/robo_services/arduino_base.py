"""Talks to a board that drives two wheels: what to say when, and what its answers mean.

    base = ArduinoBase(settings, odometry)
    base.begin(now)                       # a port was opened
    port.write(base.say(now, wheels))     # again at `base.due`
    base.feed(port.read(), now)           # may have moved `odometry`

Pure: no port, no clock; times are s of one monotonic clock. In each period it says speeds and asks for the encoders,
both at once, so that each period costs one way there and back; it does not wait for what is lost. A line that cannot be
read, and a reading that cannot be true, are asked for again at once.
"""

import math
from collections import deque

import msgspec

from robo_services import arduino_protocol as protocol
from robo_services.arduino_protocol import Done, Encoders, Invalid, Number, Reader, Unread
from robo_services.drives import Wheels
from robo_services.tick_odometry import TickOdometry
from robo_services.wheel_speed import WheelLimits, WheelSpeed, is_stop

KNOCK = 0.1
"""A board that is asked for the first time is asked again after this time, s; it may be just starting."""
REMEMBERED = 80
"""So many bytes of what it last said are told where it is no such board."""
UNASKED = 20
"""A board that has said so many readings more than it was asked for does not answer, it talks."""
UNASKED_AT_FIRST = 3
"""Likewise, one that is not known yet, where it has to be quiet."""
FORGETTING = 0.05
"""How much one line counts in the share of those that cannot be read."""
MOST_GARBAGE = 0.5
"""A wire that spoils more is none."""
PIN_PERIOD = 1.0
"""The battery is asked for once in this time, s."""
PIN_STEP = 50
"""A battery's pin that says a number that is further from the last one is believed when it has said so twice."""
GAINS_PERIOD = 1.0
"""While the wheels stand gains are said once in this time, s: nobody tells of a board that has forgotten them."""


class BoardError(Exception):
    """What is there is no use; says why."""

    def __init__(self, why: str, words: bytes = b"") -> None:
        """`words` are the last that it has said."""
        super().__init__(f"{why}; last it said {repr(words)[1:]}" if words else why)
        self.why = why


class NotABoard(BoardError):
    """It does not answer as such a board does."""


class BoardSilent(BoardError):
    """It has answered, and does so no more, or nobody can read it: it may be asked anew who it is."""


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """How the board works."""

    period: float = 1.0 / 30.0
    """Speeds are said and encoders asked for once in this time, s."""
    loop_period: float = 0.033
    """Of the board's own loop, s: what `m` sets is ticks in this time."""
    trim: float = 3.0
    """See `WheelLimits`."""
    gains: str = ""
    """Those of the loop, `kp:kd:ki:ko`; empty for those that it has."""
    battery_pin: int = -1
    """The analogue pin at which the battery is measured; -1 for none."""
    start_limit: float = 4.0
    """For so long a board may start, s."""
    silence_limit: float = 0.5
    """For so long it may say nothing that can be read, s."""


class Counts(msgspec.Struct):
    """What has happened so far."""

    readings: int = 0
    unread: int = 0
    """Lines that could not be read."""
    invalid: int = 0
    """Commands that the board says it could not read."""


class ArduinoBase:
    """One board, on whatever port it is."""

    def __init__(self, settings: Settings, odometry: TickOdometry) -> None:
        """`odometry` is moved on."""
        self.counts = Counts()
        self.unread: deque[bytes] = deque(maxlen=8)
        """Lines that could not be read, for a log; whoever tells of them takes them out."""
        self.resets: deque[str] = deque(maxlen=8)
        """Likewise: what is to be told of a board that has begun anew."""
        self.battery: int | None = None
        """What the battery's pin measured last, 0 to 1023."""
        self.is_known = False
        """Whether what is at the port has answered as such a board does."""
        self.due = math.inf
        """When it has something to say again."""
        self.measured = -math.inf
        """When the wheels were last heard of."""
        self._settings, self._odometry = settings, odometry
        kp, _, _, ko = map(int, (settings.gains or protocol.STOCK_GAINS).split(":"))
        limits = WheelLimits(
            period=settings.period,
            loop_period=settings.loop_period,
            trim=settings.trim,
            fastest=odometry.max_rate * settings.loop_period,
            gain=kp / max(ko, 1),
        )
        self._wheels = {"left": WheelSpeed(limits), "right": WheelSpeed(limits)}
        self.begin(-math.inf)

    @property
    def fault(self) -> str:
        """What is wrong with how a wheel turns: then both stand, until they are told to; empty if nothing is."""
        return "; ".join(f"the {side} wheel {wheel.fault}" for side, wheel in self._wheels.items() if wheel.fault)

    def begin(self, now: float, *, again: bool = False) -> None:
        """Nobody knows yet who is there: a port was opened, or `again` what was known on it has fallen silent."""
        self.is_known, self._was_known = False, again
        self.battery = None
        self.due = now
        self._reader = Reader()
        self._began, self._heard = now, now
        self._unasked = 0
        """Readings that nobody has asked for, less those that were asked for and have not come."""
        self._acquaintance = _Acquaintance()
        self._said = bytearray()
        self._garbage = 0.0
        """The share of lines that cannot be read, of the last ones."""
        self._pin_due = self._gains_due = -math.inf
        self._pin_awaited = 0
        """Within so many readings the pin's number comes; any other is what is left of a line."""
        self._pin_said: int | None = None
        self._asks_again = self._has_asked_again = False
        for wheel in self._wheels.values():
            wheel.stand()

    def say(self, now: float, wanted: Wheels) -> bytes:
        """What has to be said now; empty where nothing has.

        Args:
            now: s.
            wanted: rad/s.

        Raises:
            BoardError: what is there is no use.
        """
        self._doubt(now)
        if now < self.due:
            again, self._asks_again = self._asks_again and not self._has_asked_again, False
            self._has_asked_again |= again
            return self._ask() if again else b""
        s, self._asks_again, self._has_asked_again = self._settings, False, False
        if not self.is_known:
            self.due = now + KNOCK
            self._acquaintance.asks()
            return protocol.END_OF_GARBAGE + protocol.ASK_ENCODERS
        # Keeps its pace, so that it stays with the board's; after a pause it begins anew.
        self.due = self.due + s.period if now - self.due < s.period else now + s.period
        said = self._speeds(wanted)
        if s.gains and now >= self._gains_due and (said == protocol.STOP or self._gains_due == -math.inf):
            self._gains_due = now + GAINS_PERIOD
            said = protocol.gains(s.gains) + said
        if s.battery_pin >= 0 and now >= self._pin_due:
            self._pin_due, self._pin_awaited = now + PIN_PERIOD, 2  # a reading may be on its way
            said += protocol.ask_pin(s.battery_pin)
        return said + self._ask()

    def feed(self, data: bytes, now: float) -> bool:
        """Take what the board has said.

        Args:
            data: whatever has come.
            now: s.

        Returns:
            Whether the base has moved on: there is odometry to tell.
        """
        self._said = (self._said + data)[-REMEMBERED:]
        moved = False
        for one in self._reader.feed(data):
            match one:
                case Encoders():
                    moved = self._take(one, now) or moved
                case Number() if self._pin_awaited and 0 <= one.value <= 1023:
                    self._take_pin(one.value)
                case Done():
                    pass
                case Invalid():
                    self.counts.invalid += self.is_known  # before, it is asked with what is no command
                case Number():
                    self._cannot_read(str(one.value).encode())
                case Unread():
                    self._cannot_read(one.data)
        return moved

    def _take(self, reading: Encoders, now: float) -> bool:
        self.counts.readings += 1
        self._pin_awaited = max(self._pin_awaited - 1, 0)
        self._garbage *= 1.0 - FORGETTING
        if not self.is_known:
            self.is_known = self._acquaintance.hears(reading, now, self._odometry)
            self.due = max(self._acquaintance.quiet_until, now)
            if not self.is_known:
                return False
            self._heard = now
        self._unasked = min(self._unasked + 1, UNASKED + 1)
        verdict = self._odometry.take(reading, now)
        if verdict == "asks":
            self._asks_again = True
            return False
        if verdict == "reset":
            self._gains_due = -math.inf
            self.resets.append(f"counts from {reading.left} {reading.right}")
        is_sound = verdict == "moves" and not self.fault
        for wheel, turned in zip(self._wheels.values(), self._odometry.turned[:2], strict=True):
            if is_sound:
                wheel.hear(turned * self._odometry.per_radian, now)
            else:
                wheel.watch_anew()
        self._heard = self.measured = now
        return True

    def _take_pin(self, value: int) -> None:
        before, self._pin_said, self._pin_awaited = self._pin_said, value, 0
        if before is not None and abs(value - before) <= PIN_STEP:
            self.battery = value

    def _cannot_read(self, data: bytes) -> None:
        self._garbage += (1.0 - self._garbage) * FORGETTING
        self._acquaintance.cannot_read()
        if self.is_known:  # before, it may be in the middle of a line
            self._asks_again = True
            self.counts.unread += 1
            self.unread.append(data)

    def _ask(self) -> bytes:
        self._unasked = max(self._unasked - 1, -UNASKED)  # of what was lost long ago nobody waits for an answer
        return protocol.ASK_ENCODERS

    def _speeds(self, wanted: Wheels) -> bytes:
        """The command for both wheels."""
        per_rate = self._odometry.per_radian * self._settings.loop_period
        ticks = [rate * per_rate for rate in wanted[:2]]
        if self.fault and not all(map(is_stop, ticks)):
            return protocol.STOP
        rates = self._odometry.rates[:2]
        wheels = zip(self._wheels.values(), ticks, rates, strict=True)
        return protocol.speeds(*(wheel.ticks(want, rate * per_rate) for wheel, want, rate in wheels))

    def _doubt(self, now: float) -> None:
        """Give up what does not answer.

        Raises:
            BoardError: it is no use.
        """
        s, said = self._settings, bytes(self._said)
        if self._unasked > UNASKED or self._acquaintance.unasked >= UNASKED_AT_FIRST:
            raise NotABoard("it says numbers that nobody asked for", said)
        if self.is_known:
            if self._garbage > MOST_GARBAGE:
                raise BoardSilent("most of what it says cannot be read", said)
            if now - self._heard > s.silence_limit:
                raise BoardSilent(f"no answer for {s.silence_limit:g} s", said)
            return
        if now - self._began <= s.start_limit:
            return
        if self._was_known:
            raise BoardError(f"it has not answered for {s.start_limit:g} s", said)
        if b"Invalid Command" in said:
            raise NotABoard("it has the firmware, but knows no encoders: build it with USE_BASE", said)
        if not said:
            raise NotABoard("it says nothing; is the firmware on it, and is baud right?")
        raise NotABoard("it does not answer as a board does, or has another baud", said)


class _Acquaintance:
    """Finds out whether who is there answers, or only talks: a board says one line to one question, and none unasked.

    Whoever has said a reading has to be quiet for a while in which nobody asks. Then two questions in a row have to be
    answered before the next one, by one reading each that go together: who says numbers as seldom as not to be heard in
    the quiet says them too seldom for that.
    """

    def __init__(self) -> None:
        self.quiet_until = -math.inf
        """When it is to be asked again, s."""
        self.unasked = 0
        """Readings that it has said where it had to be quiet."""
        self._heard_first = math.inf
        self._answers = 0
        self._first: Encoders | None = None

    def asks(self) -> None:
        """It is asked."""
        if self._answers != 1:
            self._first = None
        self._answers = 0

    def cannot_read(self) -> None:
        """It has said what is no answer."""
        self._first = None

    def hears(self, reading: Encoders, now: float, odometry: TickOdometry) -> bool:
        """Whether it is known now to be a board, s."""
        if now < self.quiet_until:
            if now - self._heard_first > KNOCK / 2:  # before, it may still answer what it was asked while it started
                self.unasked += 1
                self._be_quiet(now)
            return False
        if self._heard_first == math.inf:
            self._be_quiet(now)
            return False
        self._answers += 1
        first, self._first = self._first, reading
        return self._answers == 1 and first is not None and odometry.is_near(first, reading, KNOCK)

    def _be_quiet(self, now: float) -> None:
        self._heard_first, self.quiet_until = now, now + 2 * KNOCK
