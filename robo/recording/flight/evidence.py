"""What is known of a run beside its messages, for the file of a flight recorder: asked of supervisors and nodes.

Nobody may answer any more: what is missing then is missing in the file, which is written all the same.
"""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

import msgspec
import zenoh

from robo.bag.mcap.file_writer import FileWriter
from robo.bag.of_robot import ABOUT, PARAMETERS
from robo.bag.publishers import GRAPH
from robo.recording.about import Attachment, graph_of, parameters_yaml, words
from robo.recording.flight.shelf import WORDS
from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire import liveliness
from robo.wire.explained import explained
from robo.wire.keys import ALL_TOKENS, EndpointToken, NodeToken, control_key, parameters_key, parse_token
from robo.wire.reports import MOST_LINES, Event, Explanation, LogRecord, LogsRequest, ProcessStatus, Request
from robo.wire.targets import OF_ALL

T = TypeVar("T")
E = TypeVar("E", Event, LogRecord)

MOST_NODES = 1_000
"""Whose parameters are kept."""
_LARGEST = 1_000_000
"""Of the parameters of a node; larger ones are left out, bytes."""


class Evidence(msgspec.Struct, frozen=True):
    """What is known."""

    explanations: Sequence[Explanation] = ()
    """What `robo why` tells."""
    events: Sequence[Event] = ()
    lines: Sequence[LogRecord] = ()
    """What processes and supervisor have printed."""
    parameters: Mapping[str, Mapping[str, object]] = {}
    """Of each node, by full name."""
    tokens: Sequence[NodeToken | EndpointToken] = ()
    """Nodes and ends that were there."""
    lines_are_missing: bool = False
    """Whether there may have been more of them before."""


Tell = Callable[[str], object]


def attachments(evidence: Evidence, concerned: Sequence[str], tell: Tell) -> list[Attachment]:
    """What is known as files, those that say nothing left out.

    Args:
        evidence: what is known.
        concerned: the full names of nodes that come first.
        tell: is told which file cannot be made, and why.
    """
    first = {name: number for number, name in enumerate(concerned)}
    ordered = sorted(evidence.explanations, key=lambda one: first.get(one.process.node, len(first)))
    json, lines = "application/json", "application/x-ndjson"
    makers: list[tuple[str, str, Callable[[], bytes]]] = [
        ("logs.txt", "text/plain", lambda: _logs(evidence)),
        ("why.txt", "text/plain", lambda: _why(ordered)),
        ("logs.jsonl", lines, lambda: _encoder.encode_lines(evidence.lines)),
        ("why.json", json, lambda: _json(ordered)),
        ("processes.json", json, lambda: _json([one.process for one in ordered])),
        ("events.jsonl", lines, lambda: _encoder.encode_lines(evidence.events)),
        (PARAMETERS, "text/yaml", lambda: _parameters(evidence)),
        (GRAPH, json, lambda: _json(graph_of(evidence.tokens)) if evidence.tokens else b""),
    ]
    found = []
    for name, kind, make in makers:
        try:
            data = make()
        except Exception as error:  # whatever strangers have told, the messages are worth more
            tell(f"{name} is not in the file: {type(error).__name__}: {error}")
        else:
            found += [Attachment(name, data, kind)] if data else []
    return found


def write_beside(
    writer: FileWriter, at: int, evidence: Evidence, concerned: Sequence[str], about: dict[str, str], tell: Tell
) -> None:
    """Write what is known into a recording.

    Args:
        writer: of the recording.
        at: the time of now, ns since the epoch.
        evidence: what is known.
        concerned: the full names of nodes that come first.
        about: words about the recording.
        tell: as in `attachments`.
    """
    writer.add_metadata(WORDS, about)
    writer.add_metadata(ABOUT, words(one for one in evidence.tokens if isinstance(one, NodeToken)))
    for one in attachments(evidence, concerned, tell):
        writer.add_attachment(at, at, one.name, one.media_type, one.data)


def _logs(evidence: Evidence) -> bytes:
    cut = [f"(older lines may be missing: a supervisor keeps the last {MOST_LINES:,})"] * evidence.lines_are_missing
    return _text([*cut, *map(_line, evidence.lines)])


def _why(told: Sequence[Explanation]) -> bytes:
    return _text(["\n\n".join("\n".join(explained(one)) for one in told)] if told else [])


def _parameters(evidence: Evidence) -> bytes:
    return parameters_yaml(evidence.parameters).encode("utf-8", "replace") if evidence.parameters else b""


def _json(data: object) -> bytes:
    return msgspec.json.format(msgspec.json.encode(data)) if data else b""


def _text(lines: Iterable[str]) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode("utf-8", "replace")


def _line(one: LogRecord) -> str:
    """As the console shows it, with the date."""
    stamp = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(one.time / 1e9))
    return f"{stamp}.{one.time // 1_000_000 % 1000:03d} {one.node}: {f'{one.level} ' if one.level else ''}{one.message}"


