"""Data for programs as JSON that is safe on a terminal too, in characters that stdout has."""

import sys

import msgspec

from robo.text.terminal import escaped_json
from robo.wire.codec import jsonable


def to_json(value: object) -> str:
    """An object as a line of JSON."""
    return _safe(msgspec.json.encode(jsonable(msgspec.to_builtins(value))))


def document(value: object) -> str:
    """An object as JSON with indentation, easy to read."""
    return _safe(msgspec.json.format(msgspec.json.encode(value)))


def _safe(encoded: bytes) -> str:
    return escaped_json(encoded.decode(), sys.stdout.encoding)
