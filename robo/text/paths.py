"""Nested maps as maps of paths, and back."""

from collections.abc import Mapping


def nested(values: Mapping[str, object], separator: str) -> dict[str, object]:
    """Values whose names have parts as maps within maps: `{"a.b": 1}` to `{"a": {"b": 1}}`."""
    tree: dict[str, object] = {}
    for name, value in values.items():
        *outer, last = name.split(separator)
        place = tree
        for part in outer:
            inner = place.setdefault(part, {})
            assert isinstance(inner, dict)
            place = inner
        place[last] = value
    return tree
