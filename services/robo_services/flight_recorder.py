"""Keeps the last seconds of a robot, and writes them into a file when something happens."""

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

import robo
from robo import READ_ONLY, Health, Node, Publisher, Unit, check, service
from robo.bag.mcap.compression import best_compression, compressor
from robo.environment import RUN_VARIABLE, SUPERVISED_VARIABLE
from robo.errors import BagError, FlightRecorderError, InvalidName, ParameterError
from robo.node.turn import paused
from robo.recording.flight.files import Recorder, Settings
from robo.recording.flight.flight import Flight
from robo.recording.flight.ring import default_bases
from robo.recording.selection import Selection
from robo.text.folders import log_base
from robo.wire import liveliness, names
from robo.wire.discovery import publishers_of
from robo.wire.keys import SNAPSHOTS_TOPIC, NodeToken, parse_token
from robo.wire.run_id import new_run_id
from robo_messages import DiagnosticStatus, Snapshot, TakeSnapshot

_MB = 1_000_000
_REMEMBERED = 10
"""Files that are told to whoever comes later."""
_END = 4.0
"""How long the last file may take, s; the manifest grants a little more."""
_LONGEST_WAIT = 60.0
"""For a file that somebody has asked for, beyond the time that is still to be recorded, s."""
_LOOK_TIMEOUT = 1.0
"""How long to look for another recorder where a router does not answer, s."""


