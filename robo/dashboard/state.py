"""What all pages are told of robots: nodes, topics, events, lines of their logs."""

import logging
import threading
import time
from collections.abc import Callable, Hashable, Iterable
from itertools import islice
from typing import Generic, TypeVar

import msgspec
import zenoh

from robo.errors import RoboError
from robo.tools import nodes, runs, topics, unsupervised
from robo.tools.replies import read
from robo.wire import names
from robo.wire.keys import event_key, log_key
from robo.wire.reports import Event, HealthLevel, LogRecord, LogsRequest, NodeStatus, ProcessStatus, health_of

PERIOD = 1.0
"""How often supervisors are asked, s."""
_ASK_AGAIN = 0.5
"""How long after a robot has been met, or has not answered, it is asked for its past, s."""
_LOOK = 0.1
"""How often lines and events are looked for, s."""
_TIMEOUT = 0.5
"""How long those may take to answer that are asked, s: a robot that hangs holds up nobody's page for long."""
_PAST = LogsRequest(lines=300)
"""Of each robot's log, for a page that is opened."""
_MOST_PAST = 1_000
"""Lines that are kept for pages that are opened later."""
_CLOSING = 3.0
"""So long a robot that is being asked may hold up the end, s."""
_MOST_TOLD = 10_000
"""Lines, and events, that are remembered so that they are not told twice."""
_SLOTS = 1_000
_MOST_LINES = 200
"""Lines at one look: of a flood pages are told the newest, and how many were left out."""
_LONGEST_LINE = 4_000
"""Characters."""
_MOST_NODES, _MOST_TOPICS, _MOST_ROBOTS = 1_000, 1_000, 100
"""In a picture: more nobody reads, and strangers may make some up."""
_OF_ROBOTS = ("odom", "cmd_vel", "safety_state")
"""A namespace that has one of these topics is a robot, even within another one's."""
_ALL = "**"
_logger = logging.getLogger("robo.dashboard")


class Node(msgspec.Struct, frozen=True):
    """A node or another process, as a page shows it."""

    node: str
    robot: str
    """What its run is called; empty where no supervisor runs it."""
    group: str
    state: str
    reason: str
    pid: int | None
    host: str
    cpu: float | None
    """% of a core."""
    memory: int | None
    """Bytes."""
    restarts: int | None
    uptime: float | None
    """s."""
    health: HealthLevel | None
    trouble: str
    process: str
    """The full name of the process that it shares with others; empty where it has its own."""


class TopicRow(msgspec.Struct, frozen=True):
    """A topic, as a page lists it."""

    key: str
    type: str
    publishers: list[str]
    subscribers: list[str]
    rate: float | None
    """Messages a second, as publishers count them."""
    dropped: int
    """Messages that callbacks were too slow for, so far, of all subscribers."""


class Line(msgspec.Struct, frozen=True):
    """A line of a robot's log."""

    robot: str
    time: int
    """ms since the epoch."""
    node: str
    level: str
    message: str


class Picture(msgspec.Struct, frozen=True):
    """One look at everything that runs."""

    robots: list[str]
    """Their namespaces."""
    nodes: list[Node]
    topics: list[TopicRow]
    left_out: int = 0
    """Nodes and topics for which there was no room."""


_T = TypeVar("_T", bound=Hashable)


class Told(Generic[_T]):
    """What has been told, as far as it is remembered: what comes by the subscription may be of the past as well."""

    def __init__(self) -> None:
        self._known: dict[_T, None] = {}
        self._lock = threading.Lock()

    def new(self, found: Iterable[_T]) -> list[_T]:
        """Those that have not been told before; from now on they have."""
        with self._lock:
            fresh = [one for one in found if one not in self._known]
            self._known.update(dict.fromkeys(fresh))
            for one in list(islice(self._known, max(0, len(self._known) - _MOST_TOLD))):
                del self._known[one]
        return fresh


