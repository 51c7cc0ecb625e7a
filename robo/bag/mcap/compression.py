"""Chunks, compressed and restored: zstd and lz4, from the extra `record`.

What comes out is never larger than what the chunk says of itself, and that never larger than `MOST`: a small file that
would unfold to more than the machine's memory is refused before it does.
"""

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Literal, get_args

from robo.bag.mcap.format import Malformed
from robo.errors import BagError
from robo.text.brief import shown

if TYPE_CHECKING or sys.version_info < (3, 14):
    _ZSTD: Final = "backports.zstd"
else:
    _ZSTD: Final = "compression.zstd"

Compression = Literal["zstd", "none"]
"""What robo writes."""
COMPRESSIONS: tuple[Compression, ...] = get_args(Compression)

MOST: Final = 2**28
"""Of a chunk, restored, bytes: 268 MB."""

QUICK: Final = 1
"""A level of zstd for a robot that has other things to do: numbers come out as small as by `SMALL`, and sooner."""
SMALL: Final = 3
"""A level of zstd for who can wait: five times slower with noisy pictures, which `QUICK` leaves as they are."""

Compress = Callable[[bytes], bytes]


class CannotRestore(Exception):
    """A chunk is compressed in a way that cannot be read here; the text says what to do."""


def compressor(compression: Compression, level: int = QUICK) -> tuple[str, Compress | None]:
    """What MCAP calls a compression, and what compresses; None where nothing is to be done.

    Args:
        compression: which.
        level: of zstd.

    Raises:
        BagError: its library is not installed; names the extra.
    """
    if compression == "none":
        return "", None
    zstd = _module(_ZSTD)
    if zstd is None:
        raise BagError(
            "recording with zstd needs a library that is not installed: pip install 'robo-zenoh[record]'; "
            "compression none needs it not"
        )
    return "zstd", lambda data: bytes(zstd.compress(data, level))


def best_compression() -> Compression:
    """What this machine has."""
    try:
        compressor("zstd")
    except BagError:
        return "none"
    return "zstd"


def restored(compression: str, data: memoryview, size: int) -> bytes | memoryview:
    """What a chunk's data were before they were compressed.

    Args:
        compression: as the chunk says.
        data: compressed.
        size: as the chunk says.

    Raises:
        Malformed: they are no such data, or not of this size.
        CannotRestore: of this compression nothing is known, or its library is not installed; names the extra.
    """
    if size > MOST:
        raise Malformed(f"a chunk claims {size:,} bytes, and at most {MOST:,} are restored")
    if not compression:
        found: bytes | memoryview = data
    elif compression == "zstd":
        found = _restore_zstd(data, size)
    elif compression == "lz4":
        found = _restore_lz4(data, size)
    else:
        raise CannotRestore(f"its chunks are compressed as {shown(compression)}; robo reads zstd and lz4")
    if len(found) != size:
        raise Malformed(f"a chunk claims {size:,} bytes and holds {'more' if len(found) > size else f'{len(found):,}'}")
    return found


def _restore_zstd(data: memoryview, size: int) -> bytes:
    zstd = _needed(_ZSTD, "zstd")
    try:
        return bytes(zstd.ZstdDecompressor().decompress(data, size + 1))
    except (zstd.ZstdError, EOFError, MemoryError) as error:
        raise Malformed(f"a chunk is no zstd: {error}") from None


def _restore_lz4(data: memoryview, size: int) -> bytes:
    frame = _needed("lz4.frame", "lz4")
    try:
        return bytes(frame.LZ4FrameDecompressor().decompress(data, size + 1))
    except (RuntimeError, EOFError, MemoryError) as error:
        raise Malformed(f"a chunk is no lz4: {error}") from None


def _needed(module: str, compression: str) -> Any:
    found = _module(module)
    if found is None:
        raise CannotRestore(
            f"its chunks are compressed as {compression}, and the library for it is not installed: "
            "pip install 'robo-zenoh[record]'"
        )
    return found


def _module(name: str) -> Any:
    """A library, where it is installed."""
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        return None
