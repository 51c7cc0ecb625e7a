"""A robot's router: where its nodes meet, and where tools and other robots find it.

`python -m robo.process.router` is the process that a supervisor starts; its network is in the environment.
"""

import os
import sys
import threading
import time
from collections.abc import Callable

import msgspec

from robo.environment import NETWORK_VARIABLE
from robo.errors import RoboError
from robo.process import signals
from robo.wire import tcp
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

LINGER = 0.5
"""How long a router goes on after its robot has ended, s: for what is on the way to readers."""
STALLED = 1.0
"""How long slow readers may take nothing of what waits for them before the router leaves all the same, s."""
BREATH = 0.1
"""For how long in all nothing may wait, since a connection was full, until nothing more comes, s."""
FULL = 16_384
"""How much waits at least in a connection that is full, bytes; less is what is just on its way."""
LONGEST_LINGER = 10.0
"""How long it goes on at most, s, however little slow readers take at a time."""
_LOOK = 0.02
"""How often it is looked what waits, s."""


def main() -> None:
    """Route for a supervisor, until SIGINT or SIGTERM, or until it is gone."""
    # Its supervisor's watchdog ends it where the supervisor cannot; where both are gone it ends itself.
    parent = os.getppid()
    try:
        network = msgspec.json.decode(os.environ.pop(NETWORK_VARIABLE), type=Network)
        route(network, lambda: os.getppid() != parent)
    except RoboError as error:
        print(f"ERROR {error}", file=sys.stderr)
        sys.exit(1)


def route(network: Network, is_over: Callable[[], bool], linger: float = LINGER) -> None:
    """Route until SIGINT or SIGTERM, or until it is over, which is asked once a second.

    Raises:
        NetworkError: an endpoint is not valid.
    """
    ended = threading.Event()
    signals.on_end(ended.set)
    # Zenoh 1.10 keeps the shared memory of everybody who has ever sent a large message mapped and locked, also
    # when he is gone: some 20 MB for each tool and stranger, in the router and in the nodes behind it.
    session = open_session(msgspec.structs.replace(network, shared_memory=False))
    while not ended.wait(1.0) and not is_over():
        pass
    if linger:
        serve_the_last(linger)
    if not close_session(session):
        os._exit(0)


def serve_the_last(linger: float, waiting: Callable[[], int] = tcp.unsent) -> None:
    """Go on for so many seconds, and until readers have taken what waits for them.

    Zenoh does not tell when its queues are empty, and closing empties them the short way; but where something waits
    in them, the connections are full. What other robots send through this router meanwhile does not fill them.

    Args:
        linger: s.
        waiting: how many bytes wait in connections.
    """
    begin = moved = now = time.monotonic()
    left, idle = waiting(), 0.0
    while now < begin + linger or (now < begin + LONGEST_LINGER and now < moved + STALLED and idle < BREATH):
        time.sleep(_LOOK)
        before, left, now = left, waiting(), time.monotonic()
        if left != before:
            moved = now
        if left >= FULL:
            idle = 0.0
        elif not left:
            idle += _LOOK


if __name__ == "__main__":
    main()
