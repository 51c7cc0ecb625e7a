"""Whose a message is: Zenoh's own words for it, which go with each message."""

import itertools
from collections.abc import Callable

import zenoh

_NUMBERS = 2**32 - 1
"""Zenoh's numbers begin anew after so many."""


def counted(publisher: zenoh.EntityGlobalId) -> Callable[[], zenoh.SourceInfo]:
    """What names a publisher, with the next number each time it is called.

    A receiver of robo's reads its own number in the attachment. But Zenoh's advanced subscribers take a message with
    the number of another for that other one, come again.
    """
    numbers = map(_NUMBERS.__and__, itertools.count(1))
    return map(zenoh.SourceInfo, itertools.repeat(publisher), numbers).__next__  # in C: any thread may call it
