"""Recording what topics say, beside whoever has it done: on a thread of its own, with all that belongs into a file."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path

import msgspec
import zenoh

from robo.bag import Options, Recording, TopicInFile
from robo.bag.of_robot import ABOUT
from robo.errors import BagError, DiskFull
from robo.recording.about import About, Manifests, Watch, no_manifests
from robo.recording.conversion import Conversion, Converted, Refused
from robo.recording.intake import MOST_BYTES, Intake
from robo.recording.odometry import TransformsOfOdometry
from robo.recording.selection import Selection
from robo.recording.tally import Tally, TopicFigures
from robo.text.brief import brief
from robo.text.files import size_of

PERIOD = 0.05
"""How often what has come is written down, s."""

MADE = "robo.made"
"""The metadata that say which topics nobody published, and of which they were made."""

_MOST_TOPICS = 20_000
"""Of one recording: a stranger that makes some up ends none."""


class Status(msgspec.Struct, frozen=True):
    """How a recording goes, or went."""

    files: list[str]
    """The oldest first."""
    duration: float
    """Since it began, s."""
    size: int
    """Of the files, bytes."""
    topics: list[TopicFigures]
    left_out: int
    """Messages that were not written down because too many waited; those that are counted are among the lost."""
    missing: list[str]
    """What was asked for, and of which nothing came."""
    ended: str
    """Why it has ended by itself; empty where it has not."""

    @property
    def received(self) -> int:
        """Messages of all topics that were published."""
        return sum(topic.received for topic in self.topics if not topic.made_of)

    @property
    def lost(self) -> int:
        """Messages of all topics that did not come."""
        return sum(topic.lost for topic in self.topics)

    @property
    def malformed(self) -> int:
        """Messages of all topics that came and could not be written down."""
        return sum(topic.malformed for topic in self.topics)


class Recorder:
    """Records a selection of topics from when it is made until `stop`."""

    def __init__(
        self,
        session: zenoh.Session,
        path: str | Path,
        selection: Selection,
        options: Options | None = None,
        *,
        tell: Callable[[str], object],
        make_tf: bool = True,
        manifests: Manifests = no_manifests,
        most_bytes: int = MOST_BYTES,
    ) -> None:
        """
        Args:
            session: the network.
            path: of the file; of the folder where there are to be several.
            selection: the topics.
            options: how it is written.
            tell: is told, by another thread, what is not written down as it should be, once for each topic.
            make_tf: whether transforms are made of odometry where nobody publishes them.
            manifests: has those of runs.
            most_bytes: what may wait to be written down.

        Raises:
            BagError: the file cannot be made, is there already, or the library for its compression is not installed.
        """
        self._recording = Recording(path, options)
        self._selection = selection
        self._begin = time.monotonic()
        self._duration: float | None = None
        self._ended = ""
        self._work = threading.RLock()
        self._over = threading.Event()
        self._done = threading.Event()
        """Not by `join`: one that Ctrl-C interrupts takes its thread for ended (CPython 3.11)."""
        self._news: deque[About] = deque()
        self._topics: dict[TopicInFile, int] = {}
        self._left_out: Counter[str] = Counter()
        self._tally = Tally()
        wanted = TransformsOfOdometry(self._is_published, lambda topic: not selection.excludes(topic))
        self._made = wanted if make_tf else None
        self._told_made = 0
        self._tell = tell
        with ExitStack() as undo:
            undo.callback(self._recording.discard)
            self._intake = Intake(session, selection, most_bytes, self._offer_changed, self._recording.forget)
            undo.callback(self._intake.close)
            self._conversion = Conversion(tell, self._intake.offers.of, self._refused)
            self._watch = Watch(session, self._news.append, tell, manifests)
            undo.pop_all()
        threading.Thread(target=self._run, name="robo-record", daemon=True).start()

    @property
    def ended(self) -> str:
        """Why it has ended by itself, as when the disk is full; empty where it has not."""
        return self._ended

    def wait(self, timeout: float) -> bool:
        """Wait until it has ended by itself, or for some time, s; whether it has."""
        return self._done.wait(timeout)

    def status(self) -> Status:
        """How it goes, or went. Rates are those since it was last asked, a second ago at the least."""
        with self._work:
            over = self._duration is not None
            made = self._made.made if self._made is not None else {}
            duration = time.monotonic() - self._begin if self._duration is None else self._duration
            malformed = self._conversion.malformed
            counts = self._recording.counts
            figures = self._tally.figures(time.monotonic(), counts, malformed, made, over=over)
            files = self._recording.files
            missing = self._selection.missing([*self._tally.came, *malformed])
            left_out = sum(self._left_out.values())
        return Status(
            list(map(str, files)), duration, sum(map(size_of, files)), figures, left_out, missing, self._ended
        )

    def split(self) -> None:
        """Go on in another file.

        Raises:
            BagError: it is one file, has ended, or the next one cannot be made.
        """
        with self._work:
            at = time.time_ns()  # nothing is older that comes behind what is said again
            self._write_what_came()
            self._recording.split(at)

    def snapshot(self, folder: Path) -> list[Path]:
        """Keep what has been recorded so far, and is still there, as a recording of its own; go on in another file.

        Args:
            folder: of the new recording.

        Returns:
            Its files.

        Raises:
            BagError: as `split`; or the folder is there already, or cannot be made.
        """
        with self._work:
            at = time.time_ns()
            self._write_what_came()
            return self._recording.snapshot(folder, at)

    def stop(self) -> Status:
        """End: what has come is written, and the file is whole. Once more only tells again how it went."""
        if self._duration is None:
            self._over.set()
            self._done.wait()
        return self.status()

    def _run(self) -> None:
        try:
            try:
                while not self._over.wait(PERIOD):
                    self._write()
            finally:
                self._leave()
            self._write()
        except BaseException as error:  # whatever it is, nobody may believe that it goes on
            self._ended = _why(error)
        finally:
            self._close()

    def _leave(self) -> None:
        """Listen no more."""
        for leave in (self._intake.close, self._watch.close):
            with suppress(Exception):  # the network has been left already; and the file is to become whole
                leave()

    def _write(self) -> None:
        with self._work:
            self._write_what_came()
            self._recording.tick()

    def _close(self) -> None:
        with self._work:
            try:
                self._recording.close()
            except Exception as error:
                self._ended = self._ended or _why(error)
            finally:
                self._duration = time.monotonic() - self._begin
                self._done.set()

    def _write_what_came(self) -> None:
        convert, made = self._conversion.convert, self._made
        for came in self._intake.take():
            message = convert(came)
            if message is None:
                continue
            self._put(message)
            if made is not None and (transform := made.take(message)) is not None:
                self._put(transform)
        if made is not None and len(made.made) != self._told_made:
            self._told_made = len(made.made)
            self._recording.add_metadata(MADE, made.made)
            self._tell(f"{', '.join(made.made)}: nobody publishes these transforms, so they are made of odometry")
        left_out = self._intake.left_out()
        for topic, count in (left_out - self._left_out).items():
            self._recording.left_out(topic, count)
        self._left_out = left_out
        while self._news:
            self._say(self._news.popleft())

    def _refused(self, message: Refused) -> None:
        self._recording.malformed(*message)

    def _put(self, message: Converted) -> None:
        number = self._topics.get(message.topic)
        if number is None:
            number = self._new_topic(message.topic)
            if number is None:
                refused = Refused(message.topic.name, message.sequence, message.published, message.source)
                self._conversion.refuse(refused, f"more than {_MOST_TOPICS:,} topics go into no recording")
                return
        try:
            self._recording.write(
                number, message.data, message.arrived, message.published, message.sequence, message.source
            )
        except DiskFull:
            self._tally.add(message)  # this one is still in
            raise
        self._tally.add(message)

    def _new_topic(self, topic: TopicInFile) -> int | None:
        if len(self._topics) >= _MOST_TOPICS:
            return None
        number = self._topics[topic] = self._recording.topic(topic)
        return number

    def _is_published(self, topic: str) -> bool:
        return bool(self._intake.offers.of(topic).publishers)

    def _offer_changed(self, topic: str) -> None:
        self._conversion.forget(topic)

    def _say(self, about: About) -> None:
        now = time.time_ns()
        for one in about.attachments:
            self._recording.attach(one.name, one.data, one.media_type, now)
        self._recording.add_metadata(ABOUT, about.metadata)


def _why(error: BaseException) -> str:
    """Why a recording has ended."""
    if isinstance(error, BagError | zenoh.ZError):
        return str(error)
    return brief(f"the recording has failed: {type(error).__name__}: {error}")
