"""Where a tool looks for robots: where it is told, else where those of its user are."""

import os
import time
from collections.abc import Sequence

import msgspec

from robo.environment import CONNECT_VARIABLE
from robo.wire import knocking, listeners, meeting
from robo.wire.network import RENDEZVOUS, SECURED_RENDEZVOUS, Network

_ANSWERS_WITHIN = 0.5
"""How long somebody on this machine who is busy may take to let one in, s."""


def is_told(connect: Sequence[str]) -> bool:
    """Whether options or the environment say where."""
    return bool(connect or os.environ.get(CONNECT_VARIABLE))


def of_tool(connect: Sequence[str], handing_over: float) -> Network:
    """The network that a tool joins as a client.

    Without a word that is where the robots of its user meet. Where there is none, it is the rendezvous, if somebody
    listens there: a robot in a container, or one of another user's, to look at; with security on by TLS.

    Args:
        connect: where options say.
        handing_over: how long a robot of this user that has just left may take to hand over where it was met, s.

    Raises:
        NetworkError: the folder in which this user's robots meet is not to be trusted.
    """
    network = Network.from_environment("client", connect)
    if is_told(connect) or is_own_there(handing_over):
        return network
    door = door_of(network)
    if next(knocking.answering([door], _ANSWERS_WITHIN), None) is None:
        return network
    return msgspec.structs.replace(network, connect=(door,))


def door_of(network: Network) -> str:
    """Where a tool of a network finds robots that are not its user's own, on this machine."""
    return SECURED_RENDEZVOUS if network.security else RENDEZVOUS


def is_own_there(handing_over: float) -> bool:
    """Whether a robot of this user's is met; waits for one that takes the place over from one that has left."""
    end = time.monotonic() + handing_over
    while meeting.is_met():
        if next(knocking.answering([meeting.endpoint()], _ANSWERS_WITHIN), None) is not None:
            return True
        if time.monotonic() >= end:
            break
        time.sleep(0.02)
    return False


def whose(network: Network, connect: Sequence[str]) -> str | None:
    """The name of another user whose robots are looked at, for want of one's own; None where that is not so."""
    door = door_of(network)
    return None if is_told(connect) or network.connect != (door,) else listeners.owner_of(door)
