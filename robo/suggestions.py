"""What somebody may have meant who named something that is not there."""

from collections.abc import Iterable

MOST_LISTED = 12


def closest(wanted: str, known: Iterable[str]) -> str | None:
    """The name that comes closest, if one does."""
    import difflib  # only mistakes need it

    return next(iter(difflib.get_close_matches(wanted, list(known), n=1)), None)


def suggest(wanted: str, known: Iterable[str]) -> str:
    """`did you mean odom?`, or what there is: the end of a message about a name that is unknown."""
    there = list(known)
    close = closest(wanted, there)
    if close is not None:
        return f"did you mean {close}?"
    shown = ", ".join(there[:MOST_LISTED]) or "none"
    return f"there is {shown}{', …' if len(there) > MOST_LISTED else ''}"
