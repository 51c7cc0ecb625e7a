"""What keys say to a robot: from the bytes of a terminal to a velocity, without Zenoh and without a clock.

A terminal tells that a key goes down, and while it is held, that again and again; that it is let go it never tells. The
first repetition comes late, after 0.25 to 0.7 s, the others follow each other by some 30 ms. So there are two dead-man
times: a key that has just gone down counts as held until its first repetition has to be there, and one that repeats
until the next one has to be. Whatever is not understood is a stop.
"""

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

from robo_messages import Twist, Vector3

ESCAPE, UNKNOWN = "escape", "unknown"
_CONTROL_D = "\x04"

_LONGEST_SEQUENCE = 32
"""Bytes of an escape sequence; no key sends a longer one."""

_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
"""By the last character of their escape sequences (ECMA-48 CUU, CUD, CUF, CUB; xterm's, with a modifier or without)."""


class Motion(NamedTuple):
    """Where a key drives to; each is -1, 0 or 1."""

    x: int
    """Forward."""
    y: int
    """To the left."""
    turn: int
    """To the left."""


MOTIONS: Mapping[str, Motion] = {
    **dict.fromkeys(("w", "up", "i"), Motion(1, 0, 0)),
    **dict.fromkeys(("s", "down", ","), Motion(-1, 0, 0)),
    **dict.fromkeys(("a", "left", "j"), Motion(0, 0, 1)),
    **dict.fromkeys(("d", "right", "l"), Motion(0, 0, -1)),
    "u": Motion(1, 0, 1),
    "o": Motion(1, 0, -1),
    # The tail swings to the side of the key.
    "m": Motion(-1, 0, -1),
    ".": Motion(-1, 0, 1),
    "I": Motion(1, 0, 0),
    "<": Motion(-1, 0, 0),
    "J": Motion(0, 1, 0),
    "L": Motion(0, -1, 0),
    "U": Motion(1, 1, 0),
    "O": Motion(1, -1, 0),
    "M": Motion(-1, 1, 0),
    ">": Motion(-1, -1, 0),
}
"""What drives, and where to. The letters around k, and those with shift, are those of ROS's teleop_twist_keyboard."""

FASTER, SLOWER = 1.1, 0.9

SPEEDS: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys(("+", "="), (FASTER, FASTER)),
    **dict.fromkeys(("-", "_"), (SLOWER, SLOWER)),
    "r": (FASTER, 1.0),
    "f": (SLOWER, 1.0),
    "t": (1.0, FASTER),
    "g": (1.0, SLOWER),
}
"""By how much a key multiplies the speed, and the speed of turning."""

ENDS = frozenset({"q", "Q", _CONTROL_D})
"""What ends it, beside Ctrl-C, which the terminal makes a signal of."""

SLOWEST = 0.01
"""No key makes it slower than this, m/s or rad/s: 0 times anything stays 0."""


class Kind(Enum):
    """What a key is for."""

    DRIVE = 1
    SPEED = 2
    STOP = 3
    END = 4


def kind_of(key: str) -> Kind:
    """What a key is for. One that is for nothing else stops: whoever is startled hits any."""
    if key in MOTIONS:
        return Kind.DRIVE
    if key in SPEEDS:
        return Kind.SPEED
    return Kind.END if key in ENDS else Kind.STOP


class Decoder:
    """Makes keys of the bytes that a terminal sends, however they are cut into pieces."""

    def __init__(self) -> None:
        self._rest = b""

    @property
    def pending(self) -> bool:
        """Whether an escape sequence has begun, or somebody has hit Escape."""
        return bool(self._rest)

    def feed(self, data: bytes) -> list[str]:
        """The keys that are complete: a character, `up`, `down`, `left`, `right`, ESCAPE or UNKNOWN."""
        rest, keys = self._rest + data, []
        while rest:
            key, length = _first_key(rest)
            if not length:
                break
            keys.append(key)
            rest = rest[length:]
        self._rest = rest
        return keys

    def flush(self) -> list[str]:
        """What is left is all that comes: the key Escape, or a sequence that has no end."""
        rest, self._rest = self._rest, b""
        return [ESCAPE if rest == b"\x1b" else UNKNOWN] if rest else []


