"""Asking the supervisors of running robots, and telling them what to do."""

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

import msgspec
import zenoh

from robo.errors import NodeNotFound, RunError, UsageError
from robo.text.suggestions import suggest
from robo.tools.replies import read, samples
from robo.wire import doors, liveliness, names
from robo.wire.discovery import hostname, user
from robo.wire.keys import SupervisorToken, control_key, event_key, log_key, parse_supervisor_token, supervisors_key
from robo.wire.queries import Fault, read_fault
from robo.wire.relinking import over_losses
from robo.wire.reports import (
    COMMAND_LIMIT,
    Event,
    Explanation,
    LogRecord,
    LogsRequest,
    Outcome,
    ProcessName,
    ProcessStatus,
    Request,
    Site,
)
from robo.wire.targets import OF_ALL

T = TypeVar("T")

TIMEOUT = 2.0
"""How long to wait for a supervisor's figures, s."""

COMMAND_TIMEOUT = COMMAND_LIMIT + 5.0
"""How long to wait for a command to be carried out, s: until the answer that it took too long has come as well."""


def processes(session: zenoh.Session, robot: str | None = None, timeout: float = TIMEOUT) -> list[ProcessStatus]:
    """Every process of one robot or of all, in the order of their manifests.

    A robot is a run, or what a run has in the robot's namespace: one of a fleet.

    Raises:
        RunError: no supervisor runs that robot.
    """
    found: list[ProcessStatus] = []
    answered = False
    key = control_key(robot if robot is not None else "**", "ps")
    for sample in over_losses(session, lambda: [*samples(_get(session, key, Request(), timeout))], timeout):
        told = read(sample, list[ProcessStatus])
        answered = answered or told is not None
        found += told or []
    if not answered and robot is not None:
        everybody = processes(session, timeout=timeout)
        found = [status for status in everybody if status.name.is_within(robot)]
        if not found:
            robots = {status.robot for status in everybody} | {names.split(status.node)[0] for status in everybody}
            there = ", ".join(sorted(robots - {""})) or "none"
            raise RunError(f"no supervisor runs a robot {robot}; there is {there}")
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


class Target(NamedTuple):
    """What a command is for."""

    robot: str
    """What the run is called."""
    part: str = ""
    """The namespace of a robot that is only a part of the run; empty where all of it is meant."""


def target_of(session: zenoh.Session, robot: str | None, asked: Sequence[str] = ()) -> Target:
    """What a command is for: the robot that is named, else the only one.

    Raises:
        UsageError: several are meant; a command goes to one.
        RunError: there is none.
    """
    if robot is not None and supervisors(session, robot):
        return Target(robot)
    found = all_processes(session) if robot is None else processes(session, robot)
    runs = sorted({status.robot for status in found})
    if robot is not None:
        if len(runs) > 1:
            raise UsageError(f"{robot} is in several runs: {', '.join(runs)}; say --robot-name of one of them")
        return Target(runs[0], robot if runs[0] != robot else "")
    if len(runs) == 1:
        return Target(runs[0])
    # Full names, and names of namespaces, say whose they are.
    meant = [
        {s.robot for s in found if s.node.strip("/") == word.strip("/") or s.name.is_within(word.strip("/") or "/")}
        for word in asked
    ]
    if meant and all(len(owners) == 1 for owners in meant) and len(set.union(*meant)) == 1:
        return Target(meant[0].pop())
    raise UsageError(f"several robots run: {', '.join(runs)}; say --robot-name")


def _named(session: zenoh.Session, target: Target, words: Sequence[str]) -> list[str]:
    """What a supervisor is asked for: words as they are, or what they mean in a part of its run."""
    if not target.part:
        return list(words)
    there = [status for status in processes(session, target.robot) if status.name.is_within(target.part)]
    found: list[str] = [] if words else [status.node for status in there]
    for word in words:
        meant = [s.node for s in there if ProcessName(target.part, s.node, s.group).is_meant(word)]
        if not meant:
            known = [names.label(target.part, status.node) for status in there]
            raise NodeNotFound(f"robot {target.part} has no node or group {word}; {suggest(word, known)}")
        found += meant
    return list(dict.fromkeys(found))


