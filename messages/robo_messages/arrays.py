"""Messages as numpy arrays, and back: what `Image.array`, `PointCloud2.array` and their like do.

Bulk fields are looked at where they lie, and nothing is copied; so an array of a received message is
read-only and keeps the whole payload alive. This module needs numpy, the rest of the package does not.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import msgspec

try:
    import numpy as np
except ModuleNotFoundError as error:
    if error.name != "numpy":
        raise
    raise ModuleNotFoundError(
        "messages as arrays need numpy, which is not installed: pip install 'robo-zenoh[numpy]'", name="numpy"
    ) from None

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from robo_messages.std import Header


class _Grid(Protocol):
    """What pictures and clouds have in common."""

    header: Header

    @property
    def height(self) -> int: ...
    @property
    def width(self) -> int: ...
    @property
    def data(self) -> memoryview: ...


class _Picture(_Grid, Protocol):
    """What of an `Image` matters here."""

    @property
    def encoding(self) -> str: ...
    @property
    def is_bigendian(self) -> int: ...
    @property
    def step(self) -> int: ...


class _Field(Protocol):
    """What of a `PointField` matters here."""

    @property
    def name(self) -> str: ...
    @property
    def offset(self) -> int: ...
    @property
    def datatype(self) -> int: ...
    @property
    def count(self) -> int: ...


class _Cloud(_Grid, Protocol):
    """What of a `PointCloud2` matters here."""

    @property
    def fields(self) -> Sequence[_Field]: ...
    @property
    def is_bigendian(self) -> bool: ...
    @property
    def point_step(self) -> int: ...
    @property
    def row_step(self) -> int: ...


P = TypeVar("P", bound=_Picture)
C = TypeVar("C", bound=_Cloud)

_NAMED = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
_PIXEL = re.compile(r"(?P<name>mono|rgba?|bgra?|bayer_(?:rggb|bggr|gbrg|grbg))(?P<bits>8|16)")
_OPENCV = re.compile(r"(?P<bits>8|16|32|64)(?P<kind>[USF])C(?P<channels>[1-9]\d{0,2})?")
_YUV = {"yuv422", "yuv422_yuy2", "uyvy", "yuyv"}
"""Two bytes a pixel: its brightness, and in turn one of the two colours."""

_KINDS = {"U": "u", "S": "i", "F": "f"}

_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""PointField.INT8 … FLOAT64."""
_DATATYPE_OF = {kind: number for number, kind in _DATATYPES.items()}


def pixel_layout(encoding: str) -> tuple[np.dtype[Any], int]:
    """The type of an encoding's values, and how many a pixel has: `rgb8` is (uint8, 3).

    Raises:
        ValueError: the pixels of this encoding are no values side by side, or nobody knows it.
    """
    if (found := _PIXEL.fullmatch(encoding)) is not None:
        return np.dtype(f"u{int(found['bits']) // 8}"), _NAMED.get(found["name"], 1)
    if (found := _OPENCV.fullmatch(encoding)) is not None and f"{found['kind']}{found['bits']}" not in _NO_NUMBERS:
        return np.dtype(f"{_KINDS[found['kind']]}{int(found['bits']) // 8}"), int(found["channels"] or 1)
    if encoding in _YUV:
        return np.dtype("u1"), 2
    raise ValueError(
        f"encoding {encoding!r}: an array can be made of mono8, rgb8, bgr8, rgba8, bgra8 (and …16), bayer_…, yuv422, "
        "and OpenCV's such as 16UC1 and 32FC3; read `data` where it is another"
    )


_NO_NUMBERS = {"F8", "U64", "S64"}
"""OpenCV has no such types."""


def image_array(image: _Picture) -> NDArray[Any]:
    """As `Image.array`."""
    kind, channels = pixel_layout(image.encoding)
    kind = kind.newbyteorder(">" if image.is_bigendian else "<")
    pixel = kind.itemsize * channels
    if image.step < image.width * pixel:
        row = f"a row of {image.width} pixels {image.encoding} takes {image.width * pixel} bytes"
        raise ValueError(f"Image.step is {image.step}: {row}")
    _check_size("Image", f"{image.height} rows of {image.step} bytes", image.height * image.step, image.data)
    shape: tuple[int, ...] = (image.height, image.width)
    strides: tuple[int, ...] = (image.step, pixel)
    if channels > 1:
        shape, strides = (*shape, channels), (*strides, kind.itemsize)
    return np.ndarray(shape, kind, image.data, strides=strides)


