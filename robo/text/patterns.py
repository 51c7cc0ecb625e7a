"""Topics and nodes by patterns, as people write key expressions. Pure.

`*` stands for one part of a name, `**` for any number of them, also none. Within a part `*`, which Zenoh writes `$*`,
stands for any letters: `r1/camera_*`. Outer slashes do not count, but a pattern that begins with one means whole names.
"""

import re
from collections.abc import Callable, Collection, Sequence

from robo.errors import UsageError
from robo.text.suggestions import suggest

Pattern = Sequence["re.Pattern[str] | None"]
"""What each part has to be; None for any number of them."""

_OPTIONS = ("", "--exclude")


def chosen(
    names: Collection[str],
    wanted: Sequence[str],
    excluded: Sequence[str] = (),
    path: str = "",
    *,
    robot: str = "",
    options: tuple[str, str] = _OPTIONS,
) -> Callable[[str], bool]:
    """Which topics are meant.

    Args:
        names: of all topics that there are.
        wanted: patterns of those that are meant; none for all.
        excluded: patterns of those that are not, whatever `wanted` says.
        path: of the recording, for messages.
        robot: a namespace that patterns may leave out.
        options: by which both are asked for, for messages; empty for what has none.

    Raises:
        UsageError: a pattern makes no sense, matches no topic, or no topic is left. One of `excluded` may match none
            if it has a `*`.
    """
    place = f"{path}: " if path else ""
    for option, patterns in zip(options, (wanted, excluded), strict=True):
        for text in patterns:
            if not any(map(matcher([text], robot=robot), names)) and not (patterns is excluded and "*" in text):
                said = f"{option} {text}: no topic matches" if option else f"it has no topic {text}"
                raise UsageError(f"{place}{said}; {suggest(text, names, 'it has')}")
    found = set(filter(matcher(wanted, excluded, robot), names))
    if names and not found:
        raise UsageError(f"{place}no topic is left")
    return found.__contains__


def matcher(
    wanted: Sequence[str], excluded: Sequence[str] = (), robot: str = "", what: str = "topic"
) -> Callable[[str], bool]:
    """Whether a topic is meant, where nobody knows yet which there are; as `chosen`. `what` it is, for messages.

    Raises:
        UsageError: a pattern makes no sense.
    """
    yes, no = ([_one(text, robot, what) for text in patterns] for patterns in (wanted, excluded))
    return lambda name: (not yes or any(one(name) for one in yes)) and not any(one(name) for one in no)


def _one(text: str, robot: str, what: str) -> Callable[[str], bool]:
    pattern = _pattern(text, what)
    own = f"{robot}/" if robot and not text.startswith("/") else ""
    if not own:
        return lambda name: _matches(pattern, name)
    return lambda name: _matches(pattern, name) or (name.startswith(own) and _matches(pattern, name.removeprefix(own)))


def _pattern(text: str, what: str) -> Pattern:
    parts = text.replace("$*", "*").strip("/").split("/")
    if "" in parts or any("**" in part and part != "**" for part in parts):
        raise UsageError(
            f"{what} {text!r} makes no sense: letters, * or ** stand between slashes, as in r1/* or **/scan"
        )
    return [None if part == "**" else re.compile(_letters(part), re.DOTALL) for part in parts]


def _letters(part: str) -> str:
    return ".*".join(map(re.escape, part.split("*")))


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
