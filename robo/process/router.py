"""A robot's router: where its nodes meet, and where tools and other robots find it.

`python -m robo.process.router` is the process that a supervisor starts; its network is in the environment.
"""

import os
import resource
import sys
import threading
import time
from collections.abc import Callable

import msgspec

from robo.environment import NETWORK_VARIABLE
from robo.errors import RoboError
from robo.process import signals
from robo.text.readable import readable
from robo.wire import tcp
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

CONNECTIONS = 8192
"""How many files and sockets a router may have open, where the machine's owner grants so many: 1,024 is usual, and a
stranger who connects as often would keep the robot's own user out."""
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
UNUSABLE = 3
"""How a secured router's process ends at which nobody can arrive, or whose files make no sense."""
TOLD = "security: "
"""How a line begins that says whom a secured router has refused, or what has changed of it."""


def main() -> None:
    """Route for a supervisor, until SIGINT or SIGTERM, or until it is gone."""
    # Its supervisor's watchdog ends it where the supervisor cannot; where both are gone it ends itself.
    parent = os.getppid()
    network = msgspec.json.decode(os.environ.pop(NETWORK_VARIABLE), type=readable(Network))
    try:
        route(network, lambda: os.getppid() != parent)
    except RoboError as error:
        print(f"ERROR {error}", file=sys.stderr)
        sys.exit(UNUSABLE if network.security else 1)


def route(network: Network, is_over: Callable[[], bool], linger: float = LINGER) -> None:
    """Route until SIGINT or SIGTERM, or until it is over, which is asked once a second.

    Raises:
        NetworkError: an endpoint is not valid; with security on also that nobody can reach the router there.
        SecurityError: with security on: something is wrong with the files of its name.
    """
    allow_connections()
    ended = threading.Event()
    signals.on_end(ended.set)
    # Zenoh 1.10 keeps the shared memory of everybody who has ever sent a large message mapped and locked, also
    # when he is gone: some 20 MB for each tool and stranger, in the router and in the nodes behind it.
    network = msgspec.structs.replace(network, shared_memory=False)
    if network.security:
        closed = _route_secured(network, ended, is_over, linger)
    else:
        session = open_session(network)
        while not ended.wait(1.0) and not is_over():
            pass
        if linger:
            serve_the_last(linger)
        closed = close_session(session)
    if not closed:
        os._exit(0)


def _route_secured(network: Network, ended: threading.Event, is_over: Callable[[], bool], linger: float) -> bool:
    """As `route`, with a door that others meet by TLS; returns whether all has closed in time."""
    from robo.process import door
    from robo.process.zenoh_log import ZenohLog

    inner, outer = door.parted(network)
    log = ZenohLog(_tell)
    sessions = [open_session(inner)] if inner is not None else []
    opened = door.Door(outer, log, _tell)
    asked = time.monotonic()
    while not ended.wait(door.LOOK_EVERY):
        if time.monotonic() - asked >= 1.0:
            asked = time.monotonic()
            if is_over():
                break
        opened.look()
    if linger:
        serve_the_last(linger)
    return all([opened.close(), *map(close_session, sessions)])


def _tell(sentence: str) -> None:
    """Tell the router's owner: whoever has started it, or the supervisor, which passes it on."""
    print(f"{TOLD}{sentence}", file=sys.stderr, flush=True)


def allow_connections() -> None:
    """Let this process have as many connections as strangers may open, and those of its owner, as far as it may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = CONNECTIONS if hard == resource.RLIM_INFINITY else min(CONNECTIONS, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


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