def command(session: zenoh.Session, target: Target, verb: str, words: Sequence[str]) -> Outcome:
    """Have `stop`, `start`, `restart` or `down` done to nodes or groups of a robot, on all its hosts.

    Raises:
        NodeNotFound: it has no such node or group.
        RunError: no supervisor runs that robot, or it could not do it.
    """
    asked = _named(session, target, words)
    answers = _ask(session, target.robot, verb, Request(asked), Outcome, COMMAND_TIMEOUT)
    unknown = [name for name in asked if all(name in answer.unknown for answer in answers)]
    if unknown:
        raise _not_found(session, target.robot, unknown)
    return Outcome([node for answer in answers for node in answer.nodes])


def explain(
    session: zenoh.Session, target: Target, words: Sequence[str], timeout: float = TIMEOUT
) -> list[Explanation]:
    """Why nodes are in their states. The supervisor may take `timeout` seconds to answer.

    Raises:
        NodeNotFound, RunError: as for `command`.
    """
    answers = _ask(session, target.robot, "why", Request(_named(session, target, words)), list[Explanation], timeout)
    found = [explanation for answer in answers for explanation in answer]
    if words and not found:
        raise _not_found(session, target.robot, words)
    return found


def sites(session: zenoh.Session, robot: str | None = None, timeout: float = TIMEOUT) -> list[Site]:
    """The sites that robots were told to dial, and whether they are linked to them."""
    found: list[Site] = []
    key = control_key(robot if robot is not None else "**", "sites")
    for sample in samples(_get(session, key, Request(), timeout)):
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


def _not_found(session: zenoh.Session, robot: str, words: Sequence[str]) -> NodeNotFound:
    there = [status.node for status in processes(session, robot)]
    return NodeNotFound(f"robot {robot} has no node or group {', '.join(words)}; {suggest(words[0], there)}")


def output(session: zenoh.Session, robot: str, asked: LogsRequest) -> list[LogRecord]:
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
    found = map(parse_supervisor_token, liveliness.every(session, supervisors_key(robot), timeout))
    return [token for token in found if token is not None]


def is_mine(supervisor: SupervisorToken) -> bool:
    """Whether a supervisor is this user's, as far as this machine knows its users: those of others are not asked."""
    return supervisor.machine != hostname() or supervisor.user in ("", user())


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
        target = target_of(session, robot) if robot is not None else Target("**")
        self._session = session
        self._robot, self._part = target
        # Before the past is asked for, so that nothing falls between.
        self._subscriber = session.declare_subscriber(event_key(self._robot), zenoh.handlers.FifoChannel(10_000))

    def past(self) -> list[Event]:
        """What has happened so far, in order."""
        found: list[Event] = []
        key = control_key(self._robot, "events")
        for sample in samples(_get(self._session, key, Request(), TIMEOUT)):
            found += filter(self._is_wanted, read(sample, list[Event]) or [])
        return sorted(found, key=lambda event: event.time)

    def _is_wanted(self, event: Event) -> bool:
        return ProcessName(event.robot, event.node, "").is_within(self._part)

    def coming(self) -> Iterator[Event]:
        """Events as they happen, without end."""
        while True:
            event = read(self._subscriber.handler.recv(), Event)
            if event is not None and self._is_wanted(event):
                yield event


def _ask(session: zenoh.Session, robot: str, verb: str, asked: Request, kind: type[T], timeout: float) -> list[T]:
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
        raise fault.raised()
    if not answers:
        processes(session, robot)  # tells which robots there are
        doors.check(session, robot, timeout)
        raise RunError(f"the supervisor of {robot} did not answer within {timeout:g} s")
    return answers


def _get(session: zenoh.Session, key: str, asked: Request, timeout: float) -> Iterator[zenoh.Reply]:
    """The replies of every supervisor that a key reaches, and not only of the nearest."""
    replies = session.get(
        key,
        payload=msgspec.msgpack.encode(asked),
        timeout=timeout,
        **OF_ALL,
    )
    yield from replies