def _first_key(data: bytes) -> tuple[str, int]:
    """The key that bytes begin with, and how many they are; 0 where more have to come."""
    if data[0] != 0x1B:
        return (chr(data[0]) if data[0] < 0x7F else UNKNOWN), 1
    if len(data) == 1:
        return "", 0
    if data[1] == 0x1B:
        return ESCAPE, 1
    if data[1:2] == b"O":  # an arrow of a terminal in application mode
        return (_ARROWS.get(chr(data[2]), UNKNOWN), 3) if len(data) > 2 else ("", 0)
    if data[1:2] != b"[":  # a key with Alt
        return UNKNOWN, 2
    for length, byte in enumerate(data[2:], start=3):
        if 0x40 <= byte <= 0x7E:
            return _ARROWS.get(chr(byte), UNKNOWN), length
        if not 0x20 <= byte <= 0x3F:  # it breaks off; what has broken it may be a key
            return UNKNOWN, length - 1
        if length >= _LONGEST_SEQUENCE:
            return UNKNOWN, length
    return "", 0


class Timing(NamedTuple):
    """How long a key counts as held after it was heard, s."""

    first: float
    """When it has just gone down."""
    repeated: float
    """When it repeats."""


class Speeds(NamedTuple):
    """How fast keys drive."""

    linear: float
    """m/s."""
    angular: float
    """rad/s."""


class Held(NamedTuple):
    """A key that counts as held."""

    key: str
    """One of MOTIONS."""
    heard: float
    """When it was heard last, s."""
    repeats: bool = False
    """Whether it was heard again while it was held."""

    def until(self, timing: Timing) -> float:
        """When it counts as let go unless it is heard again, s."""
        return self.heard + (timing.repeated if self.repeats else timing.first)

    def lasts(self, now: float, timing: Timing) -> bool:
        """Whether it still counts as held."""
        return self.heard <= now < self.until(timing)


def pressed(held: Held | None, key: str, now: float, timing: Timing) -> Held | None:
    """What counts as held once a key was heard: the last one that drives, for terminals tell of one at a time."""
    match kind_of(key):
        case Kind.DRIVE:
            return Held(key, now, held is not None and held.key == key and held.lasts(now, timing))
        case Kind.SPEED:
            return held
        case _:
            return None


def twist_of(motion: Motion, speeds: Speeds) -> Twist:
    """The velocity of a motion."""
    return Twist(Vector3(motion.x * speeds.linear, motion.y * speeds.linear), Vector3(z=motion.turn * speeds.angular))


def adjusted(value: float, factor: float, limit: float) -> float:
    """A speed once a key has multiplied it: at most `limit`, and not so slow that it could not grow again."""
    if factor == 1.0:
        return value
    wanted = value * factor
    if wanted < SLOWEST:
        wanted = min(value, SLOWEST) if factor < 1.0 else SLOWEST
    return min(wanted, limit)


class Said(NamedTuple):
    """What is commanded."""

    twist: Twist
    age: float
    """How long ago whoever drives has said so, s."""


class Operator:
    """Whoever sits at the keys, as far as they tell: what he commands, and when he commands nothing any more.

    All times are of one clock that never steps back, s.
    """

    def __init__(self) -> None:
        self.held: Held | None = None
        """The key that counts as held."""
        self.silent = True
        """Whether he has nothing to say: he has said that the robot is to stand, or nothing at all so far."""

    def take(self, key: str, now: float, timing: Timing) -> None:
        """Hear a key. One that stops is said once more to a robot that stands: somebody else may drive it."""
        self.held = pressed(self.held, key, now, timing)
        if kind_of(key) is Kind.STOP:
            self.silent = False

    def let_go(self) -> None:
        """Take all keys as let go."""
        self.held = None

    def say(self, now: float, timing: Timing, speeds: Speeds) -> Said | None:
        """What is to be said now: a velocity while a key is held, one 0 after it, then nothing.

        A key that repeats has been said when it was heard last. One that has just gone down counts as held all the
        time until its first repetition is due, and so as said now.
        """
        if self.held is not None and self.held.lasts(now, timing):
            self.silent = False
            age = now - self.held.heard if self.held.repeats else 0.0
            return Said(twist_of(MOTIONS[self.held.key], speeds), age)
        self.held = None
        if self.silent:
            return None
        self.silent = True
        return Said(Twist(), 0.0)
