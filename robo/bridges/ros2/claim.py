"""One bridge for a robot: two would pass everything on twice, and each other's."""

import os
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from queue import Empty, SimpleQueue
from typing import Any

import zenoh

from robo.bridges.ros2.scope import NODE
from robo.errors import RunError
from robo.wire import claims, liveliness, names
from robo.wire.claims import Name, names_in_use, told
from robo.wire.discovery import hostname
from robo.wire.keys import ClaimToken, NodeToken, parse_token
from robo.wire.run_id import new_run_id

_ANSWERS_WITHIN = 1.0
"""s."""
_LINKED_WITHIN = 0.5
"""How long peers may take to link to each other, s."""


def claim(session: zenoh.Session, full_name: str) -> Any:
    """Claim the name of a bridge that no supervisor has launched; it is held as long as what is returned.

    Raises:
        RunError: another bridge has the robot, or one of the robots.
    """
    namespace, name = names.split(full_name)
    token = ClaimToken(namespace, name, "", os.getpid(), hostname(), new_run_id())
    held = claims.declare(session, [token])
    found = dict.fromkeys(names_in_use(session, _ANSWERS_WITHIN))
    others = [one for one in found if _shares(one, full_name) and one.run != token.run]
    # Of two that claim at once either sees the other: the one that began later gives way.
    taken = [one for one in others if not (isinstance(one, ClaimToken) and one.run > token.run)]
    if taken:
        for one in held:
            one.undeclare()
        _refuse(taken)
    return held


def give_way(session: zenoh.Session, full_name: str) -> None:
    """See that no other bridge has some of the same robots: for a bridge whose name its supervisor claims.

    Nodes are peers: they link to each other a moment after they have begun, and know of each other only then.

    Raises:
        RunError: another bridge has the robot, or one of the robots.
    """
    heard = SimpleQueue[Name]()

    def hear(sample: zenoh.Sample) -> None:
        token = parse_token(str(sample.key_expr)) if sample.kind == zenoh.SampleKind.PUT else None
        if isinstance(token, ClaimToken | NodeToken) and token.full_name != full_name:
            heard.put(token)

    at_once: Any = zenoh.handlers.Callback
    with ExitStack() as watching:
        for key in (ClaimToken.ALL, NodeToken.ALL):
            handler = at_once(hear, indirect=False)
            watching.callback(liveliness.hear(session, key, handler).undeclare)
        end = time.monotonic() + _LINKED_WITHIN
        with suppress(Empty):
            while True:
                other = heard.get(timeout=max(0.0, end - time.monotonic()))
                if _shares(other, full_name):
                    _refuse([other])


def _shares(other: Name, full_name: str) -> bool:
    """Whether another node is a bridge that has some of the same robots."""
    return other.node == NODE and _overlap(other.namespace, names.split(full_name)[0])


def _refuse(taken: Sequence[Name]) -> None:
    raise RunError(f"{told(taken)}: one bridge is enough for a robot; stop it first")


def _overlap(one: str, other: str) -> bool:
    """Whether a namespace is within the other, or the same."""
    return any(not outer or f"{inner}/".startswith(f"{outer}/") for outer, inner in ((one, other), (other, one)))
