"""The 16 bytes by which ROS knows an end of its graph: a hash of its liveliness token."""

import functools
from collections.abc import Callable

from robo.errors import RunError


@functools.cache
def hasher() -> Callable[[bytes], int]:
    """XXH3 with 128 bits, of bytes.

    Raises:
        RunError: the library that makes it is not installed.
    """
    try:
        import xxhash
    except ImportError:
        raise RunError(
            "the bridge to ROS 2 needs the library xxhash, by which ROS names publishers\n"
            "  pip install 'robo-zenoh[ros2]'"
        ) from None
    return xxhash.xxh3_128_intdigest


def gid_of(token: str) -> bytes:
    """The id of whoever has declared a token: its low 64 bits first, then the high ones, the lower byte of each first.

    Raises:
        RunError: as `hasher`.
    """
    return hasher()(token.encode()).to_bytes(16, "little")