class State:
    """Looks at what runs, and tells what is new."""

    def __init__(
        self,
        session: zenoh.Session,
        looked: Callable[[Picture], None],
        lines: Callable[[list[Line]], None],
        events: Callable[[list[Event]], None],
    ) -> None:
        """
        Args:
            session: the network.
            looked: gets all that runs, once a second while somebody attends, by a thread.
            lines: gets new lines of logs, by other threads; those of a robot's past once it has been met.
            events: gets new events, by the same.
        """
        self._session = session
        self._tell_look, self._tell_lines, self._tell_events = looked, lines, events
        self._over = threading.Event()
        self._attended = threading.Event()
        self._runs: set[str] = set()
        """The runs that the last look has found."""
        self._told_lines, self._told_events = Told[Line](), Told[Event]()
        self._alone = unsupervised.Lines(session)
        # Before the past is asked for, so that nothing falls between.
        self._lines = session.declare_subscriber(log_key(_ALL), zenoh.handlers.RingChannel(_SLOTS))
        self._events = session.declare_subscriber(event_key(_ALL), zenoh.handlers.RingChannel(_SLOTS))
        self._threads = [
            threading.Thread(target=run, name=f"robo-dashboard-{name}", daemon=True)
            for name, run in (("look", self._look), ("lines", self._listen), ("past", self._ask_past))
        ]
        for thread in self._threads:
            thread.start()

    def attend(self, somebody: bool) -> None:
        """Whether anybody looks: else nobody is asked anything."""
        if somebody:
            self._attended.set()
        else:
            self._attended.clear()

    def close(self) -> None:
        """Look no more."""
        self._over.set()
        self._attended.set()
        deadline = time.monotonic() + _CLOSING
        for thread in self._threads:
            thread.join(max(0.0, deadline - time.monotonic()))
        self._lines.undeclare()
        self._events.undeclare()

    def _look(self) -> None:
        while not self._over.is_set():
            self._attended.wait()
            begin = time.monotonic()
            try:
                processes = runs.processes(self._session, timeout=_TIMEOUT)
                statuses = nodes.all_status(self._session, _TIMEOUT)
                listed = topics.list_topics(self._session, _TIMEOUT, ())
                supervised = {one.node for one in processes}
                said = self._alone.new() if statuses.keys() - supervised else []
            except (zenoh.ZError, RoboError):
                pass  # the router is away; pages see how old all is
            except Exception:  # nobody has thought of it: it is told, and looked at again
                _logger.exception("the dashboard could not look at what runs")
            else:
                self._runs = {one.robot for one in processes if one.robot}
                found = picture(processes, statuses, listed)
                if not self._over.is_set():
                    self._tell_look(found)
                    self._tell_of_unsupervised(found.robots, said)
            self._over.wait(max(_LOOK, begin + PERIOD - time.monotonic()))

    def _tell_of_unsupervised(self, robots: list[str], said: list[LogRecord]) -> None:
        """Tell what nodes have logged that no supervisor hears."""
        lines = []
        for one in said:
            robot = robot_in(robots, one.node)
            lines.append(line_of(robot, msgspec.structs.replace(one, node=names.label(robot, one.node))))
        if fresh := self._told_lines.new(lines):
            self._tell_lines(newest(fresh))

    def _listen(self) -> None:
        while not self._over.wait(_LOOK):
            try:
                self._hear()
            except zenoh.ZError:
                pass  # the network has been left
            except Exception:  # nobody has thought of it: it is told, and listened on
                if not self._over.is_set():
                    _logger.exception("the dashboard could not take in lines and events")

    def _hear(self) -> None:
        lines: list[Line] = []
        while (sample := self._lines.handler.try_recv()) is not None:
            record = read(sample, LogRecord)
            if record is not None:
                lines.append(line_of(_robot_of(str(sample.key_expr), log_key(_ALL)), record))
        if fresh := self._told_lines.new(lines):
            self._tell_lines(newest(fresh))
        events: list[Event] = []
        while (sample := self._events.handler.try_recv()) is not None:
            event = read(sample, Event)
            if event is not None:
                events.append(event)
        if found := self._told_events.new(events):
            self._tell_events(found[-_MOST_LINES:])

    def _ask_past(self) -> None:
        """Ask each robot that is met for its past, until it has answered; and anew where it was away meanwhile."""
        heard: set[str] = set()
        while not self._over.wait(_ASK_AGAIN):
            heard &= self._runs
            new = self._runs - heard
            try:
                heard |= self._tell_past(new) if new else set()
            except zenoh.ZError:
                pass  # the network has been left
            except Exception:  # nobody has thought of it: it is told, and asked again
                if not self._over.is_set():
                    _logger.exception("the dashboard could not ask for what has been")

    def _tell_past(self, robots: set[str]) -> set[str]:
        """Tell the past of robots; returns those that have answered."""
        past = [event for event in runs.EventStream(self._session).past() if event.robot in robots]
        if events := self._told_events.new(past):
            self._tell_events(events)
        answered: set[str] = set()
        lines: list[Line] = []
        for robot in sorted(robots & {event.robot for event in past}):
            if self._over.is_set():
                break
            try:
                said = runs.output(self._session, robot, _PAST)
            except RoboError:
                continue  # it has just ended, or is asked again
            answered.add(robot)
            lines += [line_of(robot, one) for one in said]
        if found := self._told_lines.new(lines):
            self._tell_lines(sorted(found, key=lambda line: line.time)[-_MOST_PAST:])
        return answered


