"""What is known of a run beside its messages, for the file of a flight recorder: asked of supervisors and nodes.

Nobody may answer any more: what is missing then is missing in the file, which is written all the same.
"""

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import msgspec
import zenoh

from robo.bag.mcap.file_writer import FileWriter
from robo.bag.of_robot import ABOUT, PARAMETERS
from robo.recording.about import Attachment, graph_of, parameters_yaml, words
from robo.text.unreadable import UNREADABLE
from robo.wire import discovery
from robo.wire.explained import explained
from robo.wire.keys import EndpointToken, NodeToken, control_key, parameters_key
from robo.wire.reports import Event, Explanation, LogRecord, LogsRequest, ProcessStatus, Request

T = TypeVar("T")

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


def attachments(evidence: Evidence, concerned: Sequence[str]) -> list[Attachment]:
    """What is known as files, those that say nothing left out.

    Args:
        evidence: what is known.
        concerned: the full names of nodes that come first.
    """
    first = {name: number for number, name in enumerate(concerned)}
    ordered = sorted(evidence.explanations, key=lambda one: first.get(one.process.node, len(first)))
    why = "\n\n".join("\n".join(explained(one)) for one in ordered)
    parameters = parameters_yaml(evidence.parameters).encode() if evidence.parameters else b""
    known = [
        Attachment("logs.txt", _text(map(_line, evidence.lines)), "text/plain"),
        Attachment("why.txt", f"{why}\n".encode("utf-8", "replace") if why else b"", "text/plain"),
        Attachment("logs.jsonl", _encoder.encode_lines(evidence.lines), "application/x-ndjson"),
        Attachment("why.json", _json(ordered), "application/json"),
        Attachment("processes.json", _json([one.process for one in ordered]), "application/json"),
        Attachment("events.jsonl", _encoder.encode_lines(evidence.events), "application/x-ndjson"),
        Attachment(PARAMETERS, parameters, "text/yaml"),
        Attachment("graph.json", _json(graph_of(evidence.tokens)) if evidence.tokens else b"", "application/json"),
    ]
    return [one for one in known if one.data]


def write_beside(
    writer: FileWriter, at: int, evidence: Evidence, concerned: Sequence[str], about: dict[str, str]
) -> None:
    """Write what is known into a recording.

    Args:
        writer: of the recording.
        at: the time of now, ns since the epoch.
        evidence: what is known.
        concerned: the full names of nodes that come first.
        about: words about the recording.
    """
    writer.add_metadata("flight_recorder", about)
    writer.add_metadata(ABOUT, words(one for one in evidence.tokens if isinstance(one, NodeToken)))
    for one in attachments(evidence, concerned):
        writer.add_attachment(at, at, one.name, one.media_type, one.data)


def _json(data: object) -> bytes:
    return msgspec.json.format(msgspec.json.encode(data)) if data else b""


def _text(lines: "Iterator[str] | map[str]") -> bytes:
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
        self._session.get(key, handler, timeout=_PATIENCE, **_OF_ALL)
        return done

    def testimony(self, since: int, timeout: float) -> Evidence:
        """All that is known.

        Args:
            since: lines of output from here on, ns since the epoch.
            timeout: how long to wait for each who does not answer, s.
        """
        answered = self.ask_parameters()
        robot = self._robot = self._robot or self._run_name(timeout)
        ask = partial(self._ask, robot, timeout=timeout)
        explanations = ask("why", Request(), list[Explanation])
        events = sorted(ask("events", Request(), list[Event]), key=lambda one: one.time)
        lines = sorted(ask("logs", LogsRequest(since=since), list[LogRecord]), key=lambda one: one.time)
        answered.wait(timeout)
        return Evidence(explanations, events, lines, self.parameters, discovery.tokens(self._session, timeout))

    def events(self, timeout: float) -> list[Event]:
        """What has happened in the run so far."""
        robot = self._robot = self._robot or self._run_name(timeout)
        return self._ask(robot, "events", Request(), list[Event], timeout)

    @property
    def parameters(self) -> dict[str, Mapping[str, object]]:
        """What was told last of each node's, by full name."""
        with self._lock:
            return dict(sorted(self._parameters.items()))

    def _run_name(self, timeout: float) -> str | None:
        for status in self._ask("**", "ps", Request(), list[ProcessStatus], timeout):
            if status.run == self._run or (not self._run and status.name.is_within(self._namespace)):
                return status.robot
        return None

    def _ask(self, robot: str | None, verb: str, asked: Request, kind: type[list[T]], timeout: float) -> list[T]:
        """The answers of all supervisors of a run, together."""
        found: list[T] = []
        if robot is None:
            return found
        payload = msgspec.msgpack.encode(asked)
        for reply in self._session.get(control_key(robot, verb), payload=payload, timeout=timeout, **_OF_ALL):
            if reply.ok is not None:
                try:
                    found += msgspec.msgpack.decode(reply.ok.payload.to_bytes(), type=kind)
                except UNREADABLE:
                    continue  # anybody may answer
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


_PATIENCE = 2.0
"""With a node that does not answer, s."""

_encoder = msgspec.json.Encoder()

_OF_ALL: dict[str, Any] = {"target": zenoh.QueryTarget.ALL, "consolidation": zenoh.ConsolidationMode.NONE}
