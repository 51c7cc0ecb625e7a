"""The words of a board that drives two wheels: commands out, bytes in to answers.

They are those of ros_arduino_bridge, the firmware of many Arduino bases (hbrobotics, joshnewans; written anew in many
others): a letter, up to two numbers, a carriage return. Each command has one line in answer, in their order:

    m L R            OK       speeds of the wheels, ticks per turn of the board's loop
    o L R            OK       duty of the motors, -255 to 255, without the loop; not in the oldest firmware
    e                L R      how far the wheels have turned since the board was started, ticks
    r                OK       from here on they count from 0
    u kp:kd:ki:ko    OK       gains of the loop
    a PIN            N        what a pin measures, 0 to 1023
    b                N        bits per second

Anything else is answered with "Invalid Command". Lines have no checksum: whether a number can be true, whoever knows
the wheels has to say. Pure: no port, no clock.
"""

import re
from typing import Final, NamedTuple

LONGEST: Final = 64
"""A line of more bytes is none of a board's."""

BYTES_PER_PERIOD: Final = 32
"""A period's speeds, encoders and pin take no more, each way."""

STOCK_GAINS: Final = "20:12:0:50"
"""kp, kd, ki, ko, as the firmware comes."""

ASK_ENCODERS: Final = b"e\r"
ASK_BAUD: Final = b"b\r"
RESET_ENCODERS: Final = b"r\r"
STOP: Final = b"m 0 0\r"
END_OF_GARBAGE: Final = b"\r"
"""Ends what a board may have half understood: it keeps letters until their end comes, in memory that it does not
measure.
"""

MOST_TICKS: Final = 32_767
"""Per loop: an int of a small board."""
_COUNT_BITS = 32
_NUMBER = rb"0|-?[1-9][0-9]{0,9}"  # as a board prints it: no sign before 0, no 0 before others
_ENCODERS = re.compile(rb"(%b) (%b)" % (_NUMBER, _NUMBER))
_ONE = re.compile(_NUMBER)


class Encoders(NamedTuple):
    """How far the wheels have turned since the board was started, ticks."""

    left: int
    right: int


class Number(NamedTuple):
    """An answer that is one number."""

    value: int


class Done(NamedTuple):
    """A command was carried out."""


class Invalid(NamedTuple):
    """The board does not know a command."""


class Unread(NamedTuple):
    """A line that is none of a board's."""

    data: bytes
    """Its first `LONGEST` bytes."""


Answer = Encoders | Number | Done | Invalid | Unread


class Reader:
    """Makes answers of bytes, in whatever pieces they come; keeps no more than one line."""

    def __init__(self) -> None:
        self._line = bytearray()
        self._is_too_long = False

    def feed(self, data: bytes) -> list[Answer]:
        """The answers that end in these bytes."""
        found: list[Answer] = []
        for part in re.split(rb"([\r\n])", data):
            if part in (b"\r", b"\n"):
                if self._line and not self._is_too_long:
                    found.append(answer(bytes(self._line)))
                self._line.clear()
                self._is_too_long = False
            elif not self._is_too_long:
                self._line += part[: LONGEST + 1]
                if len(self._line) > LONGEST:  # said once; what follows of it is nothing
                    found.append(Unread(bytes(self._line[:LONGEST])))
                    self._is_too_long = True
                    self._line.clear()
        return found


def answer(line: bytes) -> Answer:
    """What a line says, without its end."""
    if line == b"OK":
        return Done()
    if line == b"Invalid Command":
        return Invalid()
    if (two := _ENCODERS.fullmatch(line)) is not None:
        left, right = int(two[1]), int(two[2])
        return Encoders(left, right) if _is_count(left) and _is_count(right) else Unread(line)
    if _ONE.fullmatch(line) is not None and _is_count(int(line)):
        return Number(int(line))
    return Unread(line)


def speeds(left: int, right: int) -> bytes:
    """Set both speeds, ticks per turn of the loop."""
    return b"m %d %d\r" % (_held(left), _held(right))


def duty(left: int, right: int) -> bytes:
    """Set the motors' duty, -255 to 255."""
    return b"o %d %d\r" % (max(-255, min(left, 255)), max(-255, min(right, 255)))


def gains(text: str) -> bytes:
    """Set the gains, `kp:kd:ki:ko`; `ko` divides the sum of the others."""
    return b"u %b\r" % text.encode("ascii")


def ask_pin(pin: int) -> bytes:
    """What an analogue pin measures."""
    return b"a %d\r" % pin


def _held(value: int) -> int:
    return max(-MOST_TICKS, min(value, MOST_TICKS))


def _is_count(value: int) -> bool:
    return -(1 << (_COUNT_BITS - 1)) <= value < 1 << (_COUNT_BITS - 1)
