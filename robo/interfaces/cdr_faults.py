"""Why a message cannot be written as CDR, or bytes are no message: which field, and what is wrong with it. Pure.

Encoders and decoders go through a message as fast as they can and notice only that something is wrong. What this does
is slow, and done after that: it goes through the fields one by one until it comes to the one at fault.
"""

import operator
import struct
from collections.abc import Callable
from typing import Any

from robo.errors import MessageError
from robo.interfaces import cdr_packed, cdr_plan
from robo.interfaces.cdr_plan import BIG, CODES, COUNT, HEAD, LITTLE, Slot, is_binary, least_size, number
from robo.interfaces.cdr_wide import UNIT, text_of
from robo.interfaces.ros_shape import INTEGERS, TEXTS, Array, Field, Kind, Part, Shape, Single
from robo.text.brief import shown


def encode_fault(shape: Shape, message: object, fault: Exception) -> MessageError:
    """Why a message cannot be written.

    Args:
        shape: of its type.
        message: what was to be written.
        fault: what came of it.
    """
    try:
        _check(Part(shape), message, shape.name)
    except MessageError as error:
        return error
    return MessageError(f"{shape.name}: {str(fault) or 'it does not fit into CDR'}")


def _check(kind: Kind, value: Any, where: str) -> None:
    match kind:
        case Single():
            _check_single(kind, value, where)
        case Array():
            _check_array(kind, value, where)
        case Part(shape):
            for field in shape.fields:
                if not hasattr(value, field.attribute):
                    raise MessageError(f"{where}: expected {shape.name}, got {_value_text(value)}")
                inner = getattr(value, field.attribute)
                _check(field.kind, _told(field, inner, f"{where}.{field.name}"), f"{where}.{field.name}")


def _told(field: Field, value: Any, where: str) -> Any:
    """What ROS is told of a field's value."""
    return value if field.bridge is None else _bridged(field.bridge.to_ros, value, where)


def _bridged(crossing: Callable[[Any], Any], value: Any, where: str) -> Any:
    try:
        return crossing(value)
    except (ValueError, TypeError, OverflowError) as error:
        raise MessageError(f"{where}: {error}") from None


def _check_single(kind: Single, value: Any, where: str) -> None:
    if kind.ros in TEXTS:
        _check_text(kind, value, where)
    elif kind.ros == "bool":
        if not isinstance(value, bool):
            raise MessageError(f"{where}: expected true or false, got {_value_text(value)}")
    elif kind.ros in INTEGERS:
        _check_integer(kind, value, where)
    else:
        _check_float(kind, value, where)


def _check_text(kind: Single, value: Any, where: str) -> None:
    if not isinstance(value, str):
        raise MessageError(f"{where}: expected a text, got {_value_text(value)}")
    if "\0" in value and kind.ros == "string":
        raise MessageError(f"{where}: a text in CDR ends at its first NUL, and {shown(value, 40)} has one within")
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise MessageError(f"{where}: {shown(value, 40)} is no Unicode text: {error.reason}") from None


def _check_integer(kind: Single, value: Any, where: str) -> None:
    least, most = kind.limits or INTEGERS[kind.ros]
    try:
        whole = operator.index(value)
    except TypeError:
        raise MessageError(f"{where}: expected int from {least} to {most}, got {_value_text(value)}") from None
    if not least <= whole <= most:
        raise MessageError(f"{where}: expected int from {least} to {most}, got {_value_text(value)}")


def _check_float(kind: Single, value: Any, where: str) -> None:
    try:
        struct.pack(f"<{CODES[kind.ros][0]}", value if isinstance(value, str) else float(value))
    except OverflowError:
        raise MessageError(f"{where}: {_value_text(value)} is beyond {kind.ros}") from None
    except (struct.error, TypeError, ValueError):
        raise MessageError(f"{where}: expected a number, got {_value_text(value)}") from None


def _check_array(kind: Array, value: Any, where: str) -> None:
    if kind.holds == "packed":
        slot = number(kind.item)
        assert slot is not None
        _bridged(lambda packed: cdr_packed.little_endian(packed, slot.code), value, where)
        return
    if is_binary(kind):
        try:
            view = memoryview(value)
        except TypeError:
            raise MessageError(f"{where}: expected bytes, got {_value_text(value)}") from None
        if not view.c_contiguous:
            raise MessageError(f"{where}: its bytes do not lie side by side; copy them first, with bytes(…)")
        _check_count(kind, view.nbytes, where)
        return
    try:
        count, items = len(value), iter(value)
    except TypeError:
        raise MessageError(f"{where}: expected a list, got {_value_text(value)}") from None
    _check_count(kind, count, where)
    for i, item in enumerate(items):
        _check(kind.item, item, f"{where}[{i}]")


