"""What somebody may have meant who named something that is not there."""

from collections.abc import Iterable

MOST_LISTED = 24


def closest(wanted: str, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """The name that comes closest, if one does.

    Args:
        wanted: what was named.
        known: what there is.
        cutoff: from 0, anything is close, to 1, only the same is.
    """
    import difflib  # only mistakes need it

    return next(iter(difflib.get_close_matches(wanted, list(known), n=1, cutoff=cutoff)), None)


def suggest(wanted: str, known: Iterable[str], there: str = "there is") -> str:
    """`did you mean odom?`, or what there is: the end of a message about a name that is unknown."""
    names = list(dict.fromkeys(known))
    close = closest(wanted, names)
    if close is not None:
        return f"did you mean {close}?"
    shown = ", ".join(names[:MOST_LISTED]) or "none"
    return f"{there} {shown}{', …' if len(names) > MOST_LISTED else ''}"


def hint(wanted: str, known: Iterable[str], otherwise: str = "") -> str:
    """`; did you mean odom?`, or something else: for what may be added to a message that says enough."""
    close = closest(wanted, known)
    return f"; did you mean {close}?" if close is not None else otherwise
