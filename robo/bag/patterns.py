"""Topics by patterns, as key expressions have them: `r1/*`, `**/scan`. Pure.

`*` stands for one part of a name, `**` for any number of them, also none. Within a part `*`, which Zenoh writes `$*`,
stands for any letters: `r1/camera_*`.
"""

import re
from collections.abc import Callable, Collection, Iterable, Sequence

from robo.errors import BagError
from robo.text.suggestions import suggest

Pattern = Sequence["re.Pattern[str] | None"]
"""What each part has to be; None for any number of them."""


def chosen(
    names: Collection[str], wanted: Sequence[str], excluded: Sequence[str] = (), path: str = ""
) -> Callable[[str], bool]:
    """Which topics are meant.

    Args:
        names: of all topics that there are.
        wanted: patterns of those that are meant; none for all.
        excluded: patterns of those that are not, whatever `wanted` says.
        path: of the recording, for messages.

    Raises:
        BagError: a pattern makes no sense, one of `wanted` matches no topic, or no topic is left.
    """
    for text in wanted:
        pattern = _pattern(text)
        if not any(_matches(pattern, name) for name in names):
            raise BagError(f"it has no topic {text}; {suggest(text, names, 'it has')}", path)
    found = set(filter(matcher(wanted, excluded), names))
    if names and not found:
        raise BagError("no topic is left", path)
    return found.__contains__


def matcher(wanted: Sequence[str], excluded: Sequence[str] = ()) -> Callable[[str], bool]:
    """Whether a topic is meant, where nobody knows yet which there are; as `chosen`.

    Raises:
        BagError: a pattern makes no sense.
    """
    yes, no = list(map(_pattern, wanted)), list(map(_pattern, excluded))
    return lambda name: (not yes or _any(yes, name)) and not _any(no, name)


def _pattern(text: str) -> Pattern:
    parts = text.removeprefix("/").split("/")
    if "" in parts:
        raise BagError(f"topic {text!r} makes no sense: letters, * or ** stand between slashes, as in r1/* or **/scan")
    return [None if part == "**" else re.compile(_letters(part), re.DOTALL) for part in parts]


def _letters(part: str) -> str:
    # A `*` behind another one says nothing more, and would have a long name take long.
    return ".*".join(map(re.escape, re.split(r"(?:\$?\*)+", part)))


def _any(patterns: Iterable[Pattern], name: str) -> bool:
    return any(_matches(pattern, name) for pattern in patterns)


def _matches(pattern: Pattern, name: str) -> bool:
    parts = name.split("/")
    here = at = 0
    again, back = -1, 0
    """Behind the last `**`, and how many parts of the name that stands for so far."""
    while at < len(parts):
        wanted = pattern[here] if here < len(pattern) else _NOTHING
        if wanted is None:
            here += 1
            again, back = here, at
        elif wanted.fullmatch(parts[at]):
            here, at = here + 1, at + 1
        elif again >= 0:
            back += 1
            here, at = again, back
        else:
            return False
    return all(part is None for part in pattern[here:])


_NOTHING = re.compile(r"(?!)")
