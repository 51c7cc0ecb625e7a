"""Asking the supervisors of running robots, and telling them what to do."""

import time
from collections.abc import Iterator, Sequence
from typing import TypeVar

import msgspec
import zenoh

from robo.discovery import hostname
from robo.errors import NodeNotFound, RunError, UsageError
from robo.queries import Fault, read_fault
from robo.suggestions import suggest
from robo.supervisor.log_files import LogRecord
from robo.supervisor.status import (
    Asked,
    Done,
    Event,
    Explanation,
    ProcessStatus,
    Site,
    SupervisorToken,
    control_key,
    event_key,
    log_key,
    parse_supervisor_token,
    supervisors_key,
)
from robo.tools.replies import read, samples

T = TypeVar("T")

_ERRORS = {"NodeNotFound": NodeNotFound, "UsageError": UsageError}

TIMEOUT = 2.0
"""How long to wait for a supervisor's figures, s."""

COMMAND_TIMEOUT = 60.0
"""How long to wait for a command to be carried out, s."""


def processes(session: zenoh.Session, robot: str | None = None, timeout: float = TIMEOUT) -> list[ProcessStatus]:
    """Every process of one robot or of all, in the order of their manifests.

    Raises:
        RunError: no supervisor runs that robot.
    """
    found: list[ProcessStatus] = []
    answered = False
    key = control_key(robot if robot is not None else "**", "ps")
    for sample in samples(_get(session, key, Asked(), timeout)):
        told = read(sample, list[ProcessStatus])
        answered = answered or told is not None
        found += told or []
    if not answered and robot is not None:
        there = sorted({status.robot for status in processes(session, timeout=timeout)})
        raise RunError(f"no supervisor runs a robot {robot}; there is {', '.join(there) or 'none'}")
    return sorted(found, key=lambda status: status.robot)


def all_processes(session: zenoh.Session) -> list[ProcessStatus]:
    """Every process of every robot.

    Raises:
        RunError: none runs.
    """
    found = processes(session)
    if not found:
        raise RunError("no supervisor answers: no robot was started here with `robo up`")
    return found


def robot_of(session: zenoh.Session, robot: str | None, asked: Sequence[str] = ()) -> str:
    """The robot that a command is for: the one that is named, else the only one.

    Raises:
        UsageError: several run and none is named; a command goes to one.
        RunError: none runs.
    """
    if robot is not None:
        return robot.strip("/")
    found = all_processes(session)
    robots = sorted({status.robot for status in found})
    if len(robots) == 1:
        return robots[0]
    nodes = {status.node: status.robot for status in found}
    meant = {nodes.get(name) for name in asked}
    if len(meant) == 1 and None not in meant:  # full names say whose they are
        return str(meant.pop())
    raise UsageError(f"several robots run: {', '.join(robots)}; say --robot-name")


def command(session: zenoh.Session, robot: str, verb: str, names: Sequence[str]) -> Done:
    """Have `stop`, `start`, `restart` or `down` done to nodes or groups of a robot, on all its hosts.

    Raises:
        NodeNotFound: it has no such node or group.
        RunError: no supervisor runs that robot, or it could not do it.
    """
    answers = _ask(session, robot, verb, Asked(list(names)), Done, COMMAND_TIMEOUT)
    unknown = [name for name in names if all(name in answer.unknown for answer in answers)]
    if unknown:
        raise _not_found(session, robot, unknown)
    return Done([node for answer in answers for node in answer.nodes])


def explain(session: zenoh.Session, robot: str, names: Sequence[str]) -> list[Explanation]:
    """Why nodes are in their states.

    Raises:
        NodeNotFound, RunError: as for `command`.
    """
    answers = _ask(session, robot, "why", Asked(list(names)), list[Explanation], TIMEOUT)
    found = [explanation for answer in answers for explanation in answer]
    if names and not found:
        raise _not_found(session, robot, names)
    return found


def sites(session: zenoh.Session, robot: str | None = None, timeout: float = TIMEOUT) -> list[Site]:
    """The sites that robots were told to dial, and whether they are linked to them."""
    found: list[Site] = []
    for sample in samples(_get(session, control_key(robot if robot is not None else "**", "sites"), Asked(), timeout)):
        found += read(sample, list[Site]) or []
    return found


def lost_sites(session: zenoh.Session, robot: str | None = None, timeout: float = TIMEOUT) -> list[str]:
    """Which robots do not reach their sites, and why, in words."""
    return [
        f"{one.robot} does not reach {one.endpoint}{f': {one.reason}' if one.reason else ''}, "
        f"for {max(0.0, time.time() - one.since / 1e9):.0f} s"
        for one in sites(session, robot, timeout)
        if not one.reached
    ]


