"""`robo param`: printing and changing parameters of running nodes."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import zenoh

from robo.cli.connection import connect_to_robot, nodes_of, see_that_it_obeys
from robo.cli.link import watched
from robo.cli.printing import (
    clock_time,
    hint,
    note,
    paint,
    print_json,
    print_line,
    print_lines,
    print_table,
    print_text,
    write_file,
)
from robo.cli.reach import Reach
from robo.errors import NodeUnreachable, UsageError
from robo.parameters.hints import range_text
from robo.parameters.words import sorted_out
from robo.samples.stream import Stream
from robo.text import colours
from robo.text.readable import readable
from robo.text.terminal import visible
from robo.text.unreadable import UNREADABLE
from robo.tools import nodes, parameters, parameters_of_many
from robo.tools.parameters import Described
from robo.tools.parameters_of_many import Answer, is_pattern
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


def print_values(node: str, names: Sequence[str], reach: Reach, *, json: bool) -> int:
    """Print single values, without anything around them; of several nodes as a table.

    Returns:
        The exit code: 1 where one of several nodes did not tell.
    """
    with connect_to_robot(reach) as session:
        timeout = reach.timeout
        if is_pattern(node):
            asked = _meant(session, node, reach)
            answers = parameters_of_many.each(asked, lambda one: parameters.get(session, one, names, timeout))
            return _print_answers(answers, json=json)
        values = parameters.get(session, _find(session, node, reach), names, timeout)
    if json:
        print_json(values)
    else:
        for name in names:
            print_line(_text(values[name]))
    return 0


def set_values(node: str, words: Sequence[str], reach: Reach, *, dry_run: bool, json: bool) -> int:
    """`NAME VALUE`, or several `NAME:=VALUE`, at one node or at each that a pattern matches.

    Returns:
        The exit code: 1 where one of several nodes refused, or did not answer.

    Raises:
        UsageError: the words are neither.
        ParameterError: the only node refuses; nothing is set.
    """
    others, texts = sorted_out(words)
    if others and len(words) == 2:
        texts = {words[0]: words[1]}
    elif others:
        raise UsageError("write NAME VALUE, or several NAME:=VALUE")
    with connect_to_robot(reach) as session:
        if is_pattern(node) or dry_run or json:
            asked = _meant(session, node, reach)
            if dry_run:
                _print_asked(asked, json=json)
                return 0
            ask = parameters_of_many.setter(session, texts, reach.timeout)
            return _print_answers(parameters_of_many.each(asked, ask), json=json)
        token = _find(session, node, reach)
        see_that_it_obeys(session, reach, token.full_name)
        described = parameters.describe(session, token, timeout=reach.timeout)
        changes = {name: parameters.typed(described, name, text) for name, text in texts.items()}
        parameters.set_all(session, token, changes, reach.timeout)
        for name, value in parameters.get(session, token, list(changes), reach.timeout).items():
            print_line(f"{token.full_name}: {name} = {_text(value)}")
    return 0


def _print_asked(asked: Sequence[NodeToken], *, json: bool) -> None:
    """Who would be asked."""
    found = [token.full_name for token in asked]
    if json:
        print_json(found)
        return
    for name in found:
        print_line(name)
    note(f"{_nodes(len(found))} would be asked; without --dry-run they are")


def _print_answers(answers: Sequence[Answer], *, json: bool) -> int:
    """What each of several nodes has answered. Returns the exit code."""
    if json:
        print_json(answers)
    else:
        print_table([("NODE", "ANSWER", "SAYS"), *(row for answer in answers for row in _rows(answer))])
        said = [answer.answer for answer in answers]
        counted = ", ".join(f"{said.count(word)} {word}" for word in _COLOURS if word in said)
        note(f"{_nodes(len(answers))}: {counted}")
    return 0 if all(answer.answer == "ok" for answer in answers) else 1


_COLOURS = {"ok": colours.GREEN, "refused": colours.RED, "silent": colours.RED}


def _rows(answer: Answer) -> list[tuple[str, str, str]]:
    values = [f"{name} = {_text(value)}" for name, value in answer.values.items()]
    reasons = [line.removeprefix(f"{answer.node}").lstrip(": ") for line in answer.reason.splitlines()]
    return [(answer.node, paint(answer.answer, _COLOURS[answer.answer]), visible(says)) for says in values or reasons]


def _nodes(count: int) -> str:
    return "1 node" if count == 1 else f"{count} nodes"


def print_descriptions(node: str, names: Sequence[str], reach: Reach, *, json: bool) -> int:
    """Print type, range, unit, default and description; of several nodes one after the other.

    Returns:
        The exit code: 1 where one of several nodes did not tell.
    """
    with connect_to_robot(reach) as session:
        if is_pattern(node):

            def ask(one: NodeToken) -> dict[str, object]:
                found = parameters.describe(session, one, names, reach.timeout)
                return {described.name: described for described in found}

            answers = parameters_of_many.each(_meant(session, node, reach), ask)
            return _print_all_described(answers, json=json)
        described = parameters.describe(session, _find(session, node, reach), names, reach.timeout)
    if json:
        print_json(described)
    else:
        _print_described(described, "")
    return 0


def _print_all_described(answers: Sequence[Answer], *, json: bool) -> int:
    if json:
        print_json(answers)
    for answer in answers if not json else ():
        print_line(answer.node)
        _print_described([one for one in answer.values.values() if isinstance(one, Described)], "  ")
        print_lines(f"  {line}" for line in answer.reason.splitlines())
    return 0 if all(answer.answer == "ok" for answer in answers) else 1


def _print_described(described: Sequence[Described], indent: str) -> None:
    for one in described:
        print_line(f"{indent}{one.name} = {_text(one.value)}")
        for label, text in _facts(one):
            if text:
                print_line(f"{indent}  {label:11} {text}")


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
        see_that_it_obeys(session, reach, token.full_name)
        values, warnings = parameters.from_file(file, token)
        for warning in warnings:
            note(f"warning: {warning}")
        before = parameters.get(session, token, timeout=reach.timeout)
        parameters.set_all(session, token, values, reach.timeout)
        after = parameters.get(session, token, timeout=reach.timeout)
    changed = [name for name in after if after[name] != before[name]]
    for name in changed:
        print_line(f"{token.full_name}: {name} = {_text(after[name])}")
    if not changed:
        print_line(f"{token.full_name}: nothing changed")


def explain(node: str, names: Sequence[str], reach: Reach, *, json: bool) -> None:
    """Print everything that was said of parameters, and what won."""
    with connect_to_robot(reach) as session:
        said = parameters.explain(session, _find(session, node, reach), names, reach.timeout)
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
        wanted = {one.full_name for one in _meant(session, node, reach)} if node else None
        stream = Stream(session, [reach.key(f"**/{PARAMETER_EVENTS_TOPIC}")])
        hint("waiting for changes …")
        for arrival in stream.until(None):
            try:
                event = msgspec.msgpack.decode(arrival.sample.payload.to_bytes(), type=readable(ParameterEvent))
            except UNREADABLE:
                continue  # somebody else's topic
            if wanted is not None and event.node not in wanted:
                continue
            when = arrival.attachment.source_time if arrival.attachment is not None else arrival.arrived
            for change in event.changed_parameters:
                if json:
                    print_json({"time": when, "node": event.node, "name": change.name, "value": change.value})
                else:
                    print_line(f"{clock_time(when)} {event.node}: {change.name} = {_text(change.value)}")


def _find(session: zenoh.Session, node: str, reach: Reach) -> NodeToken:
    return nodes.find_node(nodes_of(session, reach, inactive=True), node)


def _meant(session: zenoh.Session, node: str, reach: Reach) -> list[NodeToken]:
    """The nodes that a pattern matches, or the one that a name means."""
    there = nodes_of(session, reach, inactive=True)
    if not is_pattern(node):
        return [nodes.find_node(there, node)]
    return parameters_of_many.meant(there, node, reach.namespace)


def _read(
    session: zenoh.Session, node: str | None, reach: Reach
) -> tuple[dict[str, dict[str, object]], list[NodeUnreachable]]:
    """The values of one node, of those that a pattern matches or of all, and which did not answer."""
    wanted = _meant(session, node, reach) if node else nodes_of(session, reach, inactive=True)
    answers = parameters_of_many.each(wanted, lambda one: parameters.get(session, one, timeout=reach.timeout))
    found = {answer.node: answer.values for answer in answers if answer.answer == "ok"}
    return found, [NodeUnreachable(answer.reason) for answer in answers if answer.answer != "ok"]


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
