"""Data for programs as JSON that is safe on a terminal too, in characters that stdout has."""

import sys
from typing import Any

import msgspec

from robo.text.terminal import escaped_json
from robo.wire.codec import jsonable


def to_json(value: object) -> str:
    """An object as a line of JSON."""
    plain = jsonable(msgspec.to_builtins(value))
    try:
        return _safe(msgspec.json.encode(plain))
    except UnicodeEncodeError:
        return _safe(msgspec.json.encode(_encodable(plain)))


def document(value: object) -> str:
    """An object as JSON with indentation, easy to read."""
    return _safe(msgspec.json.format(msgspec.json.encode(value)))


def _encodable(value: Any) -> Any:
    """Plain data in which a name of a file that is no UTF-8 is shown with escapes."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, dict):
        return {_encodable(key): _encodable(one) for key, one in value.items()}
    return [_encodable(one) for one in value] if isinstance(value, (list, tuple)) else value


def _safe(encoded: bytes) -> str:
    return escaped_json(encoded.decode(), sys.stdout.encoding)