class Witnesses:
    """Those who are asked: the supervisors of a run, and the nodes of a robot."""

    def __init__(self, session: zenoh.Session, namespace: str, run: str) -> None:
        """
        Args:
            session: the network.
            namespace: of the robot.
            run: its id; empty for a node that is run alone.
        """
        self._session = session
        self._namespace = namespace
        self._run = run
        self._robot: str | None = None
        """What the run is called; None as long as that is not known."""
        self._parameters: dict[str, Mapping[str, object]] = {}
        self._lock = threading.Lock()

    def ask_parameters(self) -> threading.Event:
        """Ask all nodes for their parameters, so that those of a node that dies are known.

        Returns:
            Set once all have answered, or the time is over.
        """
        key = parameters_key(self._namespace, "**", "get")
        done = threading.Event()
        handler = zenoh.handlers.Callback(self._take_parameters, done.set, indirect=False)
        self._session.get(key, handler, timeout=_PATIENCE, **OF_ALL)
        return done

    def testimony(self, since: int, timeout: float) -> Evidence:
        """All that is known. All are asked at once, so that whoever does not answer costs the time only once.

        Args:
            since: lines of output from here on, ns since the epoch.
            timeout: how long to wait for those who do not answer, s.

        Raises:
            ZError: the network is being closed.
        """
        answered = self.ask_parameters()
        there = liveliness.ask(self._session, ALL_TOKENS, timeout)
        robot = self.find_run(timeout)
        why = self._ask(robot, "why", Request(), timeout)
        events = self._ask(robot, "events", Request(), timeout)
        logs = self._ask(robot, "logs", LogsRequest(since=since), timeout)
        lines = list(_answers(logs, list[LogRecord]))
        found = [*map(parse_token, there)]
        answered.wait(timeout)
        return Evidence(
            explanations=[one for told in _answers(why, list[Explanation]) for one in told],
            events=_in_order(_answers(events, list[Event])),
            lines=_in_order(lines),
            lines_are_missing=any(len(told) >= MOST_LINES for told in lines),
            parameters=self.parameters,
            tokens=[token for token in found if isinstance(token, NodeToken | EndpointToken)],
        )

    def events(self, timeout: float) -> list[Event]:
        """What has happened in the run so far.

        Raises:
            ZError: the network is being closed.
        """
        return _in_order(_answers(self._ask(self.find_run(timeout), "events", Request(), timeout), list[Event]))

    def find_run(self, timeout: float) -> str | None:
        """What the run is called, once somebody has said it.

        Raises:
            ZError: the network is being closed.
        """
        if self._robot is None:
            told = _answers(self._ask("**", "ps", Request(), timeout), list[ProcessStatus])
            self._robot = next((one.robot for found in told for one in found if self._is_ours(one)), None)
        return self._robot

    @property
    def parameters(self) -> dict[str, Mapping[str, object]]:
        """What was told last of each node's, by full name."""
        with self._lock:
            return dict(sorted(self._parameters.items()))

    def _is_ours(self, status: ProcessStatus) -> bool:
        return status.run == self._run or (not self._run and status.name.is_within(self._namespace))

    def _ask(self, robot: str | None, verb: str, asked: Request, timeout: float) -> Iterable[zenoh.Reply]:
        """Ask all supervisors of a run; their answers come as they are taken."""
        if robot is None:
            return ()
        payload = msgspec.msgpack.encode(asked)
        found: Iterable[zenoh.Reply] = self._session.get(
            control_key(robot, verb), payload=payload, timeout=timeout, **OF_ALL
        )
        return found

    def _take_parameters(self, reply: zenoh.Reply) -> None:
        if reply.ok is None or len(reply.ok.payload) > _LARGEST:
            return
        try:
            told = msgspec.msgpack.decode(reply.ok.payload.to_bytes(), type=dict[str, object])
        except UNREADABLE:
            return
        node = str(reply.ok.key_expr).removesuffix("/parameters/get")
        with self._lock:
            if f"/{node}" in self._parameters or len(self._parameters) < MOST_NODES:
                self._parameters[f"/{node}"] = told


def _answers(replies: Iterable[zenoh.Reply], kind: type[list[T]]) -> Iterator[list[T]]:
    for reply in replies:
        if reply.ok is not None:
            try:
                yield msgspec.msgpack.decode(reply.ok.payload.to_bytes(), type=readable(kind))
            except UNREADABLE:
                continue  # anybody may answer


def _in_order(told: Iterable[list[E]]) -> list[E]:
    return sorted((one for found in told for one in found), key=lambda one: one.time)


_PATIENCE = 2.0
"""With a node that does not answer, s."""

_encoder = msgspec.json.Encoder()
