"""Making the function that writes messages of one type as CDR."""

import struct
from collections.abc import Callable
from typing import Any

import msgspec

from robo.interfaces import cdr_plan
from robo.interfaces.cdr_faults import encode_fault
from robo.interfaces.cdr_packed import little_endian
from robo.interfaces.cdr_plan import COUNT, LITTLE, Slot, Source, alignment, number, packed
from robo.interfaces.cdr_wide import UNIT, units_of
from robo.interfaces.ros_shape import Array, Field, Kind, Part, Shape, Single
from robo_messages import Message

_FAULTS = (struct.error, ValueError, TypeError, AttributeError, OverflowError, msgspec.MsgspecError)


def make_encoder(shape: Shape) -> Callable[[Message], bytes]:
    """What writes messages of a type.

    It raises MessageError for one that does not fit into CDR; it names the field.
    """
    writing = _Writing()
    writing.place(COUNT, str(LITTLE << 8))
    writing.part(shape, "m")
    writing.end()
    made: Callable[[Message], bytes] = writing.source.function(
        "m", _FAULTS, lambda message, fault: encode_fault(shape, message, fault)
    )
    return made


class _Writing:
    """The lines of an encoder, while it goes through the fields.

    `o` in them is where the next byte stands, counted behind the head; `a` takes the next bytes.
    """

    def __init__(self) -> None:
        self.source = Source()
        self._slots: list[Slot] = []
        self._values: list[str] = []
        self._at: int | None = -cdr_plan.HEAD
        """Where the next byte stands, as long as that is the same for all messages."""
        self._later = ""
        """The line that brings `o` up to date, which is said only if anybody asks for it."""
        self._begun = False

    def place(self, slot: Slot, value: str) -> None:
        """Something of fixed size comes next."""
        self._slots.append(slot)
        if value:
            self._values.append(value)

    def part(self, shape: Shape, message: str) -> None:
        """The fields of a message."""
        if not shape.fields:
            self.place(Slot("B", 1), "0")
        if len(shape.fields) > 1 and "." in message:
            message = self.source.keep(message)
        for field in shape.fields:
            self._field(field, f"{message}.{field.attribute}")

    def _field(self, field: Field, value: str) -> None:
        if field.bridge is not None:
            value = self.source.keep(f"{self.source.const(field.bridge.to_ros)}({value})")
        self._kind(field.kind, value)

    def _kind(self, kind: Kind, value: str) -> None:
        match kind:
            case Single():
                self._single(kind, value)
            case Part():
                self.part(kind.shape, value)
            case Array():
                self._array(kind, value)

    def _single(self, kind: Single, value: str) -> None:
        source = self.source
        slot = number(kind)
        if kind.ros == "wstring":
            units = source.keep(f"{source.const(units_of)}({value})")
            self.place(COUNT, f"len({units}) // {UNIT}")
            self._bytes(units, f"len({units})")
            return
        if slot is None:
            text = source.keep(f"{value}.encode()")
            source.refuse(f"0 in {text}")
            self.place(COUNT, f"len({text}) + 1")
            self._bytes(text, f"len({text})")
            self.place(Slot("x", 1), "")
            return
        if slot.code == "?" or kind.limits is not None:
            value = source.keep(value)
        if slot.code == "?":
            source.refuse(f"{value}.__class__ is not bool")
        if kind.limits is not None:
            source.refuse(f"not {kind.limits[0]} <= {value} <= {kind.limits[1]}")
        self.place(slot, value)

    def _array(self, kind: Array, value: str) -> None:
        if kind.holds == "packed":
            self._packed(kind, value)
        elif cdr_plan.is_binary(kind):
            self._binary(kind, value)
        else:
            self._row(kind, self.source.keep(value))

    def _packed(self, kind: Array, value: str) -> None:
        """Floats that are still as they travel."""
        slot = number(kind.item)
        assert slot is not None
        data = self.source.keep(f"{self.source.const(little_endian)}({value}, {slot.code!r})")
        self.place(COUNT, f"len({data}) // {slot.size}")
        self._flush()
        self._gap_before(slot, f"if {data}:")
        self._bytes(data, f"len({data})")

    def _binary(self, kind: Array, value: str) -> None:
        view = self.source.keep(f"memoryview({value})")
        size = f"{view}.nbytes"
        if kind.length is not None:
            self.source.refuse(f"{size} != {kind.length}")
            self.place(Slot("s", 1, kind.length), f"bytes({view})")
            return
        self._at_most(kind, size)
        self.place(COUNT, size)
        self._bytes(view, size)

    def _at_most(self, kind: Array, count: str) -> None:
        if kind.most is not None:
            self.source.refuse(f"{count} > {kind.most}")

    def _row(self, kind: Array, values: str) -> None:
        """A list or a tuple."""
        source = self.source
        slot = number(kind.item)
        if slot is not None and slot.code == "?":
            source.refuse(f"not set(map(type, {values})) <= {{bool}}")
        if kind.length is not None:
            source.refuse(f"len({values}) != {kind.length}")
            if slot is not None:
                self.place(slot._replace(times=kind.length), f"*{values}")
            else:
                self._each(kind.item, values)
            return
        count = source.keep(f"len({values})")
        self._at_most(kind, count)
        self.place(COUNT, count)
        even = cdr_plan.even_fields(kind.item.shape, "i") if isinstance(kind.item, Part) else None
        if slot is not None:
            self._numbers(slot, values, count)
        elif even is not None:
            self._even(even, values, count)
        else:
            self._each(kind.item, values)

    def _numbers(self, slot: Slot, values: str, count: str) -> None:
        self._flush()
        row = self.source.const(cdr_plan.row)
        if slot.size < 8:  # behind its count it has no gap
            self.source.say(f"a({row}({slot.code!r}, 0, {count}).pack(*{values}))")
            self._longer(f"{slot.size} * {count}")
            return
        self._up_to_date()
        self.source.say(f"if {count}:")
        self.source.indent(1)
        self.source.say(f"a({row}({slot.code!r}, o & 4, {count}).pack(*{values}))")
        self.source.say(f"o += (o & 4) + {slot.size} * {count}")
        self.source.indent(-1)

    def _even(self, fields: list[tuple[Slot, str]], values: str, count: str) -> None:
        """Messages that are nothing but numbers and lie alike."""
        self._flush()
        slots = [slot for slot, _ in fields]
        one, size = packed(slots, 0)
        self._gap_before(slots[0], f"if {count}:")
        each = f"{self.source.const(one.pack)}({', '.join(value for _, value in fields)})"
        self.source.say(f"a(b''.join([{each} for i in {values}]))")
        self._longer(f"{size} * {count}")

    def _gap_before(self, slot: Slot, where: str) -> None:
        """The gap between a count and its first element."""
        if slot.size < 8:
            return
        self._up_to_date()
        self.source.say(where)
        self.source.indent(1)
        self.source.say("if o & 4:")
        self.source.say("    a(b'\\0\\0\\0\\0'); o += 4")
        self.source.indent(-1)

    def _each(self, item: Single | Part, values: str) -> None:
        """One after the other."""
        self._flush()
        self._up_to_date()
        one = self.source.new("i")
        self.source.say(f"for {one} in {values}:")
        self.source.indent(1)
        self._kind(item, one)
        self._flush()
        self._up_to_date()
        self.source.indent(-1)

    def _bytes(self, data: str, size: str) -> None:
        """Bytes as they are."""
        self._flush()
        self.source.say(f"a({data})")
        self._longer(size)

    def _flush(self) -> None:
        """Write what has been placed."""
        if not self._slots:
            return
        source, slots = self.source, self._slots
        values = ", ".join(self._values)
        if not self._begun:
            source.say("p = []; a = p.append")
            self._begun = True
        if self._at is not None:
            one, size = packed(slots, self._at)
            source.say(f"a({source.const(one.pack)}({values}))")
            self._at += size
        elif (most := alignment(slots)) == 1:
            one, size = packed(slots, 0)
            source.say(f"a({source.const(one.pack)}({values}))")
            self._longer(str(size))
        else:
            self._up_to_date()
            found = [packed(slots, at) for at in range(most)]
            at = source.new("k")
            source.say(f"{at} = o & {most - 1}")
            source.say(f"a({self._table([one.pack for one, _ in found])}[{at}]({values}))")
            self._longer(f"{self._table([size for _, size in found])}[{at}]")
        self._slots, self._values = [], []

    def _table(self, values: list[Any]) -> str:
        name = self.source.new("T")
        self.source.named[name] = tuple(values)
        return name

    def _longer(self, size: str) -> None:
        """So many bytes have been written."""
        if self._at is not None:
            self._later = f"o = {self._at} + {size}"
            self._at = None
        else:
            self._later = f"{self._later or 'o +='}{' + ' if self._later else ' '}{size}"

    def _up_to_date(self) -> None:
        """From here on `o` is right."""
        if self._at is not None:
            self.source.say(f"o = {self._at}")
            self._at = None
        elif self._later:
            self.source.say(self._later)
        self._later = ""

    def end(self) -> None:
        """Give back the bytes."""
        if not self._begun:
            one, _ = packed(self._slots, -cdr_plan.HEAD)
            self.source.say(f"return {self.source.const(one.pack)}({', '.join(self._values)})")
            return
        self._flush()
        self.source.say("return b''.join(p)")
