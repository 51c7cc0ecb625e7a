"""Making the function that reads messages of one type from CDR."""

import struct
from collections.abc import Callable, Sequence

import msgspec

from robo.interfaces import cdr_plan
from robo.interfaces.cdr_faults import decode_fault
from robo.interfaces.cdr_packed import from_bytes
from robo.interfaces.cdr_plan import BIG, COUNT, HEAD, LITTLE, Order, Slot, Source, alignment, number, packed
from robo.interfaces.cdr_wide import UNIT, text_of
from robo.interfaces.ros_shape import Array, Field, Kind, Part, Shape, Single
from robo_messages import Message

_FAULTS = (struct.error, IndexError, ValueError, TypeError, OverflowError, msgspec.MsgspecError)
Decoder = Callable[[bytes | memoryview], Message]


def make_decoder(shape: Shape) -> Decoder:
    """What reads messages of a type. Bulk fields (`memoryview`) point into what is read: no copy is made.

    Bytes of both orders are read, those of the higher byte first by a function that is made for the first of them.
    It raises MessageError for what is no message of the type; it names the field. What follows behind a message is
    left alone, as ROS does.
    """
    made: list[Decoder] = []

    def other(data: bytes | memoryview) -> Message:
        if bytes(data[:2]) != BIG.to_bytes(2, "big"):
            raise ValueError
        if not made:
            made.append(_made(shape, ">", None))
        return made[0](data)

    return _made(shape, "<", other)


def _made(shape: Shape, order: Order, other: Decoder | None) -> Decoder:
    reading = _Reading(order)
    source = reading.source
    source.say("if d.__class__ is not bytes: d = memoryview(d).cast('B')")
    source.say("z = len(d)")
    head = reading.place(COUNT)
    if other is not None:
        reading.afterwards(f"if {head} & 0xFFFF != {LITTLE << 8}: return {source.const(other)}(d)")
    message = reading.part(shape)
    reading.end(message)
    made: Decoder = source.function("d", _FAULTS, lambda data, fault: decode_fault(shape, data, fault))
    return made