def picture(
    processes: Iterable[ProcessStatus], statuses: dict[str, NodeStatus], listed: Iterable[topics.Topic]
) -> Picture:
    """All that runs, of what supervisors, nodes and tokens say."""
    processes = list(processes)
    rows = {one.node: _supervised(one) for one in processes}
    for name, status in statuses.items():
        if name not in rows:
            rows[name] = _alone(name, status)
    rates = topics.published_rates(processes)
    dropped: dict[str, int] = {}
    for status in statuses.values():
        for key, count in status.dropped.items():
            dropped[key] = dropped.get(key, 0) + count
    found = [
        TopicRow(one.key, one.type, one.publishers, one.subscribers, rates.get(one.key), dropped.get(one.key, 0))
        for one in listed
    ]
    shown = [rows[name] for name in sorted(rows)]
    robots = robots_of(shown, (row.key for row in found))
    left_out = max(0, len(shown) - _MOST_NODES) + max(0, len(found) - _MOST_TOPICS)
    return Picture(robots[:_MOST_ROBOTS], shown[:_MOST_NODES], found[:_MOST_TOPICS], left_out)


def robots_of(rows: Iterable[Node], keys: Iterable[str]) -> list[str]:
    """The robots among what runs: runs, or what a run has by robot, and namespaces of nodes that no run has.

    A namespace within another one is part of that robot, but where it has odometry or is driven itself.
    """
    rows = list(rows)
    runs = {row.robot for row in rows if row.robot}
    spaces = {_namespace(row.node) for row in rows}
    driven = {key.rpartition("/")[0] for key in keys if key.rpartition("/")[2] in _OF_ROBOTS} & spaces

    def is_part(space: str, of: Iterable[str]) -> bool:
        return any(one and space.startswith(f"{one}/") for one in of)

    found = runs | {space for space in spaces if space in driven or not is_part(space, runs | spaces)}
    # A run of several robots is none itself.
    return sorted(one for one in found if one in spaces or not any(is_part(other, (one,)) for other in found))


def robot_in(robots: Iterable[str], node: str) -> str:
    """Of which of these robots a node is, by its full name; empty where of none."""
    return max((one for one in robots if node.startswith(f"{one}/")), key=len, default="")


def newest(lines: list[Line]) -> list[Line]:
    """As many lines as are shown at once; instead of what came before, how many those were."""
    if len(lines) <= _MOST_LINES:
        return lines
    kept = lines[-_MOST_LINES:]
    left = f"{len(lines) - len(kept)} lines or more were left out: they came too fast to be shown"
    return [msgspec.structs.replace(kept[0], node="dashboard", level="WARN", message=left), *kept]


def line_of(robot: str, record: LogRecord) -> Line:
    """A line of a log, as a page shows it."""
    message = record.message
    if len(message) > _LONGEST_LINE:
        message = f"{message[:_LONGEST_LINE]} … {len(message)} characters in all"
    return Line(robot, record.time // 1_000_000, record.node[:_LONGEST_LINE], record.level or "", message)


def _supervised(one: ProcessStatus) -> Node:
    return Node(
        one.node, one.robot, one.group, one.state, one.reason, one.pid, one.host, one.cpu, one.memory, one.restarts,
        one.uptime, one.health, one.trouble, one.process,
    )  # fmt: skip


def _alone(name: str, status: NodeStatus) -> Node:
    health, trouble = health_of(status.checks)
    return Node(name, "", "", "ready", "", None, "", None, None, None, status.uptime, health, trouble, "")


def _namespace(node: str) -> str:
    return node.strip("/").rpartition("/")[0]


def _robot_of(key: str, pattern: str) -> str:
    """The robot of a key, where a pattern has `**`."""
    before, _, after = pattern.partition(_ALL)
    return key.removeprefix(before).removesuffix(after).strip("/")
