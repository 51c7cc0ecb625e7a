"""Pictures of few colours as PNG, without a library. Pure."""

import struct
import zlib
from collections.abc import Sequence

Colour = tuple[int, int, int, int]
"""Red, green, blue and how opaque, each 0 to 255."""


def png(width: int, height: int, pixels: bytes | bytearray, palette: Sequence[Colour]) -> bytes:
    """A picture of colours of a palette.

    Args:
        width, height: pixels.
        pixels: numbers of colours, row by row from the top.
        palette: at most 256 colours.
    """
    rows = b"".join(b"\0" + pixels[at : at + width] for at in range(0, width * height, width))
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)),
        (b"PLTE", b"".join(bytes(colour[:3]) for colour in palette)),
        (b"tRNS", bytes(colour[3] for colour in palette)),
        (b"IDAT", zlib.compress(rows, 9)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    )