def image_from(type_: Callable[..., P], array: NDArray[Any], encoding: str, header: Header | None) -> P:
    """As `Image.from_array`."""
    kind, channels = pixel_layout(encoding)
    if (
        array.dtype.newbyteorder("=") != kind
        or array.ndim != (2 if channels == 1 else 3)
        or array.shape[2:] != (() if channels == 1 else (channels,))
    ):
        wanted = "(height, width)" if channels == 1 else f"(height, width, {channels})"
        raise ValueError(f"{encoding} takes an array {wanted} of {kind}, not {array.shape} of {array.dtype}")
    height, width = array.shape[:2]
    image = type_(
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=int(_is_bigendian(array.dtype)),
        step=width * channels * kind.itemsize,
        data=bytes_of(array),
    )
    if header is not None:
        image.header = header
    return image


def cloud_array(cloud: _Cloud) -> NDArray[Any]:
    """As `PointCloud2.array`."""
    order = ">" if cloud.is_bigendian else "<"
    fields = [field for field in cloud.fields if field.name]  # one without a name fills up space
    for field in fields:
        if field.datatype not in _DATATYPES:
            raise ValueError(f"PointCloud2.fields: {field.name} has datatype {field.datatype}; it is 1 to 8")
    try:
        kind = np.dtype(
            {
                "names": [field.name for field in fields],
                "formats": [
                    (order + _DATATYPES[field.datatype], (field.count,) if field.count > 1 else ()) for field in fields
                ],
                "offsets": [field.offset for field in fields],
                "itemsize": cloud.point_step,
            }
        )
    except ValueError as error:
        raise ValueError(f"PointCloud2.fields and a point_step of {cloud.point_step} bytes: {error}") from None
    if cloud.row_step < cloud.width * cloud.point_step:
        row = f"{cloud.width} points take {cloud.width * cloud.point_step} bytes"
        raise ValueError(f"PointCloud2.row_step is {cloud.row_step}: {row}")
    _check_size(
        "PointCloud2", f"{cloud.height} rows of {cloud.row_step} bytes", cloud.height * cloud.row_step, cloud.data
    )
    points = np.ndarray((cloud.height, cloud.width), kind, cloud.data, strides=(cloud.row_step, cloud.point_step))
    return points[0] if cloud.height == 1 else points


def cloud_from(
    type_: Callable[..., C],
    field: Callable[..., _Field],
    array: NDArray[Any],
    header: Header | None,
    is_dense: bool | None,
) -> C:
    """As `PointCloud2.from_array`; `field` makes a `PointField`."""
    if array.dtype.names is None:
        array = _as_points(array)
    if array.ndim not in (1, 2):
        raise ValueError(f"a cloud takes an array (points,) or (rows, points), not {array.shape}")
    fields, orders = [], set()
    for name in array.dtype.names or ():
        assert array.dtype.fields is not None
        inner, offset = array.dtype.fields[name][:2]
        value, shape = inner.subdtype or (inner, ())
        datatype = _DATATYPE_OF.get(f"{value.kind}{value.itemsize}")
        if datatype is None or len(shape) > 1:
            raise ValueError(f"a PointField holds 8 to 32 bit integers and floats, and {name} is {inner}")
        if value.itemsize > 1:
            orders.add(_is_bigendian(value))
        fields.append(field(name=name, offset=offset, datatype=datatype, count=shape[0] if shape else 1))
    if len(orders) > 1:
        raise ValueError("the fields of a cloud have one byte order; this array's have both")
    width, height = array.shape[-1], array.shape[0] if array.ndim == 2 else 1
    cloud = type_(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=orders == {True},
        point_step=array.dtype.itemsize,
        row_step=width * array.dtype.itemsize,
        data=bytes_of(array),
        is_dense=_is_finite(array) if is_dense is None else is_dense,
    )
    if header is not None:
        cloud.header = header
    return cloud


def grid_array(height: int, width: int, data: memoryview) -> NDArray[np.int8]:
    """As `OccupancyGrid.array`."""
    _check_size("OccupancyGrid", f"{height} x {width} cells", height * width, data)
    return np.ndarray((height, width), np.int8, data)


def cells_of(array: ArrayLike) -> NDArray[np.int8]:
    """The cells of a grid as int8.

    Raises:
        ValueError: it is no array (height, width) of integers, or one of them is no signed byte.
    """
    cells = np.asarray(array)
    if cells.ndim != 2 or cells.dtype.kind not in "iu":
        raise ValueError(f"a grid takes an array (height, width) of integers, not {cells.shape} of {cells.dtype}")
    if cells.dtype != np.int8 and cells.size and not (cells.min() >= -128 and cells.max() <= 127):
        raise ValueError(f"a cell of a grid is -128 to 127, and these are {cells.min()} to {cells.max()}")
    return cells.astype(np.int8, copy=False)


