"""`robo bag snapshot`: asking a flight recorder for a file."""

import msgspec
import zenoh

from robo.cli.connection import connect_to_robot, see_that_it_obeys
from robo.cli.printing import data_size, hint, print_json, print_line
from robo.cli.reach import Reach
from robo.errors import FlightRecorderError, UsageError
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.tools import offers
from robo.tools.long_calls import answer_of
from robo.tools.offers import Offer
from robo.wire import codec
from robo.wire.long_query import Gone
from robo.wire.queries import Fault
from robo_messages import Snapshot, TakeSnapshot, service_type_name, type_name

_LONGEST = 1500.0
"""How long a file may take, s: a recorder may be told to go on for ten minutes. If it dies, that is known at once."""

_TYPE = service_type_name(TakeSnapshot.Request, TakeSnapshot.Response)


def take_snapshot(reach: Reach, reason: str, *, json: bool) -> None:
    """Ask for a file, wait for it, and print which one it is.

    Raises:
        FlightRecorderError: there is no flight recorder, it could not write, or it has died meanwhile.
        UsageError: several robots have one.
    """
    with connect_to_robot(reach) as session:
        found = [one for one in offers.list_services(session, reach.timeout) if one.type == _TYPE]
        service = _only(found, reach)
        see_that_it_obeys(session, reach, service.key)
        hint(f"{service.servers[0]} records a few seconds more, and writes the file")
        answer = _ask(session, service, reason, reach.timeout)
    if not answer.success:
        raise FlightRecorderError(f"{service.servers[0]} could not write a file: {answer.message}")
    if json:
        print_json(_record(answer.snapshot))
    else:
        _print(answer.snapshot)


def _ask(session: zenoh.Session, service: Offer, reason: str, timeout: float) -> TakeSnapshot.Response:
    """Wait for a file; where the link is lost meanwhile, another one is asked for, which holds what this one would."""
    request = msgspec.msgpack.encode(TakeSnapshot.Request(reason))
    encoding = f"{codec.MSGPACK};{type_name(TakeSnapshot.Request)}"

    def is_served() -> bool:
        return any(one.key == service.key for one in offers.list_services(session, timeout))

    try:
        answer = answer_of(session, service.key, request, encoding, is_served, _LONGEST)
    except Gone:
        raise FlightRecorderError(f"{service.servers[0]} has gone, and has not told of a file") from None
    if answer is None:
        raise FlightRecorderError(f"{service.servers[0]} has not written a file within {_LONGEST:g} s")
    if isinstance(answer, Fault):
        raise FlightRecorderError(f"{service.servers[0]}: {answer.error}: {answer.message}")
    try:
        return msgspec.msgpack.decode(answer.payload.to_bytes(), type=readable(TakeSnapshot.Response))
    except UNREADABLE as error:
        raise FlightRecorderError(f"the answer of {service.servers[0]} cannot be read: {error}") from None


def _only(found: list[Offer], reach: Reach) -> Offer:
    """The flight recorder that is meant."""
    meant = [one for one in found if reach.covers(one.key)]
    if not meant:
        whose = f"robot {reach.robot} has" if reach.robot else "no robot that runs here has"
        others = f"; there is {', '.join(one.servers[0] for one in found)}" if found else ""
        raise FlightRecorderError(
            f"{whose} {'no' if reach.robot else 'a'} flight recorder{others}\n"
            "  robo up … flight_recorder:=true starts one with a manifest that ships;"
            " in one's own it is a line within a group:\n"
            "    flight_recorder: {service: robo_services.flight_recorder, stop: {timeout: 5.0}}"
        )
    if len(meant) > 1:
        servers = ", ".join(one.servers[0] for one in meant)
        raise UsageError(f"several robots have a flight recorder: {servers}; say --robot-name")
    return meant[0]


def _record(snapshot: Snapshot) -> dict[str, object]:
    return {
        "file": snapshot.file,
        "host": snapshot.host,
        "recorder": snapshot.recorder,
        "reasons": snapshot.reasons,
        "begin": snapshot.begin.to_nanoseconds(),
        "end": snapshot.end.to_nanoseconds(),
        "size": snapshot.size,
    }


def _print(snapshot: Snapshot) -> None:
    seconds = (snapshot.end.to_nanoseconds() - snapshot.begin.to_nanoseconds()) * 1e-9
    print_line(snapshot.file)
    hint(f"{data_size(snapshot.size)}, at most the last {seconds:.0f} s, on {snapshot.host}")
