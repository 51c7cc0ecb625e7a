"""What verbs that wait for messages say: of what they wait for, and where too little has come."""

from collections.abc import Sequence

import zenoh

from robo.cli.printing import amount, hint, note
from robo.cli.reach import Reach
from robo.text.suggestions import suggest
from robo.tools import topics
from robo.tools.topics import Topic
from robo.wire.names import shown_key


def tell_who_is_waited_for(
    session: zenoh.Session, keys: Sequence[str], reach: Reach, *, endless: bool = False
) -> list[Topic]:
    """Say which topics nobody publishes so far, with what comes close.

    Args:
        session: a session.
        keys: what is waited for.
        reach: whom to ask, and for how long.
        endless: whether the wait goes on until something comes.

    Returns:
        The topics that there are.
    """
    found = topics.list_topics(session, reach.timeout, [key for key in keys if "*" not in key])
    published = [topic.key for topic in found if topic.publishers]
    absent = [key for key in keys if "*" not in key and key not in published]
    for key in absent:
        note(f"waiting for {key}: nobody publishes it so far; {suggest(key, published)}")
    if absent and endless and reach.given_timeout is not None:
        note("--timeout is how long to wait for the network and for answers; --duration S ends this wait")
    if not absent:
        hint(f"waiting for {', '.join(map(shown_key, keys))} …")
    return found


def complain_of_few(
    keys: Sequence[str], came: int, wanted: int | None, duration: float | None, *, what: str = "message", more: str = ""
) -> int:
    """Say so where fewer came than were asked for, or none.

    Args:
        keys: what was waited for.
        came: how many were printed.
        wanted: how many were asked for; None for any.
        duration: how long was waited, s; None for as long as it took.
        what: what was counted.
        more: to be added.

    Returns:
        The exit code: 1 where there were too few.
    """
    if came >= (wanted or 1):
        return 0
    count = f"no {what}" if not came else f"only {amount(came, what)}"
    where = ", ".join(map(shown_key, keys))
    note(f"{count} on {where} within {duration or 0.0:g} s{more}")
    return 1
