"""Asking the supervisors of running robots, and telling them what to do."""

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

import msgspec
import zenoh

from robo.discovery import hostname
from robo.errors import NodeNotFound, RunError, UsageError
from robo.queries import Fault, first_answer
from robo.supervisor.status import (
    Asked,
    Done,
    Event,
    Explanation,
    ProcessStatus,
    control_key,
    event_key,
    supervisor_token,
)

T = TypeVar("T")

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
    for reply in session.get(key, payload=_request([]), timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE):
        if reply.ok is not None:
            answered = True
            found += _decoded(reply.ok.payload.to_bytes(), list[ProcessStatus])
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
    """Have `stop`, `start`, `restart` or `down` done to nodes or groups of a robot.

    Raises:
        NodeNotFound: it has no such node or group.
        RunError: no supervisor runs that robot, or it could not do it.
    """
    return _ask(session, robot, verb, names, Done, COMMAND_TIMEOUT)


def explain(session: zenoh.Session, robot: str, names: Sequence[str]) -> list[Explanation]:
    """Why nodes are in their states.

    Raises:
        NodeNotFound, RunError: as for `command`.
    """
    return _ask(session, robot, "why", names, list[Explanation], TIMEOUT)


class SupervisorToken(NamedTuple):
    """Which process a supervisor is."""

    robot: str
    host: str
    pid: int


def supervisor_of(session: zenoh.Session, robot: str) -> SupervisorToken:
    """The process that runs a robot.

    Raises:
        RunError: none does.
    """
    for reply in session.liveliness().get(supervisor_token(robot, "*", "*"), timeout=TIMEOUT):
        if reply.ok is not None:
            *_, pid, host = str(reply.ok.key_expr).split("/")
            return SupervisorToken(robot, host, int(pid))
    raise RunError(f"no supervisor runs a robot {robot}")


def wait_for_end(supervisor: SupervisorToken, timeout: float) -> None:
    """Wait until a supervisor on this machine has ended; one elsewhere ends by itself.

    Raises:
        RunError: it does not.
    """
    if supervisor.host != hostname():
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
        for reply in self._session.get(
            key, payload=_request([]), timeout=TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE
        ):
            if reply.ok is not None:
                found += _decoded(reply.ok.payload.to_bytes(), list[Event])
        return sorted(found, key=lambda event: event.time)

    def coming(self) -> Iterator[Event]:
        """Events as they happen, without end."""
        while True:
            yield _decoded(self._subscriber.handler.recv().payload.to_bytes(), Event)


def _ask(session: zenoh.Session, robot: str, verb: str, names: Sequence[str], kind: type[T], timeout: float) -> T:
    answer = first_answer(session.get(control_key(robot, verb), payload=_request(names), timeout=timeout))
    if isinstance(answer, Fault):
        raise (NodeNotFound if answer.error == "NodeNotFound" else RunError)(answer.message)
    if answer is None:
        processes(session, robot)  # tells which robots there are
        raise RunError(f"the supervisor of {robot} did not answer within {timeout:g} s")
    return _decoded(answer.payload.to_bytes(), kind)


def _request(names: Sequence[str]) -> bytes:
    return msgspec.msgpack.encode(Asked(list(names)))


def _decoded(data: bytes, kind: type[T]) -> T:
    try:
        return msgspec.msgpack.decode(data, type=kind)
    except msgspec.DecodeError as error:
        raise RunError(f"a supervisor's answer cannot be read (another version of robo?): {error}") from None
