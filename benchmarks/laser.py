"""How a laser scan's ranges could travel: as an array of numbers, or packed into bytes."""

import array
import statistics
import timeit
from collections.abc import Callable, Sequence
from functools import partial

import msgspec


class AsArray(msgspec.Struct):
    """Readable by any client."""

    ranges: list[float]


class AsBytes(msgspec.Struct):
    """float32, little-endian: shorter, and not to be read without knowing so."""

    ranges: memoryview


_encoder = msgspec.msgpack.Encoder()
_array_decoder = msgspec.msgpack.Decoder(AsArray)
_packed_decoder = msgspec.msgpack.Decoder(AsBytes)


def encode_array(ranges: list[float]) -> bytes:
    return _encoder.encode(AsArray(ranges))


def decode_array(payload: bytes) -> Sequence[float]:
    return _array_decoder.decode(payload).ranges


def encode_packed(ranges: list[float]) -> bytes:
    return _encoder.encode(AsBytes(memoryview(array.array("f", ranges)).cast("B")))


def decode_packed(payload: bytes) -> Sequence[float]:
    return _packed_decoder.decode(payload).ranges.cast("f").tolist()


FORMS = (("array", encode_array, decode_array), ("packed", encode_packed, decode_packed))


def table(rounds: int) -> list[str]:
    """From a list of floats to the wire and back to a list, which is what code computes with."""
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
        for form, encode, decode in FORMS:
            payload = encode(ranges)
            there = _microseconds(partial(encode, ranges), rounds)
            back = _microseconds(partial(decode, payload), rounds)
            lines.append(f"| {rays} | {form} | {len(payload)} | {there:.1f} | {back:.1f} |")
    return [*lines, ""]


def _microseconds(call: Callable[[], object], rounds: int) -> float:
    return statistics.median(timeit.repeat(call, number=500, repeat=rounds)) / 500 * 1e6
