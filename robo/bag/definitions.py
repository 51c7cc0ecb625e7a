"""Whether two texts of ROS define the same message: the fields decide, not comments, constants or defaults. Pure."""

import functools
import re

_RULER = re.compile(r"^={20,}[ \t\r]*$", re.MULTILINE)
_FIELD = re.compile(r"([A-Za-z][\w/]*(?:<=\d+)?(?:\[(?:<=)?\d*\])?)\s+([A-Za-z]\w*)\s*(=)?")
_PARTS = re.compile(r"([A-Za-z][\w/]*)(.*)")
_ALIASES = {"byte": "uint8", "char": "uint8"}
_PRIMITIVE = {
    "bool", "byte", "char", "float32", "float64", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64",
    "uint64", "string", "wstring",
}  # fmt: skip

Fields = tuple[tuple[str, str], ...]
"""Type and name of each."""


def differs(name: str, theirs: str, ours: str) -> str:
    """Where two definitions of a type differ, in words; empty where both have the same bytes.

    Args:
        name: of the type, in ROS: `geometry_msgs/msg/Twist`.
        theirs: a definition in ROS's text, with its parts.
        ours: another one.
    """
    if theirs == ours:
        return ""
    root = _short(name)
    return _differs(root, _types(root, theirs), _types(root, ours))


def fields_of(name: str, text: str) -> frozenset[tuple[str, Fields]]:
    """What a definition says of the bytes: the fields of a type and of all its parts, by their short names."""
    every = _types(_short(name), text)
    found: dict[str, Fields] = {}
    to_do = [_short(name)]
    while to_do:
        one = to_do.pop()
        if one in every and one not in found:
            found[one] = every[one]
            to_do += [_base(type_) for type_, _ in every[one]]
    return frozenset(found.items())


def _differs(name: str, theirs: dict[str, Fields], ours: dict[str, Fields]) -> str:
    seen: set[str] = set()
    to_do = [name]
    while to_do:
        name = to_do.pop()
        if name in seen:
            continue
        seen.add(name)
        their_fields, our_fields = theirs.get(name), ours.get(name)
        if their_fields is None or our_fields is None:
            return f"{name} is defined in one of them only"
        for mine, other in zip(our_fields, their_fields, strict=False):
            if mine != other:
                return f"{name} has {' '.join(other)} where robo has {' '.join(mine)}"
        if len(their_fields) != len(our_fields):
            more, fewer = sorted((their_fields, our_fields), key=len, reverse=True)
            extra = " ".join(more[len(fewer)])
            return f"{name} has {extra} in {'the file' if more is their_fields else 'robo'} only"
        for type_, _ in our_fields:
            base = _base(type_)
            if base not in _PRIMITIVE:
                to_do.append(base)
    return ""


@functools.lru_cache(32)
def _types(root: str, text: str) -> dict[str, Fields]:
    """The fields of each type in a text, by short name: `geometry_msgs/Twist`."""
    found: dict[str, Fields] = {}
    name = root
    for part in _RULER.split(text):
        lines = part.strip().splitlines()
        if lines and lines[0].startswith("MSG:"):
            name = _short(lines[0].removeprefix("MSG:").strip())
            lines = lines[1:]
        found.setdefault(name, tuple(_fields(lines, name.partition("/")[0])))
    return found


def _fields(lines: list[str], package: str) -> list[tuple[str, str]]:
    found = []
    for line in lines:
        match = _FIELD.match(line.partition("#")[0].strip())
        if match is not None and not match[3]:  # a constant takes no room
            found.append((_whole(match[1], package), match[2]))
    return found


def _whole(type_: str, package: str) -> str:
    """A field's type with the package of its message; bounds do not change the bytes, and are left out."""
    match = _PARTS.fullmatch(type_)
    assert match is not None
    base, rest = match[1], re.sub(r"<=\d+", "", match[2])
    if base == "Header":
        base = "std_msgs/Header"
    elif base in _ALIASES:
        base = _ALIASES[base]
    elif base not in _PRIMITIVE and "/" not in base:
        base = f"{package}/{base}"
    return f"{_short(base)}{rest}"


def _base(type_: str) -> str:
    return type_.partition("[")[0]


def _short(name: str) -> str:
    """`geometry_msgs/msg/Twist` as texts have it: `geometry_msgs/Twist`."""
    first, _, rest = name.partition("/")
    return f"{first}/{rest.rpartition('/')[2]}" if rest else first
