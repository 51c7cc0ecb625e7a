"""Parameters of running nodes, over the network."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

import msgspec
import zenoh

from robo.errors import NodeUnreachable, ParameterError
from robo.parameters import files as parameter_files
from robo.text.paths import nested
from robo.text.readable import readable
from robo.text.tree import Problem
from robo.text.unreadable import UNREADABLE
from robo.wire import doors
from robo.wire.keys import NodeToken, parameters_key
from robo.wire.queries import Fault, first_answer
from robo.wire.reports import Result, Setting

T = TypeVar("T")

TIMEOUT = 2.0
"""How long a node may take to answer, s: a machine may be busy."""


class Described(msgspec.Struct, frozen=True):
    """A parameter of a running node."""

    name: str
    type: str
    value: object
    default: object
    description: str
    unit: str
    constraints: dict[str, float | int | str]
    read_only: bool


def get(
    session: zenoh.Session, node: NodeToken, names: Sequence[str] = (), timeout: float = TIMEOUT
) -> dict[str, object]:
    """Values by name; all where no names are given. The node may take `timeout` seconds to answer.

    Raises:
        NodeUnreachable: the node does not answer.
        ParameterError: it has no such parameter.
    """
    return _complete(node, names, _ask(session, node, "get", _named(names), dict[str, object], timeout))


def describe(
    session: zenoh.Session, node: NodeToken, names: Sequence[str] = (), timeout: float = TIMEOUT
) -> list[Described]:
    """All that is known of parameters. Raises as `get`."""
    return list(_ask(session, node, "describe", _named(names), dict[str, Described], timeout).values())


def explain(
    session: zenoh.Session, node: NodeToken, names: Sequence[str] = (), timeout: float = TIMEOUT
) -> dict[str, list[Setting]]:
    """Everything that was said of parameters, from the weakest to what holds. Raises as `get`."""
    said = _ask(session, node, "explain", _named(names), dict[str, list[Setting]], timeout)
    return _complete(node, names, {name: sources for name, sources in said.items() if sources})


def set_all(session: zenoh.Session, node: NodeToken, changes: Mapping[str, object], timeout: float = TIMEOUT) -> None:
    """Set several parameters, all or none.

    Raises:
        NodeUnreachable: the node does not answer.
        ParameterError: it refuses; says why.
    """
    result = _ask(session, node, "set", dict(changes), Result, timeout)
    if not result.successful:
        raise ParameterError(result.reason)


def typed(described: Iterable[Described], name: str, text: str) -> object:
    """A value from a command line: text stays text where the parameter is text.

    Raises:
        ParameterError: a list, map or quote is not closed.
    """
    from robo.parameters.words import parse_value

    types = {one.name: one.type for one in described}
    return text if types.get(name) == "str" else parse_value(text)


def from_file(path: str, node: NodeToken) -> tuple[dict[str, object], tuple[Problem, ...]]:
    """What a parameter file says of a node, and where the file contradicts itself.

    Raises:
        ParameterFileError: it is missing or has mistakes.
        ParameterError: it says nothing of this node.
    """
    file = parameter_files.load(path)
    values = file.values_for(node.namespace, node.node)
    if not values:
        raise ParameterError(f"{path} says nothing of {node.full_name}")
    return values, file.warnings


def to_yaml(dumped: Mapping[str, Mapping[str, object]]) -> str:
    """Values by node's full name and parameter as a file that `robo up` and ROS 2 read."""
    from robo.text.yaml_tree import as_yaml

    tree = {node: {parameter_files.ROS_KEY: nested(values, ".")} for node, values in dumped.items()}
    return as_yaml(tree)


def _complete(node: NodeToken, names: Sequence[str], found: dict[str, T]) -> dict[str, T]:
    """An answer that has all that was asked for: it may be a stranger's."""
    lacking = [name for name in names if name not in found]
    if lacking:
        raise ParameterError(f"the answer of {node.full_name} cannot be read: it lacks {', '.join(lacking)}")
    return found


def _named(names: Sequence[str]) -> dict[str, object] | None:
    return {"names": list(names)} if names else None


def _ask(session: zenoh.Session, node: NodeToken, verb: str, request: object, kind: type[T], timeout: float) -> T:
    key = parameters_key(node.namespace, node.node, verb)
    payload = msgspec.msgpack.encode(request) if request is not None else None
    answer = first_answer(session.get(key, payload=payload, timeout=timeout))
    if isinstance(answer, Fault):
        raise ParameterError(answer.message)
    if answer is not None:
        try:
            return msgspec.msgpack.decode(answer.payload.to_bytes(), type=readable(kind))
        except UNREADABLE as error:
            raise ParameterError(f"the answer of {node.full_name} cannot be read: {error}") from None
    doors.check(session, node.namespace, timeout)
    raise NodeUnreachable(f"{node.full_name} did not answer within {timeout:g} s; is a callback of it stuck?")
