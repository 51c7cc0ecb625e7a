"""How fields lie side by side in CDR, and the source of functions that are made for one type. Pure.

CDR is XCDR1, as ROS 2 writes it: four bytes that say so, then the fields in their order, each number at a multiple of
its size counted from behind those four. Fields of fixed size that follow each other are one `struct.Struct` with its
gaps as pad bytes. Behind a text or a list the gaps depend on how long that was: there is a Struct for each remainder.
"""

import array
import functools
import struct
import sys
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

from robo.interfaces.ros_shape import Array, Field, Kind, Part, Shape, Single

Order = Literal["<", ">"]
LITTLE, BIG = 0x0001, 0x0000
"""The first two bytes, the first one being the higher: the order of the bytes of all numbers."""
HEAD = 4
"""Bytes before the fields."""

CODES = {
    "bool": ("?", 1),
    "byte": ("B", 1),
    "char": ("B", 1),
    "int8": ("b", 1),
    "uint8": ("B", 1),
    "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4),
    "uint32": ("I", 4),
    "int64": ("q", 8),
    "uint64": ("Q", 8),
    "float32": ("f", 4),
    "float64": ("d", 8),
}
"""What `struct` calls ROS's numbers, and their bytes."""


class Slot(NamedTuple):
    """A place of fixed size: a number, several, or bytes."""

    code: str
    size: int
    """Of one; it stands at a multiple of it."""
    times: int = 1


COUNT = Slot("I", 4)
"""How many elements follow, or bytes of a text."""


def packed(slots: Sequence[Slot], at: int, order: Order = "<") -> tuple[struct.Struct, int]:
    """Slots side by side, and how many bytes they and the gaps before them take.

    Args:
        slots: in their order.
        at: where the first one may begin, in bytes behind the head.
        order: of the bytes of a number.
    """
    words: list[str] = [order]
    end = at
    for slot in slots:
        gap = -end % slot.size
        words += [f"{gap}x"] if gap else []
        words.append(slot.code if slot.times == 1 else f"{slot.times}{slot.code}")
        end += gap + slot.size * slot.times
    return _struct("".join(words)), end - at


_struct = functools.cache(struct.Struct)


@functools.lru_cache(256)
def row(code: str, gap: int, count: int, order: Order = "<") -> struct.Struct:
    """So many numbers behind a gap of so many bytes."""
    return struct.Struct(f"{order}{gap}x{count}{code}")


def are_native(slot: Slot, order: Order) -> bool:
    """Whether numbers lie in CDR as they lie in an `array` of this machine."""
    return order == ("<" if sys.byteorder == "little" else ">") and slot.code in _ARRAYS


_ARRAYS = {code for code, size in CODES.values() if code in array.typecodes and array.array(code).itemsize == size}


def numbers(data: bytes | memoryview, code: str) -> list[Any]:
    """The numbers of bytes in which they lie as in an `array`, which is a quarter quicker than `struct`."""
    found: array.array[Any] = array.array(code)
    found.frombytes(data)
    return found.tolist()


def alignment(slots: Sequence[Slot]) -> int:
    """The largest size of a number among slots, bytes."""
    return max((slot.size for slot in slots), default=1)


def number(kind: Kind) -> Slot | None:
    """The slot of a number or truth value; None for anything else."""
    return Slot(*CODES[kind.ros]) if isinstance(kind, Single) and kind.ros in CODES else None


def is_binary(kind: Array) -> bool:
    """Whether Python has bytes rather than a list."""
    return kind.holds in ("bytes", "bytearray", "memoryview")


def least_size(kind: Kind) -> int:
    """The fewest bytes that a value takes, gaps not counted; at least one."""
    if isinstance(kind, Part):
        return sum(least_size(field.kind) for field in kind.shape.fields) or 1
    if isinstance(kind, Array):
        return COUNT.size if kind.length is None else max(1, kind.length * least_size(kind.item))
    return CODES[kind.ros][1] if kind.ros in CODES else COUNT.size


def even_fields(shape: Shape, inside: str = "") -> list[tuple[Slot, str]] | None:
    """The numbers of a message and how one gets at each, where it has nothing else and all messages lie alike.

    A list of such messages is one gap, and then as many times the same bytes.

    Args:
        shape: of the message.
        inside: what stands before the names of its fields.
    """
    found = _numbers(shape, inside)
    slots = [slot for slot, _ in found or ()]
    if not found or slots[0].size != alignment(slots) or packed(slots, 0)[1] % alignment(slots):
        return None
    return found


def _numbers(shape: Shape, inside: str) -> list[tuple[Slot, str]] | None:
    found: list[tuple[Slot, str]] = []
    for field in shape.fields:
        inner = f"{inside}.{field.attribute}"
        if isinstance(field.kind, Part) and field.bridge is None:
            below = _numbers(field.kind.shape, inner)
            if not below:
                return None
            found += below
        elif (slot := _free_number(field)) is not None:
            found.append((slot, inner))
        else:
            return None
    return found


def _free_number(field: Field) -> Slot | None:
    """The slot of a number of which every value will do."""
    if field.bridge is not None or (isinstance(field.kind, Single) and field.kind.limits is not None):
        return None
    slot = number(field.kind)
    return slot if slot is not None and slot.code != "?" else None


class Source:
    """Lines of a function, and the objects that they name."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._depth = 2
        self._names = 0
        self.named: dict[str, object] = {}

    def say(self, line: str) -> None:
        """Add a line."""
        self._lines.append("    " * self._depth + line)

    def indent(self, by: int) -> None:
        """Write what follows deeper, or less deep."""
        self._depth += by

    def new(self, letter: str) -> str:
        """A name that nothing has yet."""
        self._names += 1
        return f"{letter}{self._names}"

    def const(self, value: object) -> str:
        """The name of an object."""
        for name, known in self.named.items():
            if known is value:
                return name
        name = self.new("C")
        self.named[name] = value
        return name

    def keep(self, expression: str) -> str:
        """The name of a local variable with what an expression gives."""
        name = self.new("v")
        self.say(f"{name} = {expression}")
        return name

    def refuse(self, condition: str) -> None:
        """Go no further where a condition holds: why, is found out by who looks at all of it once more."""
        self.say(f"if {condition}: raise ValueError")

    def function(self, argument: str, faults: tuple[type[Exception], ...], explain: Callable[..., Exception]) -> Any:
        """The function of one argument; one of these faults becomes the error that `explain(argument, fault)` gives."""
        named = {"FAULTS": faults, "explain": explain, **self.named}
        text = [f"def made({argument}):", "    try:", *self._lines, "    except FAULTS as fault:"]
        text.append(f"        raise explain({argument}, fault) from None")
        exec("\n".join(text), named)  # as dataclasses do: only a function made for the type is quick enough
        return named["made"]
