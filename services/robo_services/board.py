"""A board that drives two wheels, played: its words, its loop, its motors and encoders, its own watchdog.

It computes as ros_arduino_bridge's firmware does, in whole numbers that are cut towards 0, every 33 ms (1000 / 30 in
whole ms). Pure: stepped from outside, the same for the same seed.
"""

import math
from typing import Final

import msgspec

from robo_services.arduino_protocol import STOCK_GAINS, Encoders
from robo_services.drives import DiffDrive, Wheels
from robo_services.kinematics import ORIGIN, Pose2, Twist2, advance

MAX_PWM: Final = 255
BAUD: Final = 57_600
BRAKING: Final = 0.02
"""A motor whose ends are joined, which is how drivers stop it, loses its speed within about this time, s."""
STICKING: Final = 0.3
"""A wheel that is not driven and slower than this sticks, rad/s."""
_FINEST: Final = 0.005
"""Steps of the true path, s."""
_LONGEST_WORD: Final = 15


class BoardSpec(msgspec.Struct, frozen=True, kw_only=True):
    """What it is like."""

    drive: DiffDrive = DiffDrive(wheel_separation=0.3, wheel_radius=0.05, max_wheel_velocity=20.0)
    """The true wheels; at full duty they turn at `max_wheel_velocity`."""
    per_revolution: float = 1440.0
    """Ticks."""
    bits: int = 32
    """Of a counter."""
    loop_period: float = 0.033
    """s."""
    watchdog: float = 0.2
    """Without a command for this long the motors stop, s."""
    inertia: float = 0.1
    """A motor has 63 % of its speed after this time, s."""
    friction: float = 12.0
    """With a duty of no more than this a wheel does not turn, of 255."""
    noise: float = 0.0
    """By so much of its speed, as a standard deviation, a wheel's load changes what a duty does."""
    starting: float = 0.0
    """It says nothing for this long after a reset, s."""