class FlightRecorder(Node):
    """Keep the last seconds of all topics and logs of a robot, and write a file when something has happened.

    That is: a node dies or does not keep what is promised of it, the robot is stopped in an emergency, or somebody
    asks. A file has what came before and after, what processes have printed, parameters, states, and what `robo why`
    tells. Seconds are those of this machine, whatever clock the robot follows.
    """

    class Parameters(robo.Parameters):
        """What is kept, and where."""

        before: Annotated[
            float, Meta(ge=1, le=3600, description="kept before something happens"), Unit("s"), READ_ONLY
        ] = 30.0
        after: Annotated[float, Meta(ge=0, le=600, description="kept after it"), Unit("s"), READ_ONLY] = 2.0
        ring_size: Annotated[
            float, Meta(ge=1, le=100_000, description="what the last seconds may take; with more they are fewer"),
            Unit("MB"), READ_ONLY,
        ] = 64.0  # fmt: skip
        topics: Annotated[
            list[str],
            Meta(description="what is kept: names as in ROS, ** for all of the robot's namespace"),
            READ_ONLY,
        ] = field(default_factory=lambda: ["**", "/clock", "/tf", "/tf_static"])
        exclude: Annotated[list[str], Meta(description="and what is not"), READ_ONLY] = field(default_factory=list)
        stop_topics: Annotated[
            list[str],
            Meta(description="where it is told of emergency stops, as diagnostic/DiagnosticStatus"),
            READ_ONLY,
        ] = field(default_factory=lambda: ["safety_state"])
        again: Annotated[
            float,
            Meta(ge=0, le=86_400, description="the same of the same node makes another file after so long without it"),
            Unit("s"), READ_ONLY,
        ] = 60.0  # fmt: skip
        most_files: Annotated[int, Meta(ge=1, le=10_000, description="of several files the oldest go"), READ_ONLY] = 20
        most_size: Annotated[
            float, Meta(ge=1, le=1_000_000, description="what all files may take"), Unit("MB"), READ_ONLY
        ] = 500.0
        folder: Annotated[
            str, Meta(description="for the files; by default flight beside the logs of the robot's runs"), READ_ONLY
        ] = ""
        ring_folder: Annotated[
            str, Meta(description="for the last seconds; by default in memory, where the machine has such a folder"),
            READ_ONLY,
        ] = ""  # fmt: skip
        compression: Annotated[
            Literal["auto", "zstd", "none"], Meta(description="auto: zstd where it is installed"), READ_ONLY
        ] = "auto"

    parameters: Parameters

    snapshots = Publisher(Snapshot, SNAPSHOTS_TOPIC, latched=True, depth=_REMEMBERED)
    """The files that it has written, the last ones for whoever comes later."""

    _flight: Flight | None = None

    def on_start(self) -> None:
        """Begin to keep what comes."""
        p = self.parameters
        self._refuse_another()
        compression = best_compression() if p.compression == "auto" else p.compression
        compressor(compression)  # says what is missing
        robot = self.namespace.replace("/", ".") or "robot"
        settings = Settings(
            before=p.before,
            after=p.after,
            again=p.again,
            ring_size=round(p.ring_size * _MB),
            ring_bases=[Path(p.ring_folder)] if p.ring_folder else default_bases(),
            folder=Path(p.folder) if p.folder else log_base() / robot / "flight",
            most_files=p.most_files,
            most_size=round(p.most_size * _MB),
            compression=compression,
        )
        launched = SUPERVISED_VARIABLE in os.environ
        run = os.environ.get(RUN_VARIABLE) or new_run_id()
        recorder = Recorder(self.full_name, self.namespace, run, launched)
        selection = self._selection()
        self._stopped: dict[str, bool] = {}
        for topic in p.stop_topics:
            self.create_subscription(DiagnosticStatus, topic, self._watching(topic), latched=True)
        self._flight = Flight(self.session, recorder, settings, selection, self.logger, self.snapshots.publish)
        self._flight.start()

    def on_stop(self) -> None:
        """Write what is to be written, and leave nothing else."""
        if self._flight is not None:
            self._flight.close(_END)

    @service("~/snapshot", turn="snapshot")
    def snapshot(self, request: TakeSnapshot.Request) -> TakeSnapshot.Response:
        """Write what is kept and what comes within the next seconds; answered once there is a file."""
        assert self._flight is not None
        job = self._flight.happened("asked", "", request.reason)
        assert job is not None
        with paused():
            job.done.wait(2 * self.parameters.after + _LONGEST_WAIT)
        if job.snapshot is not None:
            return TakeSnapshot.Response(True, f"wrote {job.snapshot.file}", job.snapshot)
        return TakeSnapshot.Response(False, job.problem or "it takes too long")

    @check("flight_recorder")
    def all_is_kept(self) -> Health:
        """Whether the last seconds are kept, and the last file could be written."""
        flight = self._flight
        if flight is None:
            return Health.ok()
        if not flight.alive:
            return Health.error("nothing is kept: the flight recorder has ended")
        if flight.keeping.problem:
            return Health.error(f"nothing is kept: {flight.keeping.problem}")
        if flight.files.problem:
            return Health.error(f"no file could be written: {flight.files.problem}")
        return Health.ok(ring_size=flight.keeping.size, files=flight.files.count, left_out=flight.left_out)

    def _watching(self, topic: str) -> Callable[[DiagnosticStatus], None]:
        return partial(self._on_state, topic)

    def _on_state(self, topic: str, status: DiagnosticStatus) -> None:
        """Notice an emergency stop; one that holds when this begins is none that happens."""
        stopped = any(one.key == "reason" and one.value == "emergency_stop" for one in status.values)
        before, self._stopped[topic] = self._stopped.get(topic, True), stopped
        if stopped and not before and self._flight is not None:
            node = status.name if status.name.startswith("/") else ""
            self._flight.happened("emergency stop", node, status.message)

    def _selection(self) -> Selection:
        p = self.parameters
        try:
            return Selection(self._keys(p.topics), self._keys(p.exclude))
        except (BagError, InvalidName) as error:
            raise ParameterError(f"{self.full_name}: topics or exclude: {error}") from None

    def _keys(self, patterns: Sequence[str]) -> list[str]:
        """Patterns of names as key expressions."""
        return [names.key_of(one if one.startswith("/") else f"/{self.namespace}/{one}") for one in patterns]

    def _refuse_another(self) -> None:
        """
        Raises:
            FlightRecorderError: the robot has a flight recorder.
        """
        telling = {one.full_name for one in publishers_of(self.session, self.snapshots.topic, _LOOK_TIMEOUT)}
        telling.discard(self.full_name)
        if not telling:
            return
        found = map(parse_token, liveliness.ask(self.session, NodeToken.ALL, _LOOK_TIMEOUT))
        # One that is only starting, too, has no such token: the lock of the ring decides between the two.
        running = [one.full_name for one in found if isinstance(one, NodeToken) and one.full_name in telling]
        if running:
            raise FlightRecorderError(
                f"{self.full_name}: the robot has a flight recorder already, {running[0]}; one keeps all topics"
            )


if __name__ == "__main__":
    robo.run(FlightRecorder)