def bytes_of(array: NDArray[Any]) -> memoryview:
    """An array's bytes in the order of its rows; a view of them where they lie so, else a copy."""
    return memoryview(np.ascontiguousarray(array).data if array.size else b"").cast("B")


def _as_points(array: NDArray[Any]) -> NDArray[Any]:
    if array.ndim not in (2, 3) or array.shape[-1] != 3 or array.dtype.kind != "f":
        raise ValueError(
            "a cloud takes a structured array, or one (points, 3) or (rows, points, 3) of floats as x, y and z, "
            f"not {array.shape} of {array.dtype}"
        )
    array = np.ascontiguousarray(array)
    return array.view(np.dtype([(axis, array.dtype) for axis in "xyz"]))[..., 0]


def _is_finite(array: NDArray[Any]) -> bool:
    kinds = {name: array.dtype[name].base.kind for name in array.dtype.names or ()}
    return all(bool(np.isfinite(array[name]).all()) for name, kind in kinds.items() if kind == "f")


def _is_bigendian(kind: np.dtype[Any]) -> bool:
    return kind.byteorder == ">" or (kind.byteorder == "=" and sys.byteorder == "big")


def _check_size(what: str, wanted: str, size: int, data: memoryview) -> None:
    if (found := memoryview(data).nbytes) < size:
        raise ValueError(f"{what}.data has {found} bytes, and {wanted} are {size}")


# MessagePack writes each number of an array as one byte that says its kind, and its value, the highest byte first.
_FLOAT32, _FLOAT64 = 0xCA, 0xCB
_TAGGED = {
    _FLOAT32: np.dtype([("tag", "u1"), ("value", ">f4")]),
    _FLOAT64: np.dtype([("tag", "u1"), ("value", ">f8")]),
}


_numbers = msgspec.msgpack.Decoder(list[float])


def uniform_floats(packed: msgspec.Raw) -> msgspec.Raw:
    """An array of numbers in MessagePack, or in JSON, as `floats_of` takes it: all float32, or all float64.

    Raises:
        ValueError: it is no array of numbers.
    """
    data = bytes(packed)
    if data[0] == 0x5B:  # "[", so it is JSON: in MessagePack this byte is a number
        return packed_floats(msgspec.json.decode(packed, type=list[float], strict=False))
    count, start = _count_of(data)
    if not count:
        return packed
    tag = data[start]
    size = _TAGGED[tag].itemsize if tag in _TAGGED else 0
    # Bytes are compared, for numpy takes ten times as long where its code is not in the processor's cache.
    if len(data) == start + count * size and data[start::size] == bytes([tag]) * count:
        return packed
    try:  # integers among them, as other writers shorten 1.0 to 1
        return packed_floats(np.array(_numbers.decode(packed), np.float64))
    except msgspec.ValidationError as error:
        raise ValueError(f"expected an array of numbers: {error}") from None


def floats_of(packed: msgspec.Raw) -> NDArray[np.float32] | NDArray[np.float64]:
    """An array of numbers as `uniform_floats` makes it, as numpy's, without a Python object for each.

    Of float32 where they travel so, else of float64.
    """
    data = memoryview(packed)
    count, start = _count_of(data)
    if not count:
        return np.empty(0)
    kind = _TAGGED[data[start]]
    values = np.ndarray(count, kind["value"], data, start + 1, (kind.itemsize,))
    return values.astype(np.float32) if data[start] == _FLOAT32 else values.astype(np.float64)


def _count_of(data: memoryview | bytes) -> tuple[int, int]:
    """How many elements an array has, and where the first one begins."""
    head = data[0]
    if head & 0xF0 == 0x90:
        return head & 0x0F, 1
    if head in (0xDC, 0xDD):
        start = 3 if head == 0xDC else 5
        return int.from_bytes(data[1:start], "big"), start
    raise ValueError("expected an array of numbers")


def packed_floats(values: ArrayLike) -> msgspec.Raw:
    """Numbers as an array in MessagePack: float32 stays so, everything else is float64.

    Raises:
        ValueError: they have more than one dimension.
    """
    numbers = np.asarray(values)
    if numbers.ndim != 1:
        raise ValueError(f"expected one row of numbers, got {numbers.shape}")
    tag = _FLOAT32 if numbers.dtype == np.float32 else _FLOAT64
    items = np.empty(len(numbers), _TAGGED[tag])
    items["tag"] = tag
    items["value"] = numbers
    return msgspec.Raw(_array_head(len(numbers)) + items.tobytes())


def _array_head(count: int) -> bytes:
    if count < 16:
        return bytes([0x90 | count])
    return b"\xdc" + count.to_bytes(2, "big") if count < 2**16 else b"\xdd" + count.to_bytes(4, "big")
