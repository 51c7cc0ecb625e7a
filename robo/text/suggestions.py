"""What somebody may have meant who named something that is not there."""

from collections.abc import Iterable

from robo.text.terminal import visible

MOST_LISTED = 24
_LEAST_PART = 3
"""From how many letters on a part of a name stands for it."""

LONGEST = 200
"""Nothing is close to a text that is longer, and to find that out would take long."""


def closest(wanted: str, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """The name that comes closest, if one does: it is written alike, or begins or ends with what was named.

    Args:
        wanted: what was named.
        known: what there is.
        cutoff: from 0, anything is close, to 1, only the same is.
    """
    if len(wanted) > LONGEST:
        return None
    import difflib  # only mistakes need it

    names = list(known)
    alike = difflib.get_close_matches(wanted, names, n=1, cutoff=cutoff)
    if alike or len(wanted) < _LEAST_PART:
        return next(iter(alike), None)
    parts = [name for name in names if name.startswith(wanted) or name.endswith(wanted)]
    return min(parts, key=len, default=None)


def suggest(wanted: str, known: Iterable[str], there: str = "there is") -> str:
    """`did you mean odom?`, or what there is: the end of a message about a name that is unknown."""
    names = [visible(name) for name in dict.fromkeys(known)]
    close = closest(wanted, names)
    if close is not None:
        return f"did you mean {close}?"
    shown = ", ".join(names[:MOST_LISTED]) or "none"
    return f"{there} {shown}{', …' if len(names) > MOST_LISTED else ''}"


def hint(wanted: str, known: Iterable[str], otherwise: str = "") -> str:
    """`; did you mean odom?`, or something else: for what may be added to a message that says enough."""
    close = closest(wanted, known)
    return f"; did you mean {visible(close)}?" if close is not None else otherwise