class Board:
    """Words in, words out, wheels turning."""

    def __init__(self, spec: BoardSpec, seed: int = 0) -> None:
        """`seed` of its noise."""
        self.spec = spec
        self.pose: Pose2 = ORIGIN
        """Where it truly is."""
        self.way = 0.0
        """How far it has truly driven, m."""
        self.time = 0.0
        """Its own, s since it was made; it does not pass while whoever plays it is held up."""
        self.commanded = -math.inf
        """When it was told a speed last, in its own time, s."""
        self.stood = 0.0
        """Since when it stands, likewise; inf while a wheel turns."""
        self._left, self._right = _Motor(spec), _Motor(spec)
        self._dice = _Dice(seed)
        self._out = bytearray()
        self.reset()

    @property
    def wheels(self) -> Wheels:
        """How far they have truly turned since it was made, rad."""
        return Wheels(self._left.turned, self._right.turned)

    @property
    def rates(self) -> Wheels:
        """How fast they turn, rad/s."""
        return Wheels(self._left.rate, self._right.rate)

    @property
    def twist(self) -> Twist2:
        """How it moves, m/s and rad/s."""
        return self.spec.drive.twist(self.rates)

    @property
    def encoders(self) -> Encoders:
        """What its counters say."""
        return Encoders(self._left.count(), self._right.count())

    def turn_by_hand(self, left: float, right: float) -> None:
        """Turn its wheels while it is lifted, rad."""
        for motor, way in ((self._left, left), (self._right, right)):
            motor.roll(way)

    def fail_encoder(self, side: str) -> None:
        """Let the encoder of a side, `left` or `right`, count no more; any other word mends both."""
        self._left.is_counted, self._right.is_counted = side != "left", side != "right"

    def reset(self) -> None:
        """Begin anew, as when its button is pressed; wheels coast on."""
        self._gains = _gains(STOCK_GAINS)
        self._out.clear()
        self._line = _Line()
        self._next_loop = self.time + self.spec.loop_period
        self._deaf_until = self.time + self.spec.starting
        self._is_moving = False
        self.commanded = -math.inf
        for motor in (self._left, self._right):
            motor.begin_anew()

    def receive(self, data: bytes) -> None:
        """Take what comes over the wire."""
        if self.time < self._deaf_until:
            return
        for byte in data:
            if byte == 13:
                self._obey(self._line)
                self._line = _Line()
            else:
                self._line.take(byte)

    def said(self) -> bytes:
        """What it has said since the last time."""
        data = bytes(self._out)
        self._out.clear()
        return data

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        end = self.time + max(seconds, 0.0)
        while self.time < end:
            step = min(end, self._next_loop, self.time + _FINEST) - self.time
            self._roll(step)
            self.time += step
            if self.time - self.commanded > self.spec.watchdog:
                self._is_moving = False
                self._left.pwm = self._right.pwm = 0
            if self.time >= self._next_loop - 1e-9:
                self._next_loop = self.time + self.spec.loop_period
                if self.time >= self._deaf_until:
                    self._loop()

    def _roll(self, step: float) -> None:
        before = self.wheels
        for motor in (self._left, self._right):
            motor.turn(step, 1.0 + self.spec.noise * self._dice.normal() if self.spec.noise else 1.0)
        after = self.wheels
        way, turn = self.spec.drive.twist(Wheels(after.left - before.left, after.right - before.right))
        self.pose = advance(self.pose, way, turn, 1.0)
        self.way += abs(way)
        if self._left.rate or self._right.rate:
            self.stood = math.inf
        elif self.stood == math.inf:
            self.stood = self.time + step

    def _loop(self) -> None:
        if not self._is_moving:
            for motor in (self._left, self._right):
                if motor.seen:
                    motor.begin_loop()
            return
        for motor in (self._right, self._left):
            motor.loop(*self._gains)

    def _obey(self, line: "_Line") -> None:
        one, two = _atoi(line.words[0]), _atoi(line.words[1])
        answer = "OK"
        match line.command:
            case "e":
                answer = f"{self._left.count()} {self._right.count()}"
            case "m":
                self.commanded, self._is_moving = self.time, bool(one or two)
                if not self._is_moving:
                    for motor in (self._left, self._right):
                        motor.pwm = 0
                        motor.begin_loop()
                self._left.target, self._right.target = one, two
            case "o":
                self.commanded, self._is_moving = self.time, False
                for motor, duty in ((self._left, one), (self._right, two)):
                    motor.begin_loop()
                    motor.pwm = max(-MAX_PWM, min(duty, MAX_PWM))
            case "r":
                for motor in (self._left, self._right):
                    motor.zero()
            case "u":
                gains = _gains(line.words[0])
                self._gains = gains + self._gains[len(gains) :]
            case "a":
                answer = "791"
            case "b":
                answer = str(BAUD)
            case _:
                answer = "Invalid Command"
        self._out += f"{answer}\r\n".encode()


class _Motor:
    """A motor with its wheel, its encoder and its half of the loop."""

    def __init__(self, spec: BoardSpec) -> None:
        self.turned = 0.0
        self.rate = 0.0
        self.is_counted = True
        """Whether its encoder works."""
        self._seen_turning = 0.0
        """How far it has turned by its encoder, rad."""
        self._spec = spec
        self._zero = 0
        self.begin_anew()

    def begin_anew(self) -> None:
        """As after a reset."""
        self.pwm = 0
        self.zero()
        self.begin_loop()

    def begin_loop(self) -> None:
        """The loop's memory is empty."""
        self.target = self.output = self.seen = self.integral = 0
        self.counted = self._ticks()

    def zero(self) -> None:
        """Count from 0."""
        self._zero += self._ticks()
        self.begin_loop()

    def count(self) -> int:
        """What its counter says; it wraps around."""
        half = 1 << (self._spec.bits - 1)
        return (self._ticks() + half) % (2 * half) - half

    def turn(self, seconds: float, load: float) -> None:
        """Turn on for a while with the present duty; its speed nears what belongs to that as e^(-t / inertia)."""
        driven = abs(self.pwm) > self._spec.friction
        inertia = self._spec.inertia if driven else BRAKING
        share = max(abs(self.pwm) - self._spec.friction, 0.0) / (MAX_PWM - self._spec.friction)
        aim = math.copysign(self._spec.drive.max_wheel_velocity * share * load, self.pwm)
        fading = math.exp(-seconds / inertia)
        self.roll(aim * seconds + (self.rate - aim) * inertia * (1.0 - fading))
        self.rate = aim + (self.rate - aim) * fading
        if not driven and abs(self.rate) < STICKING:
            self.rate = 0.0

    def roll(self, way: float) -> None:
        """Turn by so much, rad."""
        self.turned += way
        self._seen_turning += way if self.is_counted else 0.0

    def loop(self, kp: int, kd: int, ki: int, ko: int) -> None:
        """One turn of the firmware's loop: the duty changes by what is missing."""
        counted = self._ticks()
        came = counted - self.counted
        missing = self.target - came
        change = _cut(kp * missing - kd * (came - self.seen) + self.integral, ko)
        output = change + self.output
        if -MAX_PWM < output < MAX_PWM:
            self.integral += ki * missing
        self.output = self.pwm = max(-MAX_PWM, min(output, MAX_PWM))
        self.counted, self.seen = counted, came

    def _ticks(self) -> int:
        return math.floor(self._seen_turning * self._spec.per_revolution / math.tau) - self._zero


