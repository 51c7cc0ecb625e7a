"""A question that may take minutes, asked by a tool: it outlives a link that is lost meanwhile, the tool's own too."""

import threading
import time
from collections.abc import Callable

import zenoh

from robo.wire.long_query import LongQuery
from robo.wire.queries import Fault

_LOOK = 0.5
"""How often one looks whether somebody is there who could answer while nothing is heard, s."""


def answer_of(
    session: zenoh.Session,
    key: str,
    request: bytes,
    encoding: str,
    is_served: Callable[[], bool],
    timeout: float | None,
) -> zenoh.Sample | Fault | None:
    """Ask, again where the question is lost, and wait for the answer.

    Whoever is asked may so hear the question twice.

    Args:
        session: the network.
        key: whom to ask.
        request: what.
        encoding: of the request.
        is_served: whether somebody says that he answers on the key.
        timeout: how long to wait at most, s; None: for as long as somebody is there.

    Returns:
        The answer, or the error in its place; None where there is none in time.

    Raises:
        Gone: nobody is there any more.
    """
    end = None if timeout is None else time.monotonic() + timeout
    woken = threading.Event()
    query = LongQuery(session, key, request, encoding, woken.set, time.monotonic)
    while True:
        woken.clear()
        answer = query.look()
        if answer is not None or (end is not None and time.monotonic() >= end):
            return answer
        if not woken.wait(_LOOK) and not is_served():
            query.lose()