class _Reading:
    """The lines of a decoder, while it goes through the fields. `d` is what is read, `z` its size."""

    def __init__(self, order: Order) -> None:
        self.source = Source()
        self._order: Order = order
        self._slots: list[Slot] = []
        self._names: list[str] = []
        self._afterwards: list[str] = []
        self._at: int | str = 0
        """Where the next byte stands, head included: a number as long as that is the same for all messages."""

    def place(self, slot: Slot) -> str:
        """The name of what has a fixed size and comes next."""
        name = self.source.new("v")
        self._slots.append(slot)
        self._names.append(name)
        return name

    def afterwards(self, line: str) -> None:
        """Say a line as soon as what has been placed is there."""
        self._afterwards.append(line)

    def part(self, shape: Shape) -> str:
        """A message: what makes it."""
        if not shape.fields:
            self.place(Slot("B", 1))
        values = [(field.attribute, self._field(field)) for field in shape.fields]
        in_order: Sequence[str] = shape.type.__match_args__
        given = [value if name in in_order else f"{name}={value}" for name, value in values]
        return f"{self.source.const(shape.type)}({', '.join(given)})"

    def _field(self, field: Field) -> str:
        value = self._kind(field.kind)
        if field.bridge is None:
            return value
        return f"{self.source.const(field.bridge.from_ros)}({value})"

    def _kind(self, kind: Kind) -> str:
        match kind:
            case Single():
                return self._single(kind)
            case Part():
                return self.part(kind.shape)
            case Array():
                return self._array(kind)

    def _single(self, kind: Single) -> str:
        slot = number(kind)
        if kind.ros == "wstring":
            return self._wide_text()
        if slot is None:
            return self._text()
        name = self.place(slot)
        if kind.limits is not None:
            self.afterwards(f"if not {kind.limits[0]} <= {name} <= {kind.limits[1]}: raise ValueError")
        return name

    def _text(self) -> str:
        """With its NUL, that must be the only one."""
        size = self.place(COUNT)
        begin = self._flush()
        end = self._then(f"{begin} + {size}")
        text = self.source.keep(f"str(d[{begin}:{end} - 1], 'utf-8')")
        # Where the length is 0, as some write that of an empty text, the byte before it is one of the length.
        self.source.refuse(f"d[{end} - 1] or '\\0' in {text}")
        return text

    def _wide_text(self) -> str:
        size = self.place(COUNT)
        begin = self._flush()
        end = self._then(f"{begin} + {UNIT} * {size}")
        self.source.refuse(f"{end} > z")
        return self.source.keep(f"{self.source.const(text_of)}(d[{begin}:{end}], {self._order!r})")

    def _array(self, kind: Array) -> str:
        slot = number(kind.item)
        if kind.length is not None:
            return self._fixed(kind, kind.length, slot)
        count = self.place(COUNT)
        begin = self._flush()
        if kind.most is not None:
            self.source.refuse(f"{count} > {kind.most}")
        if kind.holds == "packed" or (slot is not None and not cdr_plan.is_binary(kind)):
            assert slot is not None
            return self._numbers(kind, slot, begin, count)
        if cdr_plan.is_binary(kind):
            end = self._then(f"{begin} + {count}")
            self.source.refuse(f"{end} > z")
            return self._binary(kind, f"memoryview(d)[{begin}:{end}]")
        self.source.refuse(f"{count} * {cdr_plan.least_size(kind.item)} > z - {begin}")
        even = cdr_plan.even_fields(kind.item.shape) if isinstance(kind.item, Part) else None
        if even is not None and isinstance(kind.item, Part):
            values = self._even(kind.item.shape, [slot for slot, _ in even], begin, count)
        else:
            values = self._each(kind.item, count)
        return f"tuple({values})" if kind.holds == "tuple" else values

    def _fixed(self, kind: Array, length: int, slot: Slot | None) -> str:
        if cdr_plan.is_binary(kind):
            return self._binary(kind, self.place(Slot("s", 1, length)))
        if slot is not None:
            values = self.place(slot._replace(times=length))
            if length == 1:  # of one number its value is there, and no row
                return f"({values},)" if kind.holds == "tuple" else f"[{values}]"
            return values if kind.holds == "tuple" else f"list({values})"
        self._flush()
        values = self._each(kind.item, str(length))
        return f"tuple({values})" if kind.holds == "tuple" else values

    def _binary(self, kind: Array, data: str) -> str:
        if kind.holds == "memoryview" and kind.length is None:
            return data
        return f"{kind.holds}({data})"

    def _numbers(self, kind: Array, slot: Slot, begin: str, count: str) -> str:
        source = self.source
        gap, end = "0", source.new("o")
        if slot.size == 8:
            gap = source.keep(f"({begin} & 4 ^ 4) if {count} else 0")
            source.say(f"{end} = {begin} + {gap} + 8 * {count}")
        else:
            source.say(f"{end} = {begin} + {slot.size} * {count}")
        self._at = end
        source.refuse(f"{end} > z")
        if kind.holds == "packed":
            data = f"d[{begin} + {gap}:{end}]"
            return source.keep(f"{source.const(from_bytes)}({data}, {slot.code!r}, {self._order!r})")
        if kind.holds == "list" and cdr_plan.are_native(slot, self._order):
            return source.keep(f"{source.const(cdr_plan.numbers)}(d[{begin} + {gap}:{end}], {slot.code!r})")
        row = f"{source.const(cdr_plan.row)}({slot.code!r}, {gap}, {count}, {self._order!r})"
        values = f"{row}.unpack_from(d, {begin})"
        return source.keep(values if kind.holds == "tuple" else f"list({values})")

    def _even(self, shape: Shape, slots: list[Slot], begin: str, count: str) -> str:
        """Messages that are nothing but numbers and lie alike."""
        source = self.source
        one, size = packed(slots, 0, self._order)
        if slots[0].size == 8:
            begin = source.keep(f"{begin} + (({begin} & 4 ^ 4) if {count} else 0)")
        end = self._then(f"{begin} + {size} * {count}")
        source.refuse(f"{end} > z")
        inner = _Reading(self._order)
        inner.source = source
        each = inner.part(shape)
        names = ", ".join(inner._names)
        return source.keep(f"[{each} for {names}, in {source.const(one)}.iter_unpack(d[{begin}:{end}])]")

    def _each(self, item: Single | Part, count: str) -> str:
        """One after the other."""
        source = self.source
        values, at = source.keep("[]"), source.new("o")
        source.say(f"{at} = {self._at}")
        source.say(f"for _ in range({count}):")
        source.indent(1)
        self._at = at
        one = self._kind(item)
        end = self._flush()
        source.say(f"{values}.append({one})")
        source.say(f"{at} = {end}")
        source.indent(-1)
        self._at = at
        return values

    def _then(self, end: str) -> str:
        """What has been read ends there."""
        name = self.source.new("o")
        self.source.say(f"{name} = {end}")
        self._at = name
        return name

    def _flush(self) -> str:
        """Read what has been placed; where the next byte stands."""
        slots, at = self._slots, self._at
        if not slots:
            return str(at)
        if isinstance(at, int):
            one, size = packed(slots, at - HEAD, self._order)
            self._unpack(f"{self.source.const(one.unpack_from)}(d, {at})")
            self._at = at + size
        elif (most := alignment(slots)) == 1:
            one, size = packed(slots, 0, self._order)
            self._unpack(f"{self.source.const(one.unpack_from)}(d, {at})")
            self._then(f"{at} + {size}")
        elif slots[0].size == most:
            # From the first of them on they lie alike. The head is no multiple of eight: bytes count from behind it.
            one, size = packed(slots, 0, self._order)
            begin = self._then(f"({at} + 3 & -8) + {HEAD}" if most == 8 else f"{at} + {most - 1} & -{most}")
            self._unpack(f"{self.source.const(one.unpack_from)}(d, {begin})")
            self._then(f"{begin} + {size}")
        else:
            found = [packed(slots, start - HEAD, self._order) for start in range(most)]
            unpack, sizes = self.source.new("T"), self.source.new("T")
            self.source.named |= {unpack: tuple(one.unpack_from for one, _ in found)}
            self.source.named |= {sizes: tuple(size for _, size in found)}
            rest = self.source.keep(f"{at} & {most - 1}")
            self._unpack(f"{unpack}[{rest}](d, {at})")
            self._then(f"{at} + {sizes}[{rest}]")
        self._slots, self._names = [], []
        for line in self._afterwards:
            self.source.say(line)
        self._afterwards.clear()
        return str(self._at)

    def _unpack(self, values: str) -> None:
        """Give the values of all slots their names."""
        if all(slot.times == 1 or slot.code == "s" for slot in self._slots):
            self.source.say(f"{', '.join(self._names)}, = {values}")
            return
        row = self.source.keep(values)
        begin = 0
        alone: list[str] = []
        for name, slot in zip(self._names, self._slots, strict=True):
            if slot.times == 1 or slot.code == "s":
                alone.append(name)
                continue
            begin = self._name(alone, row, begin)
            self.source.say(f"{name} = {row}[{begin}:{begin + slot.times}]")
            begin += slot.times
        self._name(alone, row, begin)

    def _name(self, names: list[str], row: str, begin: int) -> int:
        """Give values of a row that stand side by side their names; where the next one stands."""
        end = begin + len(names)
        if names:
            self.source.say(f"{', '.join(names)}, = {row}[{begin}:{end}]")
            names.clear()
        return end

    def end(self, message: str) -> None:
        """Give back the message, where it is not cut short."""
        end = self._flush()
        self.source.refuse(f"{end} > z")
        self.source.say(f"return {message}")
