"""`robo service`: what a service takes, and calling it."""

import re
import time
from collections.abc import Sequence

import msgspec

import robo_messages
from robo.cli.connection import connect_to_robot, see_that_it_obeys
from robo.cli.printing import print_json, print_line
from robo.cli.reach import Reach
from robo.errors import UsageError
from robo.interfaces import catalogue
from robo.interfaces.message_input import field_types, message_of
from robo.node import services
from robo.parameters.words import parse_value
from robo.tools import offers
from robo.wire import codec
from robo.wire.qos import QoS


def print_type(name: str, reach: Reach) -> None:
    """Print the type of a service."""
    wanted = reach.key(name)
    with connect_to_robot(reach) as session:
        print_line(offers.find_service(session, wanted, reach.timeout).type)


def print_info(name: str, reach: Reach, *, json: bool) -> None:
    """Print who serves a service, and what it takes and returns."""
    wanted = reach.key(name)
    with connect_to_robot(reach) as session:
        found = offers.find_service(session, wanted, reach.timeout)
    halves = dict(zip(("request", "response"), robo_messages.halves_of(found.type), strict=True))
    if json:
        print_json({"key": found.key, "type": found.type, "servers": found.servers, **halves})
        return
    print_line(f"{found.key}  {found.type}")
    print_line(f"  served by {', '.join(found.servers)}")
    for label, name in halves.items():
        print_line(f"  {label:8}  {shape(name)}")


def call(name: str, words: Sequence[str], reach: Reach, *, timeout: float, json: bool) -> None:
    """Call a service and print its answer.

    Args:
        name: the service's.
        words: the request, its type before it or not; both may be left out.
        reach: where it is.
        timeout: how long to wait for the answer, s.
        json: print JSON.

    Raises:
        UsageError: the request is no map, or the type is not the service's.
        MessageError: it is not one of the service's type.
        ServiceError: the service refuses, or nobody answers.
    """
    wanted = reach.key(name)
    type_name, request = type_and_data(words, "a request", "{data: true}")
    with connect_to_robot(reach) as session:
        found = offers.find_service(session, wanted, reach.timeout)
        if type_name not in (None, found.type):
            raise UsageError(f"{found.key} is a {found.type}, not a {type_name}; its type need not be said")
        see_that_it_obeys(session, reach, found.key)
        asked, _ = robo_messages.halves_of(found.type)
        attachment = codec.pack_attachment(1, time.time_ns())
        payload = msgspec.msgpack.encode(data_of(asked, request, "a request"))
        encoding = f"{codec.MSGPACK};{asked}"
        # A person's call goes first: it may be an emergency stop.
        sample = services.ask(
            session, found.key, (payload, attachment), encoding, timeout, timeout, QoS.COMMAND.priority
        )
    answer = codec.decode_any(sample.payload.to_bytes())
    if json:
        print_json(answer)
    elif isinstance(answer, dict) and answer:
        for name, value in answer.items():
            print_line(f"{name}: {value}")
    else:
        print_line("done")


def type_and_data(words: Sequence[str], what: str, example: str) -> tuple[str | None, str | None]:
    """The type and the data that somebody has typed, each where it was; `what` and an `example` are for the error.

    Raises:
        UsageError: there are too many words.
    """
    if len(words) > 2:
        raise UsageError(f"expected {what}, for example '{example}', in quotes; got {len(words)} words")
    if len(words) == 1:
        return (words[0], None) if _TYPE.fullmatch(words[0]) else (None, words[0])
    return (words[0], words[1]) if words else (None, None)


_TYPE = re.compile(r"[A-Za-z_]\w*/[A-Za-z_]\w*")


def data_of(type_name: str, text: str | None, what: str) -> object:
    """A message from YAML or JSON, checked where its type is known here; else plain data, which its server checks.

    Raises:
        UsageError: it is no map.
        MessageError: it is not of that type.
    """
    value = parse_value(text) if text else {}
    if not isinstance(value, dict):
        raise UsageError(f"{what} is a map, for example '{{name: value}}', not {text}")
    type_ = catalogue.find_here(type_name)
    return value if type_ is None else message_of(type_, value)


def shape(type_name: str) -> str:
    """A message type in a line: its fields with their types."""
    type_ = catalogue.find_here(type_name)
    if type_ is None:
        return type_name
    return f"{type_name} {{{', '.join(f'{name}: {kind}' for name, kind in field_types(type_).items())}}}"
