"""Random messages of any type by a seed: without hypothesis, of which ten thousand would take minutes."""

import math
import random
import struct
from typing import Any, TypeVar

from robo.interfaces.ros_shape import INTEGERS, Array, Field, Kind, Part, Single, shape_of
from robo_messages import Message
from tests.random_messages import is_bounded, rounded

M = TypeVar("M", bound=Message)
MOST = 4
"""Elements of a list."""
_LETTERS = "abz 0_ä€😀\n\t\"'"
_ODD_FLOATS = (0.0, -0.0, math.inf, -math.inf, math.nan, 1.0, -1.5, 5e-324, 1e-38)


class Values:
    """Makes messages."""

    def __init__(self, seed: object) -> None:
        self._rng = random.Random(str(seed))

    def message(self, type_: type[M]) -> M:
        """A message of a type; its fields may be of any type but those that ROS has no word for."""
        return type_(**{field.attribute: self._field(field) for field in shape_of(type_).fields})

    def as_written(self, message: M) -> M:
        """A message with what float32 leaves of its numbers of that width."""
        return rounded(message)

    def _field(self, field: Field) -> Any:
        if field.bridge is None or is_bounded(field.kind):
            return self._kind(field.kind)
        return self._rng.choice(
            (None, True, self._integer("int64"), self._float(64), self._text(9), [1, -2], ["a", ""])
        )

    def _kind(self, kind: Kind) -> Any:
        match kind:
            case Part(shape):
                return self.message(shape.type)
            case Array():
                return self._array(kind)
            case Single("string" | "wstring"):
                return self._text(9 if kind.most is None else min(9, kind.most))
            case Single("bool"):
                return self._rng.random() < 0.5
            case Single("float64" | "float32"):
                return self._float(int(kind.ros[5:]))
        least, most = kind.limits or INTEGERS[kind.ros]
        return self._rng.choice((least, most, self._rng.randint(least, most), min(max(0, least), most)))

    def _array(self, kind: Array) -> Any:
        most = MOST if kind.most is None else min(MOST, kind.most)
        length = kind.length if kind.length is not None else self._rng.randint(0, most)
        if kind.holds in ("bytes", "bytearray", "memoryview"):
            data = self._rng.randbytes(length)
            return memoryview(data) if kind.holds == "memoryview" else data
        values = [self._kind(kind.item) for _ in range(length)]
        return tuple(values) if kind.holds == "tuple" else values

    def _text(self, most: int) -> str:
        return "".join(self._rng.choices(_LETTERS, k=self._rng.randint(0, most)))

    def _integer(self, word: str) -> int:
        return self._rng.randint(*INTEGERS[word])

    def _float(self, width: int) -> float:
        if self._rng.random() < 0.3:
            return self._rng.choice(_ODD_FLOATS)
        if width == 32 and self._rng.random() < 0.5:
            (value,) = struct.unpack("<f", self._rng.randbytes(4))
            return float(value)
        if width == 32:
            return self._rng.uniform(-1e30, 1e30)
        (value,) = struct.unpack("<d", self._rng.randbytes(8))
        return float(value)
