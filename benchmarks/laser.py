"""How a laser scan's ranges could travel: as an array of numbers, or packed into bytes."""

import array
import socket
import statistics
import timeit

import msgspec


class AsArray(msgspec.Struct):
    """Readable by any client."""

    ranges: list[float]


class AsBytes(msgspec.Struct):
    """float32, little-endian: shorter, and not to be read without knowing so."""

    ranges: memoryview


def table(rounds: int) -> list[str]:
    """From a list of floats to the wire and back to a list, which is what code computes with."""
    encoder = msgspec.msgpack.Encoder()
    lines = [
        "### Ranges of a laser scan: an array, or packed bytes",
        "",
        "From a list of floats to the payload, and from the payload to a list of floats.",
        "",
        "| rays | form | bytes | encode µs | decode µs |",
        "|---|---|---|---|---|",
    ]
    for rays in (360, 2000):
        ranges = [1.0 + i * 0.001 for i in range(rays)]
        as_array, as_bytes = msgspec.msgpack.Decoder(AsArray), msgspec.msgpack.Decoder(AsBytes)
        plain = encoder.encode(AsArray(ranges))
        packed = encoder.encode(AsBytes(memoryview(array.array("f", ranges)).cast("B")))
        rows = (
            ("array", plain, lambda: encoder.encode(AsArray(ranges)), lambda: as_array.decode(plain)),
            (
                "packed",
                packed,
                lambda: encoder.encode(AsBytes(memoryview(array.array("f", ranges)).cast("B"))),
                lambda: as_bytes.decode(packed).ranges.cast("f").tolist(),
            ),
        )
        for form, payload, encode, decode in rows:
            times = [
                statistics.median(timeit.repeat(f, number=500, repeat=rounds)) / 500 * 1e6 for f in (encode, decode)
            ]
            lines.append(f"| {rays} | {form} | {len(payload)} | {times[0]:.1f} | {times[1]:.1f} |")
    return [*lines, ""]


def free_port() -> int:
    """A TCP port on loopback that nobody listens on."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port: int = s.getsockname()[1]
        return port
