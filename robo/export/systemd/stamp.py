"""A mark by which a unit is known as one of robo's that nobody has changed since."""

import hashlib
import re

_MARK = re.compile(r"# Unchanged while the rest has the hash ([0-9a-f]{64})\n")


def stamped(text: str) -> str:
    """A unit with its mark, which is its first line."""
    return f"# Unchanged while the rest has the hash {_hash(text)}\n{text}"


def is_own(text: str) -> bool:
    """Whether a unit was written by robo."""
    return _MARK.match(text) is not None


def is_unchanged(text: str) -> bool:
    """Whether a unit is as robo has written it."""
    mark = _MARK.match(text)
    return mark is not None and mark[1] == _hash(text[mark.end() :])


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