def _check_count(kind: Array, count: int, where: str) -> None:
    if kind.length is not None and count != kind.length:
        raise MessageError(f"{where}: expected {kind.length} elements, got {count}")
    if kind.most is not None and count > kind.most:
        raise MessageError(f"{where}: expected at most {kind.most} elements, got {count}")


def decode_fault(shape: Shape, data: Any, fault: Exception) -> MessageError:
    """Why bytes are no message.

    Args:
        shape: of the type that they should be.
        data: the bytes.
        fault: what came of it.
    """
    view = memoryview(data).cast("B")
    head = int.from_bytes(view[:2], "big")
    if len(view) < HEAD:
        return MessageError(f"{shape.name}: no CDR: {len(view)} bytes, and its head alone has {HEAD}")
    if head not in (LITTLE, BIG):
        return MessageError(f"{shape.name}: no CDR as ROS writes it: it begins with {bytes(view[:2]).hex(' ')}")
    try:
        _Reader(view, "<" if head == LITTLE else ">").value(Part(shape), shape.name)
    except MessageError as error:
        return error
    return MessageError(f"{shape.name}: {str(fault) or 'it is no message of this type'}")


class _Reader:
    """Reads one value after the other."""

    def __init__(self, data: memoryview, order: cdr_plan.Order) -> None:
        self._data = data
        self._order = order
        self._at = HEAD

    def value(self, kind: Kind, where: str) -> Any:
        match kind:
            case Single("string"):
                return self._text(where)
            case Single("wstring"):
                return self._wide_text(where)
            case Single():
                return self._number(kind, where)
            case Array():
                return self._array(kind, where)
            case Part(shape):
                return self._part(shape, where)

    def _part(self, shape: Shape, where: str) -> Any:
        values: dict[str, Any] = {}
        for field in shape.fields:
            inner = f"{where}.{field.name}"
            value = self.value(field.kind, inner)
            values[field.attribute] = value if field.bridge is None else _bridged(field.bridge.from_ros, value, inner)
        if not shape.fields:
            self._take(1, where)
        return _bridged(lambda given: shape.type(**given), values, where)

    def _take(self, size: int, where: str) -> memoryview:
        left = len(self._data) - self._at
        if size > left:
            raise MessageError(f"{where}: cut short: {size} bytes are wanted, and {max(left, 0)} are left")
        self._at += size
        return self._data[self._at - size : self._at]

    def _slot(self, slot: Slot, where: str) -> Any:
        self._at += -(self._at - HEAD) % slot.size
        (value,) = struct.unpack(self._order + slot.code, self._take(slot.size, where))
        return value

    def _number(self, kind: Single, where: str) -> Any:
        value = self._slot(Slot(*CODES[kind.ros]), where)
        if kind.limits is not None and not kind.limits[0] <= value <= kind.limits[1]:
            raise MessageError(f"{where}: expected int from {kind.limits[0]} to {kind.limits[1]}, got {value}")
        return value

    def _text(self, where: str) -> str:
        size = self._slot(COUNT, where)
        data = bytes(self._take(size, where))
        try:
            text = data.decode()
        except UnicodeDecodeError as error:
            raise MessageError(f"{where}: no UTF-8: {error.reason} at byte {error.start} of {size}") from None
        if text.find("\0") != len(text) - 1:
            raise MessageError(f"{where}: a text ends with NUL and has none within, unlike {shown(text, 40)}")
        return text[:-1]

    def _wide_text(self, where: str) -> str:
        units = self._take(self._slot(COUNT, where) * UNIT, where)
        try:
            return text_of(units, self._order)
        except UnicodeDecodeError as error:
            raise MessageError(f"{where}: no UTF-16: {error.reason}") from None
        except ValueError as error:
            raise MessageError(f"{where}: {error}") from None

    def _array(self, kind: Array, where: str) -> Any:
        count = kind.length
        if count is None:
            count = self._slot(COUNT, where)
            _check_count(kind, count, where)
        if is_binary(kind) or kind.holds == "packed":
            return self._bulk(kind, count, where)
        left = len(self._data) - self._at
        if count * least_size(kind.item) > left:
            raise MessageError(f"{where}: {count} elements do not fit into the {max(left, 0)} bytes that are left")
        values = [self.value(kind.item, f"{where}[{i}]") for i in range(count)]
        return tuple(values) if kind.holds == "tuple" else values

    def _bulk(self, kind: Array, count: int, where: str) -> Any:
        slot = number(kind.item)
        assert slot is not None
        if count:
            self._at += -(self._at - HEAD) % slot.size
        data = self._take(count * slot.size, where)
        if kind.holds == "packed":
            return cdr_packed.from_bytes(data, slot.code, self._order)
        return bytes(data) if kind.holds == "bytes" else bytearray(data) if kind.holds == "bytearray" else data


def _value_text(value: object) -> str:
    return f"{type(value).__name__} {shown(value, 40)}"