def _not_found(session: zenoh.Session, robot: str, names: Sequence[str]) -> NodeNotFound:
    there = [status.node for status in processes(session, robot)]
    return NodeNotFound(f"robot {robot} has no node or group {', '.join(names)}; {suggest(names[0], there)}")


def output(session: zenoh.Session, robot: str, asked: Asked) -> list[LogRecord]:
    """What the processes of a robot have printed, on all its hosts, as far as their supervisors keep it.

    Raises:
        RunError: no supervisor runs that robot.
    """
    answers = _ask(session, robot, "logs", asked, list[LogRecord], TIMEOUT)
    found = sorted((one for answer in answers for one in answer), key=lambda one: one.time)
    return found if not asked.lines else found[-asked.lines :]


class OutputStream:
    """What the processes of a robot print from now on."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self._subscriber = session.declare_subscriber(log_key(robot), zenoh.handlers.FifoChannel(10_000))

    def coming(self) -> Iterator[LogRecord]:
        """Lines as they are printed, without end."""
        while True:
            record = read(self._subscriber.handler.recv(), LogRecord)
            if record is not None:
                yield record


def supervisors_of(session: zenoh.Session, robot: str) -> list[SupervisorToken]:
    """The processes that run a robot: one, or one for each of its hosts.

    Raises:
        RunError: none does.
    """
    found = supervisors(session, robot)
    if not found:
        raise RunError(f"no supervisor runs a robot {robot}")
    return found


def supervisors(session: zenoh.Session, robot: str = "**", timeout: float = TIMEOUT) -> list[SupervisorToken]:
    """The supervisors of one robot, or of all."""
    replies = session.liveliness().get(supervisors_key(robot), timeout=timeout)
    found = [parse_supervisor_token(str(sample.key_expr)) for sample in samples(replies)]
    return [token for token in found if token is not None]


def wait_for_end(supervisor: SupervisorToken, timeout: float) -> None:
    """Wait until a supervisor on this machine has ended; one elsewhere ends by itself.

    Raises:
        RunError: it does not.
    """
    if supervisor.machine != hostname():
        return
    import psutil  # which the other commands do without

    end = time.monotonic() + timeout
    while time.monotonic() < end:
        try:  # a zombie has ended, whether or not its parent has noticed
            if psutil.Process(supervisor.pid).status() == psutil.STATUS_ZOMBIE:
                return
        except psutil.NoSuchProcess:
            return
        time.sleep(0.02)
    raise RunError(
        f"the supervisor of {supervisor.robot} (process {supervisor.pid}) has not ended within {timeout:g} s"
    )


class EventStream:
    """The events of one robot or of all: those so far, then those to come."""

    def __init__(self, session: zenoh.Session, robot: str | None = None) -> None:
        self._session = session
        self._robot = robot if robot is not None else "**"
        # Before the past is asked for, so that nothing falls between.
        self._subscriber = session.declare_subscriber(event_key(self._robot), zenoh.handlers.FifoChannel(10_000))

    def past(self) -> list[Event]:
        """What has happened so far, in order."""
        found: list[Event] = []
        key = control_key(self._robot, "events")
        for sample in samples(_get(self._session, key, Asked(), TIMEOUT)):
            found += read(sample, list[Event]) or []
        return sorted(found, key=lambda event: event.time)

    def coming(self) -> Iterator[Event]:
        """Events as they happen, without end."""
        while True:
            event = read(self._subscriber.handler.recv(), Event)
            if event is not None:
                yield event


def _ask(session: zenoh.Session, robot: str, verb: str, asked: Asked, kind: type[T], timeout: float) -> list[T]:
    """The answers of all supervisors of a robot."""
    answers: list[T] = []
    faults: list[Fault] = []
    for reply in _get(session, control_key(robot, verb), asked, timeout):
        if reply.ok is not None:
            told = read(reply.ok, kind)
            answers += [told] if told is not None else []
        elif (fault := read_fault(reply)) is not None:
            faults.append(fault)
    for fault in faults:
        raise _ERRORS.get(fault.error, RunError)(fault.message)
    if not answers:
        processes(session, robot)  # tells which robots there are
        raise RunError(f"the supervisor of {robot} did not answer within {timeout:g} s")
    return answers


def _get(session: zenoh.Session, key: str, asked: Asked, timeout: float) -> Iterator[zenoh.Reply]:
    """The replies of every supervisor that a key reaches, and not only of the nearest."""
    replies = session.get(
        key,
        payload=msgspec.msgpack.encode(asked),
        timeout=timeout,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
    )
    yield from replies
