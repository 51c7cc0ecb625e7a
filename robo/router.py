"""A robot's router: where its nodes meet, and where tools and other robots find it.

`python -m robo.router` is the process that a supervisor starts; its network is in the environment.
"""

import os
import signal
import sys
import threading

import msgspec

from robo.errors import RoboError
from robo.session import Network, close_session, open_session

NETWORK_VARIABLE = "ROBO_ROUTER"


def main() -> None:
    """Route until SIGINT or SIGTERM."""
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    try:
        network = msgspec.json.decode(os.environ.pop(NETWORK_VARIABLE), type=Network)
        session = open_session(network)
    except RoboError as error:
        print(f"ERROR {error}", file=sys.stderr)
        sys.exit(1)
    ended.wait()
    close_session(session)


if __name__ == "__main__":
    main()