class _Line:
    """A command while it comes: a letter and two words."""

    def __init__(self) -> None:
        self.command = ""
        self.words = ["", ""]
        self._place = 0

    def take(self, byte: int) -> None:
        if byte == 32:
            self._place = min(self._place + 1, 2)
        elif self._place == 0:
            self.command = chr(byte)
        elif len(self.words[self._place - 1]) < _LONGEST_WORD:  # the firmware does not look
            self.words[self._place - 1] += chr(byte)


class _Dice:
    """Normal numbers; a small generator of its own, for `random` brings along 4 MB."""

    def __init__(self, seed: int) -> None:
        self._state = (seed * 2 + 1) & 0xFFFFFFFFFFFFFFFF

    def uniform(self) -> float:
        """In (0, 1); the upper half of a linear congruential generator (Knuth, TAOCP vol. 2, §3.3.4)."""
        self._state = (self._state * 6364136223846793005 + 1442695040888963407) & 0xFFFFFFFFFFFFFFFF
        return ((self._state >> 32) + 0.5) / 2**32

    def normal(self) -> float:
        """Of mean 0 and deviation 1 (Box, Muller 1958)."""
        return math.sqrt(-2.0 * math.log(self.uniform())) * math.cos(math.tau * self.uniform())


class Wire:
    """What a bad wire does to lines: letters that are others, ends that are missing."""

    def __init__(self, *, garbled: float = 0.0, cut: float = 0.0, seed: int = 0) -> None:
        """Shares of lines, 0 to 1."""
        self.garbled, self.cut = garbled, cut
        self.spoiled = 0
        """Lines that did not come as they were said."""
        self._dice = _Dice(seed)

    def passes(self, data: bytes) -> bytes:
        """What comes of whole lines."""
        return b"".join(self._line(line) for line in data.splitlines(keepends=True))

    def _line(self, line: bytes) -> bytes:
        chance = self._dice.uniform()
        if chance >= self.garbled + self.cut:
            return line
        self.spoiled += 1
        place = int(self._dice.uniform() * len(line))
        if chance < self.garbled:
            return line[:place] + bytes([int(self._dice.uniform() * 256)]) + line[place + 1 :]
        return line[:place]


def _atoi(text: str) -> int:
    """As C has it: the number at the beginning, or 0."""
    digits, sign = text.lstrip(), 1
    if digits[:1] in ("-", "+"):
        sign, digits = (-1 if digits[0] == "-" else 1), digits[1:]
    value = 0
    for letter in digits:
        if letter not in "0123456789":
            break
        value = value * 10 + int(letter)
    return (sign * value + 32_768) % 65_536 - 32_768  # an int of a small board


def _gains(text: str) -> tuple[int, ...]:
    """As many as there are, up to four."""
    return tuple(_atoi(part) for part in text.split(":") if part)[:4]


def _cut(value: int, by: int) -> int:
    """Divided as C does, towards 0; a board that divides by 0 does not stop for it."""
    return int(value / by) if by else 0
