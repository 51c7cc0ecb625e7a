"""The files of a flight recorder: written by a thread of their own, each whole or not at all."""

import os
import shutil
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Protocol

import msgspec

from robo.bag.edit.excerpt import excerpt
from robo.bag.mcap.compression import Compression
from robo.errors import BagError
from robo.recording.flight.evidence import Evidence, Witnesses, write_beside
from robo.recording.flight.shelf import Shelf, reasons_of, words_of
from robo.recording.flight.windows import Reason, Window, file_name
from robo.wire.discovery import hostname
from robo_messages import Snapshot, Time

_NICE = 10
"""Of the thread that writes a file: a robot has other things to do."""
"""Different things that are told once."""

Held = tuple[Path | None, list[list[Path]]]
"""A folder that is to be removed, and the files of the recordings in it."""


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What a flight recorder keeps, and where."""

    before: float
    """Kept before something happens, s."""
    after: float
    """And after it, s."""
    again: float
    """The same of the same node makes no other file within so long, s."""
    ring_size: int
    """Bytes."""
    ring_bases: Sequence[Path]
    """Where rings may be, the best first."""
    folder: Path
    """For files."""
    most_files: int
    most_size: int
    """Of all files together, bytes."""
    compression: Compression


class Recorder(NamedTuple):
    """Which flight recorder it is."""

    full_name: str
    namespace: str
    """Of its robot."""
    run: str
    """The id of its run, or one of its own."""
    launched: bool
    """Whether a supervisor runs it."""


class Log(Protocol):
    """Where it tells what happens."""

    def info(self, text: str, *values: object) -> None:
        """What goes as it should."""

    def warning(self, text: str, *values: object) -> None:
        """What may need somebody's attention."""

    def error(self, text: str, *values: object) -> None:
        """What does not work."""


class Job:
    """A file to be written."""

    def __init__(self, window: Window, run: str) -> None:
        """
        Args:
            window: what it is to have, by the recorder's clock.
            run: the id of the run that it is of.
        """
        self.window = window
        self.run = run
        self.behind = 0
        """By how much the machine's clock is ahead of that one, ns."""
        self.done = threading.Event()
        self.snapshot: Snapshot | None = None
        """What has come of it."""
        self.problem = ""
        """Why there is none."""


