"""Managed nodes: which there are, in which states they are, and taking them from one to another."""

import time
from typing import TypeVar

import msgspec
import zenoh

from robo.errors import LifecycleError, NodeNotFound, NodeUnreachable, ServiceTimeout
from robo.node import services
from robo.text.suggestions import suggest
from robo.tools.nodes import STATE, is_managed
from robo.wire import codec
from robo.wire.codec import Decoder, Malformed
from robo.wire.discovery import tokens
from robo.wire.keys import EndpointToken
from robo_messages import Message
from robo_messages import lifecycle as wire

A = TypeVar("A", bound=Message)


class Way(msgspec.Struct, frozen=True):
    """A transition, and where it leads."""

    label: str
    id: int
    start: str
    """The state in which it begins."""
    goal: str
    """The state to which it leads first."""


class Change(msgspec.Struct, frozen=True):
    """What came of a transition."""

    node: str
    """The full name."""
    success: bool
    """Whether its hook succeeded."""
    state: str
    """That of now; empty for a node that has ended with it."""


def managed_nodes(session: zenoh.Session, timeout: float) -> list[str]:
    """The full names of managed nodes, active or not, sorted."""
    ends = (token for token in tokens(session, timeout) if isinstance(token, EndpointToken))
    return sorted({one.full_name for one in ends if is_managed(one)})


def find(names: list[str], name: str) -> str:
    """The managed node that somebody means: its full name, or its name where only one has it.

    Raises:
        NodeNotFound: there is none, or several; says what there is.
    """
    wanted = name.strip("/")
    same = [one for one in names if one.strip("/") == wanted] or [one for one in names if one.split("/")[-1] == wanted]
    if len(same) == 1:
        return same[0]
    if same:
        raise NodeNotFound(f"several managed nodes are named {name}: {', '.join(same)}")
    known = [one.strip("/") if "/" in wanted else one.split("/")[-1] for one in names]
    raise NodeNotFound(f"there is no managed node {name}; {suggest(wanted, known)}")


def state(session: zenoh.Session, node: str, timeout: float) -> wire.State:
    """The state of a managed node.

    Raises:
        NodeUnreachable: it does not answer.
    """
    return _ask(session, node, STATE, wire.GetState.Request(), wire.GetState.Response, timeout).current_state


def ways(session: zenoh.Session, node: str, timeout: float, *, every: bool = False) -> list[Way]:
    """The transitions that begin in a node's present state, or all.

    Raises:
        NodeUnreachable: it does not answer.
    """
    request, response = wire.GetAvailableTransitions.Request(), wire.GetAvailableTransitions.Response
    answer = _ask(session, node, GRAPH if every else TRANSITIONS, request, response, timeout)
    return [
        Way(one.transition.label, one.transition.id, one.start_state.label, one.goal_state.label)
        for one in answer.available_transitions
    ]


def change(session: zenoh.Session, node: str, wanted: str, timeout: float, patience: float) -> Change:
    """Take a managed node through a transition.

    Args:
        session: the network.
        node: its full name.
        wanted: the label of the transition, or its id.
        timeout: how long to wait for what it answers at once, s.
        patience: how long its hook may take, s.

    Raises:
        LifecycleError: the transition does not begin in its present state; says which do.
        NodeUnreachable: it does not answer.
    """
    possible = ways(session, node, timeout)
    way = next((one for one in possible if wanted in (one.label, str(one.id))), None)
    if way is None:
        now = state(session, node, timeout).label
        can = " or ".join(one.label for one in possible if one.id < _FIRST_PRIVATE) or "do nothing else now"
        raise LifecycleError(f"{node} is {now} and cannot {wanted}; it can {can}")
    request = wire.ChangeState.Request(transition=wire.Transition(id=way.id, label=way.label))
    success = _ask(session, node, CHANGE, request, wire.ChangeState.Response, patience).success
    try:
        now = state(session, node, timeout).label
    except NodeUnreachable:  # it has come to its end, and is gone
        now = ""
    return Change(node, success, now)


CHANGE, TRANSITIONS, GRAPH = (
    "change_state",
    "get_available_transitions",
    "get_transition_graph",
)
_FIRST_PRIVATE = 10
"""From this id on transitions follow from hooks, and nobody can ask for them."""


def _key(node: str, service: str) -> str:
    return f"{node.strip('/')}/{service}"


def _ask(session: zenoh.Session, node: str, service: str, request: Message, response: type[A], timeout: float) -> A:
    payload = msgspec.msgpack.encode(request), codec.pack_attachment(1, time.time_ns())
    encoding = codec.encoding_of(type(request))
    try:
        sample = services.ask(session, _key(node, service), payload, encoding, timeout, timeout)
        return Decoder(response).decode(sample.payload.to_bytes(), str(sample.encoding))
    except ServiceTimeout:
        raise NodeUnreachable(f"{node} did not answer within {timeout:g} s") from None
    except Malformed as error:
        raise NodeUnreachable(f"{node} answers with something else: {error}") from None
