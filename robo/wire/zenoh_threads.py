"""How many threads Zenoh starts in a process, and what for."""

import os

VARIABLE = "ZENOH_RUNTIME"
"""Zenoh looks at it when a process opens its first session."""

OF_A_NODE = "(rx:(worker_threads:1),acc:(handover:net),tx:(handover:net))"
"""One receiving thread, and what else Zenoh does on its network threads: two threads fewer in each process
and less latency than its default. Sending stays apart from receiving: on one runtime a receiver that is
held up also holds up what it must send, and messages were lost and torn."""

OF_A_ROUTER = "(rx:(worker_threads:4),acc:(handover:net),tx:(handover:net),net:(worker_threads:2))"
"""The thread that takes in the messages of one link may have to wait for another; the rest go on meanwhile."""


def use_those_of_a_router() -> None:
    """Start those of a router in this process; what the user has set stays."""
    if os.environ.get(VARIABLE, OF_A_NODE) == OF_A_NODE:
        os.environ[VARIABLE] = OF_A_ROUTER
