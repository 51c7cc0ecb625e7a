"""`robo service`: which services there are, and calling them."""

import sys
import time
from collections.abc import Sequence

import msgspec
import zenoh

import robo_messages
from robo import codec, services
from robo.cli.connection import connect_to_robot, print_json, print_line, print_table
from robo.errors import ServiceTimeout, UsageError
from robo.names import key_of
from robo.parameters import parse_value
from robo.tools import nodes
from robo.tools.nodes import ServiceInfo


def print_services(*, json: bool, connect: Sequence[str]) -> None:
    """Print the table of services."""
    with connect_to_robot(connect) as session:
        found = nodes.list_services(session)
    if json:
        for one in found:
            print_json(one)
    elif not found:
        print("no services", file=sys.stderr)
    else:
        rows = [("SERVICE", "TYPE", "SERVER"), *((s.key, s.type, ", ".join(s.servers)) for s in found)]
        print_table(rows)


def print_type(key: str, *, connect: Sequence[str]) -> None:
    """Print the type of a service."""
    with connect_to_robot(connect) as session:
        print_line(_find(session, key).type)


def print_info(key: str, *, json: bool, connect: Sequence[str]) -> None:
    """Print who serves a service, and what it takes and returns."""
    with connect_to_robot(connect) as session:
        found = _find(session, key)
    halves = dict(zip(("request", "response"), robo_messages.halves_of(found.type), strict=True))
    if json:
        print_json({"key": found.key, "type": found.type, "servers": found.servers, **halves})
        return
    print_line(f"{found.key}  {found.type}")
    print_line(f"  served by {', '.join(found.servers)}")
    for label, name in halves.items():
        print_line(f"  {label:8}  {_shape(name)}")


def call(key: str, request: str | None, *, timeout: float, json: bool, connect: Sequence[str]) -> None:
    """Call a service and print its answer.

    Raises:
        UsageError: the request is no map, or not one of the service's type.
        ServiceError: the service refuses, or nobody answers.
    """
    with connect_to_robot(connect) as session:
        found = _find(session, key)
        asked, _ = robo_messages.halves_of(found.type)
        attachment = codec.pack_attachment(1, time.time_ns())
        payload = _request(asked, request)
        sample = services.ask(session, found.key, (payload, attachment), f"{codec.MSGPACK};{asked}", timeout, timeout)
    answer = codec.decode_any(sample.payload.to_bytes())
    if json:
        print_json(answer)
    elif isinstance(answer, dict) and answer:
        for name, value in answer.items():
            print_line(f"{name}: {value}")
    else:
        print_line("done")


def _request(type_name: str, text: str | None) -> bytes:
    """A request from YAML or JSON, checked where its type is known here."""
    value = parse_value(text) if text else {}
    if not isinstance(value, dict):
        raise UsageError(f"a request is a map, for example '{{data: true}}', not {text}")
    try:
        type_ = robo_messages.find_type(type_name)
    except robo_messages.UnknownType:
        return msgspec.msgpack.encode(value)  # a user's own type: its server checks it
    try:
        return msgspec.msgpack.encode(msgspec.convert(value, type_))
    except msgspec.ValidationError as error:
        raise UsageError(f"{type_name}: {str(error).replace('`', '')}; it has {_shape(type_name)}") from None


def _shape(type_name: str) -> str:
    """A message type in a line: its fields with their types."""
    try:
        type_ = robo_messages.find_type(type_name)
    except robo_messages.UnknownType:
        return type_name
    fields = ", ".join(f"{f.name}: {getattr(f.type, '__name__', f.type)}" for f in msgspec.structs.fields(type_))
    return f"{type_name} {{{fields}}}"


def _find(session: zenoh.Session, key: str) -> ServiceInfo:
    import difflib

    wanted = key_of(key)
    found = nodes.list_services(session)
    for one in found:
        if one.key == wanted:
            return one
    close = difflib.get_close_matches(wanted, [one.key for one in found], n=1)
    hint = f"did you mean {close[0]}?" if close else f"there is {', '.join(one.key for one in found) or 'none'}"
    raise ServiceTimeout(f"nobody serves {wanted}; {hint}")
