"""`robo bag snapshot`: asking a flight recorder for a file."""

import time

import msgspec

from robo.cli.connection import connect_to_robot, see_that_it_obeys
from robo.cli.printing import data_size, hint, print_json, print_line
from robo.cli.reach import Reach
from robo.errors import FlightRecorderError, UsageError
from robo.node import services
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.tools import offers
from robo.tools.offers import Offer
from robo.wire import codec
from robo_messages import Snapshot, TakeSnapshot, service_type_name, type_name

_LONGEST = 1500.0
"""How long a file may take, s: a recorder may be told to go on for ten minutes. If it dies, that is known at once."""

_TYPE = service_type_name(TakeSnapshot.Request, TakeSnapshot.Response)


def take_snapshot(reach: Reach, reason: str, *, json: bool) -> None:
    """Ask for a file, wait for it, and print which one it is.

    Raises:
        FlightRecorderError: there is no flight recorder, or it could not write.
        UsageError: several robots have one.
        ServiceError: it has died meanwhile.
    """
    with connect_to_robot(reach) as session:
        found = [one for one in offers.list_services(session, reach.timeout) if one.type == _TYPE]
        service = _only(found, reach)
        see_that_it_obeys(session, reach, service.key)
        hint(f"{service.servers[0]} records a few seconds more, and writes the file")
        request = msgspec.msgpack.encode(TakeSnapshot.Request(reason))
        attachment = codec.pack_attachment(1, time.time_ns())
        encoding = f"{codec.MSGPACK};{type_name(TakeSnapshot.Request)}"
        sample = services.ask(session, service.key, (request, attachment), encoding, _LONGEST, _LONGEST)
    try:
        answer = msgspec.msgpack.decode(sample.payload.to_bytes(), type=readable(TakeSnapshot.Response))
    except UNREADABLE as error:
        raise FlightRecorderError(f"the answer of {service.servers[0]} cannot be read: {error}") from None
    if not answer.success:
        raise FlightRecorderError(f"{service.servers[0]} could not write a file: {answer.message}")
    if json:
        print_json(_record(answer.snapshot))
    else:
        _print(answer.snapshot)


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
