"""`robo param`: printing and changing parameters of running nodes."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import zenoh

from robo.cli.connection import connect_to_robot, nodes_of
from robo.cli.link import watched
from robo.cli.printing import clock_time, hint, note, print_json, print_line, print_text, write_file
from robo.cli.reach import Reach
from robo.errors import NodeUnreachable, UsageError
from robo.parameters.hints import range_text
from robo.parameters.words import sorted_out
from robo.samples.stream import Stream
from robo.text.unreadable import UNREADABLE
from robo.tools import nodes, parameters
from robo.tools.parameters import Described
from robo.wire.keys import PARAMETER_EVENTS_TOPIC, NodeToken
from robo_messages import ParameterEvent


def print_list(node: str | None, reach: Reach, *, json: bool) -> None:
    """Print the parameters of one node or of all, with their values."""
    with connect_to_robot(reach) as session:
        found, silent = _read(session, node, reach)
    if json:
        print_json(found)
    else:
        for name, values in found.items():
            print_line(name)
            width = max(map(len, values), default=0)
            for parameter, value in values.items():
                print_line(f"  {parameter:{width}} = {_text(value)}")
    _complain_of(silent)


def print_values(node: str, names: Sequence[str], reach: Reach, *, json: bool) -> None:
    """Print single values, without anything around them."""
    with connect_to_robot(reach) as session:
        values = parameters.get(session, _find(session, node, reach), names)
    if json:
        print_json(values)
    else:
        for name in names:
            print_line(_text(values[name]))


def set_values(node: str, words: Sequence[str], reach: Reach) -> None:
    """`NAME VALUE`, or several `NAME:=VALUE`.

    Raises:
        UsageError: the words are neither.
        ParameterError: the node refuses; nothing is set.
    """
    others, texts = sorted_out(words)
    if others and len(words) == 2:
        texts = {words[0]: words[1]}
    elif others:
        raise UsageError("write NAME VALUE, or several NAME:=VALUE")
    with connect_to_robot(reach) as session:
        token = _find(session, node, reach)
        described = parameters.describe(session, token)
        changes = {name: parameters.typed(described, name, text) for name, text in texts.items()}
        parameters.set_all(session, token, changes)
        for name, value in parameters.get(session, token, list(changes)).items():
            print_line(f"{token.full_name}: {name} = {_text(value)}")


def print_descriptions(node: str, names: Sequence[str], reach: Reach, *, json: bool) -> None:
    """Print type, range, unit, default and description."""
    with connect_to_robot(reach) as session:
        described = parameters.describe(session, _find(session, node, reach), names)
    if json:
        print_json(described)
        return
    for one in described:
        print_line(f"{one.name} = {_text(one.value)}")
        for label, text in _facts(one):
            if text:
                print_line(f"  {label:11} {text}")


def dump(node: str | None, reach: Reach, *, every: bool, file: Path | None) -> None:
    """Write the values of one node or of all as a parameter file.

    Raises:
        UsageError: neither a node nor all is said, or both; or the file cannot be written.
    """
    if every == (node is not None):
        raise UsageError("name a node, or say --all")
    with connect_to_robot(reach) as session:
        found, silent = _read(session, node, reach)
    text = parameters.to_yaml(found)
    if file is None:
        print_text(text.rstrip())
    else:
        write_file(text, file)
        hint(f"{len(found)} nodes in {file}")
    _complain_of(silent)


def load(node: str, file: str, reach: Reach) -> None:
    """Set what a parameter file says of a node: all of it, or nothing."""
    with connect_to_robot(reach) as session:
        token = _find(session, node, reach)
        values, warnings = parameters.from_file(file, token)
        for warning in warnings:
            note(f"warning: {warning}")
        before = parameters.get(session, token)
        parameters.set_all(session, token, values)
        after = parameters.get(session, token)
    changed = [name for name in after if after[name] != before[name]]
    for name in changed:
        print_line(f"{token.full_name}: {name} = {_text(after[name])}")
    if not changed:
        print_line(f"{token.full_name}: nothing changed")


def explain(node: str, names: Sequence[str], reach: Reach, *, json: bool) -> None:
    """Print everything that was said of parameters, and what won."""
    with connect_to_robot(reach) as session:
        said = parameters.explain(session, _find(session, node, reach), names)
    if json:
        print_json(said)
        return
    for name, sources in said.items():
        print_line(f"{name} = {_text(sources[-1].value)}")
        for one in sources:
            mark = "*" if one is sources[-1] else " "
            print_line(f"  {mark} {_text(one.value):12} {one.source}")


def watch(node: str | None, reach: Reach, *, json: bool) -> None:
    """Print changes as they come."""
    with connect_to_robot(reach) as session, watched(session, reach):
        wanted = _find(session, node, reach).full_name if node else None
        stream = Stream(session, [reach.key(f"**/{PARAMETER_EVENTS_TOPIC}")])
        hint("waiting for changes …")
        for arrival in stream.until(None):
            try:
                event = msgspec.msgpack.decode(arrival.sample.payload.to_bytes(), type=ParameterEvent)
            except UNREADABLE:
                continue  # somebody else's topic
            if wanted is not None and event.node != wanted:
                continue
            when = arrival.attachment.source_time if arrival.attachment is not None else arrival.arrived
            for change in event.changed_parameters:
                if json:
                    print_json({"time": when, "node": event.node, "name": change.name, "value": change.value})
                else:
                    print_line(f"{clock_time(when)} {event.node}: {change.name} = {_text(change.value)}")


def _find(session: zenoh.Session, node: str, reach: Reach) -> NodeToken:
    return nodes.find_node(nodes_of(session, reach, inactive=True), node)


def _read(
    session: zenoh.Session, node: str | None, reach: Reach
) -> tuple[dict[str, dict[str, object]], list[NodeUnreachable]]:
    """The values of one node or of all, and which did not answer."""
    wanted = [_find(session, node, reach)] if node else nodes_of(session, reach, inactive=True)
    found: dict[str, dict[str, object]] = {}
    silent: list[NodeUnreachable] = []
    for token in wanted:
        try:
            found[token.full_name] = parameters.get(session, token)
        except NodeUnreachable as error:
            silent.append(error)
    return found, silent


def _complain_of(silent: Sequence[NodeUnreachable]) -> None:
    if silent:
        raise NodeUnreachable("\n".join(map(str, silent)))


def _facts(one: Described) -> list[tuple[str, str]]:
    rest = {k: v for k, v in one.constraints.items() if k not in ("gt", "ge", "lt", "le")}
    return [
        ("description", one.description),
        ("type", one.type),
        ("unit", one.unit),
        ("range", range_text(one.constraints)),
        ("default", _text(one.default)),
        *((key.replace("_", " "), str(value)) for key, value in rest.items()),
        ("read-only", "start the node with another value to change it" if one.read_only else ""),
    ]


def _text(value: object) -> str:
    if isinstance(value, str):
        return value if value and value == value.strip() else repr(value)
    if isinstance(value, bool) or value is None:
        return str(value).lower()
    return repr(value)