class FlightFiles:
    """Writes files, one at a time."""

    def __init__(
        self,
        recorder: Recorder,
        settings: Settings,
        witnesses: Witnesses,
        log: Log,
        tell_once: Callable[[str], object],
        publish: Callable[[Snapshot], None],
    ) -> None:
        """
        Args:
            recorder: whose files they are.
            settings: how many may be where.
            witnesses: know what is written beside messages.
            log: where it is told.
            tell_once: is told what is said once in a run.
            publish: is told each file.
        """
        self._recorder = recorder
        self._settings = settings
        self._witnesses = witnesses
        self._log = log
        self._tell_once = tell_once
        self._publish = publish
        self._shelf = Shelf(settings.folder, recorder.namespace)
        self._shelf.remove_drafts()
        self._writing = threading.Lock()
        self._writers: list[threading.Thread] = []
        self.problem = ""
        """Why the last file could not be written; empty where it was."""
        self.count = 0
        """Written so far."""

    @property
    def busy(self) -> bool:
        """Whether a file is being written, or what is known for it is being asked."""
        return any(writer.is_alive() for writer in self._writers)

    def reasons(self, since: int) -> set[int]:
        """When what has happened of which there are files that were written after a time, in ns since the epoch."""
        found = set()
        for path in self._shelf.files():
            with suppress(OSError):
                if path.stat().st_mtime_ns >= since:
                    found |= {time for time, _ in reasons_of(words_of(path))}
        return found

    def begin(self, job: Job, held: Held, patience: float) -> None:
        """Begin to write a file.

        Args:
            job: which.
            held: what it is made of.
            patience: with a supervisor that does not answer, s.
        """
        self._writers = [one for one in self._writers if one.is_alive()]
        writer = threading.Thread(target=self._write, args=(job, held, patience), name="robo-flight-file", daemon=True)
        self._writers.append(writer)
        writer.start()

    def finish(self, until: float) -> bool:
        """Wait until all is written, or a time by the monotonic clock; whether it is."""
        for writer in self._writers:
            writer.join(max(0.0, until - time.monotonic()))
        return not any(writer.is_alive() for writer in self._writers)

    def write_last_words(self, run: str, end: int, recordings: list[list[Path]]) -> bool:
        """Write what the recorder of a run has left that ended without a word.

        Args:
            run: its id.
            end: the last arrival, ns since the epoch.
            recordings: the files of each.

        Returns:
            Whether there is a file of it now.
        """
        begin = end - round(self._settings.before * 1e9)
        reason = Reason(end, "run ended", "", f"run {run} ended without stopping its flight recorder")
        job = Job(Window(begin, end + 1, end + 1, [reason]), run)
        with self._writing:
            self._try(job, recordings, Evidence())
        return job.snapshot is not None

    def _write(self, job: Job, held: Held, patience: float) -> None:
        with suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
        folder, recordings = held
        try:
            with self._writing:
                self._try(job, recordings, self._evidence(job, patience))
        finally:
            job.done.set()
            if folder is not None:
                shutil.rmtree(folder, ignore_errors=True)

    def _evidence(self, job: Job, patience: float) -> Evidence:
        """What others know; nothing where they cannot be asked: what was kept is written all the same."""
        try:
            return self._witnesses.testimony(job.window.begin + job.behind, patience)
        except Exception as error:
            self._tell_once(f"what supervisors and nodes know is not in the file: {error}")
            return Evidence()

    def _try(self, job: Job, recordings: list[list[Path]], evidence: Evidence) -> None:
        try:
            self._write_file(job, recordings, evidence)
        except Exception as error:
            job.problem = str(error) if isinstance(error, BagError | OSError) else f"{type(error).__name__}: {error}"
            if job.problem != self.problem:
                self.problem = job.problem
                self._log.warning("no file could be written: %s", job.problem)
        else:
            self.problem = ""

    def _write_file(self, job: Job, recordings: list[list[Path]], evidence: Evidence) -> None:
        window, settings = job.window.later(job.behind), self._settings
        words = self._words(window, job.run)

        def write(path: Path) -> None:
            excerpt(
                recordings,
                path,
                job.window.begin,
                job.window.due,
                lambda writer: write_beside(writer, window.due, evidence, window.nodes, words, self._tell_once),
                settings.compression,
                later=job.behind,
            )

        path = self._shelf.add(file_name(self._recorder.namespace, window), write)
        job.snapshot = Snapshot(
            stamp=Time.from_nanoseconds(window.first.time),
            file=str(path),
            host=hostname(),
            recorder=self._recorder.full_name,
            reasons=[one.line for one in window.reasons],
            nodes=window.nodes,
            begin=Time.from_nanoseconds(max(window.begin, 0)),
            end=Time.from_nanoseconds(window.due),
            size=path.stat().st_size,
        )
        self.count += 1
        gone = self._shelf.keep_newest(path, settings.most_files, settings.most_size)
        try:
            self._publish(job.snapshot)
        except Exception as error:  # there is a file, whoever hears of it
            self._tell_once(f"nobody is told of {path}: {error}")
        self._log.info("wrote %s: %s", path, window.text)
        if gone:
            self._log.info("%d older files are gone, the last one %s", len(gone), gone[-1])

    def _words(self, window: Window, run: str) -> dict[str, str]:
        """For the metadata."""
        who = self._recorder
        return {
            "robot": who.namespace,
            "recorder": who.full_name,
            "host": hostname(),
            "run": run,
            "time": str(window.first.time),
            "begin": str(window.begin),
            "end": str(window.due),
            "nodes": " ".join(window.nodes),
        } | {f"reason_{number}": f"{one.time} {one.kind}: {one.line}" for number, one in enumerate(window.reasons)}
