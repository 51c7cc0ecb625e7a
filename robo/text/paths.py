"""Nested maps as maps of paths, and back."""

from collections.abc import Callable, Iterator, Mapping


def _holds_something(_path: str, inner: Mapping[str, object]) -> bool:
    return bool(inner)


def unnested(
    values: Mapping[str, object],
    separator: str,
    is_opened: Callable[[str, Mapping[str, object]], bool] = _holds_something,
    outer: str = "",
) -> Iterator[tuple[str, object]]:
    """The values of maps within maps, each with its path: `{"a": {"b": 1}}` to `("a.b", 1)`.

    Args:
        values: the outermost map.
        separator: between the names of a path.
        is_opened: whether the map at a path is taken apart, or else is a value itself; by default an empty one is.
        outer: what all paths begin with.
    """
    for name, value in values.items():
        path = f"{outer}{name}"
        if isinstance(value, Mapping) and is_opened(path, value):
            yield from unnested(value, separator, is_opened, f"{path}{separator}")
        else:
            yield path, value


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
