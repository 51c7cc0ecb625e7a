"""Records topics of a robot into files that ROS 2 and its tools open: `robo bag record` for manifests."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta, field

import robo
from robo import READ_ONLY, Health, Node, Publisher, Unit, check, service, timer
from robo.bag.mcap.compression import best_compression
from robo.bag.options import Options
from robo.errors import BagError, InvalidName, ParameterError
from robo.machine.manifests import manifests_of
from robo.recording.naming import name_of, unused
from robo.recording.selection import Selection, beside_robot
from robo.wire import names
from robo_messages import DiagnosticStatus, KeyValue, Trigger

if TYPE_CHECKING:
    from robo.recording.recorder import Recorder as Recording
    from robo.recording.recorder import Status
    from robo.recording.tally import TopicFigures

_MB = 1_000_000
_MOST_TOLD = 100
"""Topics that are told of in the state."""
_PATIENCE = 5.0
"""After how long it is said of a topic that was named that nothing has come, s."""


class Recorder(Node):
    """Record topics into files, and tell how that goes. Each time it is started, a folder with a name of the time."""

    class Parameters(robo.Parameters):
        """What is recorded, and where."""

        topics: Annotated[
            list[str],
            Meta(description="what is recorded: names as in ROS, ** for all of the robot's namespace"),
            READ_ONLY,
        ] = field(default_factory=lambda: ["**"])
        exclude: Annotated[list[str], Meta(description="and what is not"), READ_ONLY] = field(default_factory=list)
        folder: Annotated[str, Meta(description="where recordings go"), READ_ONLY] = "recordings"
        autostart: Annotated[bool, Meta(description="record from the start, and not only when asked"), READ_ONLY] = True
        compression: Annotated[
            Literal["auto", "zstd", "none"], Meta(description="auto: zstd where it is installed"), READ_ONLY
        ] = "auto"
        split_size: Annotated[
            float, Meta(ge=0, le=1_000_000, description="a new file begins with this size; 0: never"),
            Unit("MB"), READ_ONLY,
        ] = 500.0  # fmt: skip
        split_duration: Annotated[
            float, Meta(ge=0, le=1e7, description="a new file begins after this time; 0: never"), Unit("s"), READ_ONLY
        ] = 0.0
        keep: Annotated[
            int, Meta(ge=0, le=100_000, description="files of a recording that are kept, the newest; 0: all"), READ_ONLY
        ] = 0
        least_free: Annotated[
            float, Meta(ge=0, le=100_000_000, description="what is left to others on the disk"), Unit("MB"), READ_ONLY
        ] = 200.0
        when_full: Annotated[
            Literal["stop", "drop_oldest"],
            Meta(description="where less is left: it ends, or deletes the oldest file"),
            READ_ONLY,
        ] = "stop"
        make_tf: Annotated[
            bool, Meta(description="make a tf of odometry where nobody publishes it"), READ_ONLY
        ] = True  # fmt: skip

    parameters: Parameters

    state = Publisher(DiagnosticStatus, "recorder_state", latched=True)
    """Whether it records, into which file, and how many messages came, were lost, malformed or left out, in all and by
    topic: once a second."""

    _recording: "Recording | None" = None
    _last: "Status | None" = None

    def on_start(self) -> None:
        """Begin to record, unless somebody is to ask for it."""
        self._selection()  # a mistake is told at once
        self._options()
        if self.parameters.autostart:
            self._begin()
        self._tell()

    def on_stop(self) -> None:
        """End what is recorded: its file is whole."""
        self._end()

    @service("~/start", turn="recorder")
    def start_recording(self, _request: Trigger.Request) -> Trigger.Response:
        """Begin a recording."""
        if self._is_recording():
            return Trigger.Response(success=False, message=f"it records already, {self._path}")
        self._end()
        try:
            self._begin()
        except BagError as error:
            return Trigger.Response(success=False, message=str(error))
        self._tell()
        return Trigger.Response(message=f"records into {self._path}")

    @service("~/stop", turn="recorder")
    def stop_recording(self, _request: Trigger.Request) -> Trigger.Response:
        """End the recording: its files are whole."""
        if not self._is_recording():
            return Trigger.Response(success=False, message="it does not record")
        status = self._end()
        assert status is not None
        self._tell()
        return Trigger.Response(not status.ended, status.ended or f"{self._path} has {status.received} messages")

    @service("~/split", turn="recorder")
    def split_recording(self, _request: Trigger.Request) -> Trigger.Response:
        """Go on in a new file."""
        if self._recording is None or not self._is_recording():
            return Trigger.Response(success=False, message="it does not record")
        try:
            self._recording.split()
        except BagError as error:
            return Trigger.Response(success=False, message=str(error))
        return Trigger.Response(message=f"goes on in {self._recording.status().files[-1]}")

    @service("~/snapshot", turn="recorder")
    def snapshot(self, _request: Trigger.Request) -> Trigger.Response:
        """Keep what has been recorded and is still there as a recording of its own, and go on."""
        if self._recording is None or not self._is_recording():
            return Trigger.Response(success=False, message="it does not record")
        folder = unused(self._path.with_name(f"{self._path.name}_snapshot"))
        try:
            files = self._recording.snapshot(folder)
        except BagError as error:
            return Trigger.Response(success=False, message=str(error))
        return Trigger.Response(message=f"{folder} has {len(files)} {'file' if len(files) == 1 else 'files'}")

    @timer(rate=1.0, turn="recorder")
    def watch(self) -> None:
        """Tell how it goes."""
        self._tell()

    @check("recording")
    def it_records(self) -> Health:
        """Whether what is asked for comes, and can be written."""
        status = self._last
        if status is None:
            return Health.ok("it does not record")
        if status.ended:
            return Health.error(status.ended)
        bad = {"lost": status.lost, "malformed": status.malformed, "left_out": status.left_out}
        figures = {"received": status.received, **bad}
        if status.missing and status.duration > _PATIENCE:
            return Health.warn(f"nothing has come on {', '.join(map(names.shown_key, status.missing))}", **figures)
        if any(bad.values()):
            words = (f"{count} {what.replace('_', ' ')}" for what, count in bad.items() if count)
            return Health.warn(f"of messages {', '.join(words)}", **figures)
        return Health.ok(**figures)

    def _is_recording(self) -> bool:
        return self._recording is not None and not self._recording.ended

    def _begin(self) -> None:
        from robo.recording.recorder import Recorder as Recording  # who only may record does without

        p = self.parameters
        self._path = path = unused(Path(p.folder) / name_of(time.time()))
        self._recording = Recording(
            self.session,
            path,
            self._selection(),
            self._options(),
            tell=self.logger.warning,
            make_tf=p.make_tf,
            manifests=manifests_of,
        )
        self._last = None
        self.logger.info("records into %s", path)

    def _end(self) -> "Status | None":
        """End the recording, if there is one, and tell how it went."""
        recording, self._recording = self._recording, None
        if recording is None:
            return None
        status = recording.stop()
        self._last = None
        self.logger.info("has recorded %d messages into %s", status.received, self._path)
        for key in status.missing:
            self.logger.warning("nothing came on %s", names.shown_key(key))
        return status

    def _tell(self) -> None:
        """Publish how it goes; that it has ended by itself, in the log once, too."""
        recording = self._recording
        status = recording.status() if recording is not None else None
        if status is not None and status.ended and not (self._last is not None and self._last.ended):
            self.logger.error("%s", status.ended)
        self._last = status
        if status is None:
            self.state.publish(DiagnosticStatus(DiagnosticStatus.OK, self.full_name, "does not record"))
            return
        bad = status.lost or status.malformed or status.left_out
        level = DiagnosticStatus.ERROR if status.ended else DiagnosticStatus.WARN if bad else DiagnosticStatus.OK
        values = {
            "file": status.files[-1] if status.files else "",
            "files": str(len(status.files)),
            "duration": f"{status.duration:.1f}",
            "size": str(status.size),
            "received": str(status.received),
            "lost": str(status.lost),
            "malformed": str(status.malformed),
            "left_out": str(status.left_out),
            "missing": " ".join(map(names.shown_key, status.missing)),
        }
        values.update((topic.topic, _words(topic)) for topic in status.topics[:_MOST_TOLD])
        pairs = [KeyValue(key, value) for key, value in values.items()]
        self.state.publish(DiagnosticStatus(level, self.full_name, status.ended or "records", values=pairs))

    def _options(self) -> Options:
        p = self.parameters
        try:
            return Options(
                compression=best_compression() if p.compression == "auto" else p.compression,
                split_size=round(p.split_size * _MB) or None,
                split_duration=p.split_duration or None,
                split_by_hand=True,
                keep=p.keep or None,
                least_free=round(p.least_free * _MB),
                when_full=p.when_full,
            )
        except BagError as error:
            raise ParameterError(f"{self.full_name}: {error}") from None

    def _selection(self) -> Selection:
        p = self.parameters
        try:
            asked = self._keys(p.topics)
            return Selection(asked, self._keys(p.exclude), beside_robot(asked, transforms=p.make_tf))
        except (BagError, InvalidName) as error:
            raise ParameterError(f"{self.full_name}: topics or exclude: {error}") from None

    def _keys(self, patterns: Sequence[str]) -> list[str]:
        """Patterns of names as key expressions."""
        return [names.key_of(one if one.startswith("/") else f"/{self.namespace}/{one}") for one in patterns]


def _words(topic: "TopicFigures") -> str:
    """How it goes with a topic."""
    rate = "" if topic.rate is None else f" at {topic.rate:.1f} Hz"
    bad = {"lost": topic.lost, "malformed": topic.malformed, "left out": topic.left_out}
    return ", ".join([f"{topic.received}{rate}", *(f"{count} {what}" for what, count in bad.items() if count)])


if __name__ == "__main__":
    robo.run(Recorder)
