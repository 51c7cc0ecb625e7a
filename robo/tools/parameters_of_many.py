"""Parameters of many nodes: each is asked on exactly its own key, some at a time, and what each said is told.

A query with wildcards would run nothing, by design (`wire.queries`): so whoever sets something says of whom.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import msgspec
import zenoh

from robo.errors import NodeNotFound, NodeUnreachable, ParameterError
from robo.text.patterns import matcher
from robo.text.suggestions import suggest
from robo.tools import parameters
from robo.wire.keys import NodeToken

AT_ONCE = 16
"""How many nodes are asked at the same time."""


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """What one of many nodes has answered."""

    node: str
    """The full name."""
    answer: Literal["ok", "refused", "silent"]
    values: dict[str, object] = {}
    """By parameter: what it is, or all that is known of it."""
    reason: str = ""
    """Why there are none."""


def is_pattern(name: str) -> bool:
    """Whether a name means whichever nodes it matches, rather than one."""
    return "*" in name


def meant(there: Sequence[NodeToken], pattern: str, robot: str = "") -> list[NodeToken]:
    """The nodes whose full names a pattern matches, as topics are (`text.patterns`). Pure.

    Args:
        there: all nodes.
        pattern: such as `r*/velocity_controller`, or `**/base`.
        robot: a namespace that it may leave out.

    Raises:
        UsageError: the pattern makes no sense.
        NodeNotFound: nobody is meant; says who might be.
    """
    is_meant = matcher([pattern], robot=robot, what="node")
    found = [token for token in there if is_meant(token.full_name.strip("/"))]
    if found:
        return found
    names = [token.full_name.strip("/") for token in there]
    deeper = f"**/{pattern.strip('/')}"
    if any(map(matcher([deeper], what="node"), names)):
        raise NodeNotFound(f"no node matches {pattern}; patterns are of full names: did you mean '{deeper}'?")
    raise NodeNotFound(f"no node matches {pattern}; {suggest(pattern, names)}")


def each(nodes: Sequence[NodeToken], ask: Callable[[NodeToken], Mapping[str, object]]) -> list[Answer]:
    """Ask each of some nodes, several at a time; the answers are in their order.

    Args:
        nodes: who is asked.
        ask: asks one, from any thread; what it raises of `ParameterError` and `NodeUnreachable` is the answer.
    """

    def answer(node: NodeToken) -> Answer:
        try:
            return Answer(node=node.full_name, answer="ok", values=dict(ask(node)))
        except ParameterError as error:
            return Answer(node=node.full_name, answer="refused", reason=str(error))
        except NodeUnreachable as error:
            return Answer(node=node.full_name, answer="silent", reason=str(error))

    with ThreadPoolExecutor(AT_ONCE) as some:
        try:
            return list(some.map(answer, nodes))
        except BaseException:  # Ctrl-C: who has not been asked is not asked any more
            some.shutdown(wait=False, cancel_futures=True)
            raise


def setter(
    session: zenoh.Session, texts: Mapping[str, str], timeout: float
) -> Callable[[NodeToken], dict[str, object]]:
    """What sets parameters of a node, all of them or none, and returns what they are then.

    Args:
        session: the network.
        texts: values as on a command line, by parameter; each node's own types decide what they mean.
        timeout: how long a node may take for each answer, s.
    """

    def set_them(node: NodeToken) -> dict[str, object]:
        described = parameters.describe(session, node, timeout=timeout)
        changes = {name: parameters.typed(described, name, text) for name, text in texts.items()}
        try:
            parameters.set_all(session, node, changes, timeout)
        except NodeUnreachable as error:
            raise NodeUnreachable(f"{error} It may have set them all the same.") from None
        try:
            return parameters.get(session, node, list(changes), timeout)
        except NodeUnreachable:  # it has said that it took them
            return changes

    return set_them
