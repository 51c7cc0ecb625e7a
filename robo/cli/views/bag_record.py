"""`robo bag record`: what is seen while it records, and what it has recorded."""

import re
import signal
import sys
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal

import zenoh
from rich import box
from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from robo.bag import Options
from robo.cli.connection import join_robot
from robo.cli.link import Link
from robo.cli.printing import amount, data_size, note, print_json, print_line, print_table
from robo.cli.reach import Reach
from robo.cli.views.screen import Screen
from robo.errors import BagError, UsageError
from robo.machine.manifests import manifests_of
from robo.process.endings import raised_by_signals
from robo.recording.naming import name_of, unused
from robo.recording.recorder import Recorder, Status
from robo.recording.selection import EVERYTHING, Selection, beside_robot
from robo.recording.tally import TopicFigures
from robo.text.brief import shown
from robo.text.suggestions import suggest
from robo.text.terminal import visible
from robo.tools import topics
from robo.wire.names import shown_key

if TYPE_CHECKING:
    from robo.cli.record_words import RecordWords

_PERIOD = 0.5
"""How often it is drawn, s."""
_PATIENCE = 3.0
"""After how long it is said of what was asked for that nothing has come, s."""
_TELL = 60.0
"""How often it is said in a line how it goes where nothing is drawn, s."""
_LOOK = 0.1
"""How often it is looked whether it is over, s."""

_WIDE = 100
"""From how many columns on there is room for types."""
_WIDEST = 140
"""Beyond it numbers would stand too far from their names."""
_MOST_DIGITS = 15
_SIZE = re.compile(r"(\d+(?:\.\d+)?) ?([kKMGT]?)(i?)B?")
_FACTORS = {"": 0, "k": 1, "K": 1, "M": 2, "G": 3, "T": 4}
_LEAST_SPLIT = 100_000
"""Of files that somebody wants, bytes: for less a unit was forgotten."""
_OPTION = re.compile(r"\b(compression|split_size|split_duration|keep|least_free|when_full)\b")
_COLUMNS = ("TOPIC", "TYPE", "MESSAGES", "RATE", "LOST", "MALFORMED", "SIZE")


def record(names: list[str] | None, reach: Reach, words: "RecordWords", *, json: bool) -> int:
    """Record until Ctrl-C, SIGTERM, or the time is over.

    Returns:
        1 where nothing was recorded, or something that was named never came, or the disk is full.

    Raises:
        RoboError: the words make no sense, the file cannot be made, or no robot can be reached.
    """
    keys = keys_of(names, words, reach)
    selection = _selection(keys, words, reach)
    options = _options(words)
    path = path_of(words, time.time())
    session = join_robot(reach)
    with _Signals() as signals:
        try:
            told: deque[str] = deque()
            tf = not words.no_tf
            recorder = Recorder(session, path, selection, options, tell=told.append, make_tf=tf, manifests=manifests_of)
            view: _View | None = None
            try:
                note(f"recording {', '.join(map(shown_key, keys))} to {path}")
                view = _View(recorder, told, Link(session, reach), path, live=sys.stdout.isatty() and not json)
                with signals.raised():
                    view.follow(session, reach, words.duration)
            except KeyboardInterrupt:
                pass
            finally:
                status = recorder.stop()
            if view is not None:
                view.tell()
            return _tell_end(status, path, json=json, everything=words.everything)
        finally:
            with suppress(zenoh.ZError):  # nothing was said that a router has to take
                session.close()


def keys_of(names: list[str] | None, words: "RecordWords", reach: Reach) -> list[str]:
    """The key expressions of the topics that are meant.

    Raises:
        UsageError: none are named, or some beside all.
        InvalidName: a word is no name.
    """
    if words.everything and names:
        raise UsageError(f"--all has {', '.join(names)} too: say one of both; --exclude leaves topics out")
    if words.everything:
        return [f"{reach.namespace}/{EVERYTHING}" if reach.namespace else EVERYTHING]
    if not names:
        raise UsageError("say which topics are to be recorded, such as r1/odom or 'r1/**', or --all")
    return [reach.key(name) for name in names]


def path_of(words: "RecordWords", now: float) -> Path:
    """Where the recording goes: what somebody says, or a name of the time of now, s since the epoch.

    A file has `.mcap`, by which its kind is told, and a folder has not.
    """
    splits = words.split_size is not None or words.split_duration is not None
    if words.output is None:
        return unused(Path(name_of(now) if splits else f"{name_of(now)}.mcap"))
    path = Path(words.output)
    if (path.suffix == ".mcap") != splits or not path.name or path.is_dir():  # the last one is refused
        return path
    return path.with_suffix("") if splits else path.with_name(f"{path.name}.mcap")


def size_of(text: str, option: str) -> int:
    """A number of bytes: `500MB`, `2GiB`, `1000`.

    Raises:
        UsageError: it is none.
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None or len(match[1]) > _MOST_DIGITS:
        raise UsageError(f"{option} {shown(text)}: use a size such as 500MB, 2GB or a number of bytes")
    number, prefix, binary = match.groups()
    factor: int = (1024 if binary else 1000) ** _FACTORS[prefix]
    return round(float(number) * factor)


def _selection(keys: Sequence[str], words: "RecordWords", reach: Reach) -> Selection:
    beside = beside_robot(keys, transforms=not words.no_tf)
    try:
        return Selection(keys, [reach.key(name) for name in words.exclude or ()], beside)
    except BagError as error:
        raise UsageError(str(error)) from None


def _options(words: "RecordWords") -> Options:
    if words.duration is not None and not words.duration > 0:
        raise UsageError(f"--duration {words.duration}: use a number of seconds above 0")
    size = size_of(words.split_size, "--split-size") if words.split_size is not None else None
    if size is not None and 0 < size < _LEAST_SPLIT:
        raise UsageError(f"--split-size {shown(words.split_size)} is {size:,} bytes; use 100kB or more, such as 500MB")
    try:
        return Options(
            compression=words.compression,
            split_size=size,
            split_duration=words.split_duration,
            keep=words.keep,
            least_free=size_of(words.least_free, "--least-free"),
            when_full=words.when_full,
        )
    except BagError as error:
        raise UsageError(_OPTION.sub(lambda found: f"--{found[0].replace('_', '-')}", str(error))) from None


class _Signals:
    """SIGTERM, and a terminal that is closed, end a recording as Ctrl-C does: its file is whole.

    So does SIGINT for one that a script has started in the background, where it is ignored at first. The first of them
    counts; no further one keeps the end of the file from being written.
    """

    def __init__(self) -> None:
        self._before: dict[int, Any] = {}
        self._came = False
        self._raises = False

    def __enter__(self) -> "_Signals":
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # as nohup has it
                self._before[number] = signal.signal(number, self._take)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @contextmanager
    def raised(self) -> Iterator[None]:
        """Within it a signal is a KeyboardInterrupt, also one that has come before."""
        self._raises = True
        try:
            if self._came:
                raise KeyboardInterrupt
            with raised_by_signals():
                yield
        finally:
            self._raises = False

    def _take(self, _number: int, _frame: FrameType | None) -> None:
        is_first, self._came = not self._came, True
        if is_first and self._raises:
            raise KeyboardInterrupt


class _View:
    """What is seen of a recording while it goes on."""

    def __init__(self, recorder: Recorder, told: deque[str], link: Link, path: Path, *, live: bool) -> None:
        self._recorder = recorder
        self._told = told
        self._link = link
        self._path = path
        self._console = Screen() if live else None
        self._display: Live | None = None

    def follow(self, session: zenoh.Session, reach: Reach, duration: float | None) -> None:
        """Look on until the time is over, or the recording has ended."""
        if self._console is None:
            self._follow(session, reach, duration)
            return
        with Live(console=self._console, auto_refresh=False, transient=True) as self._display:
            try:
                self._follow(session, reach, duration)
            finally:
                self._display = None

    def tell(self) -> None:
        """Say what there is to know."""
        while self._told:
            self._note(visible(self._told.popleft()))

    def _follow(self, session: zenoh.Session, reach: Reach, duration: float | None) -> None:
        begin = drawn = time.monotonic()
        asked = False
        while not self._recorder.wait(_LOOK):
            now = time.monotonic()
            if duration is not None and now - begin >= duration:
                return
            if changed := self._link.look():
                self._note(changed)
            self.tell()
            if not asked and now - begin >= _PATIENCE:
                asked = True
                self._tell_what_is_missing(session, reach)
            if self._display is not None and self._console is not None and now - drawn >= _PERIOD:
                drawn = now
                picture = render(self._recorder.status(), self._path, self._console.width, self._console.height)
                self._display.update(picture, refresh=True)
            elif self._display is None and now - drawn >= _TELL:
                drawn = now
                self._note(f"so far {_sum(self._recorder.status(), self._path)}")

    def _tell_what_is_missing(self, session: zenoh.Session, reach: Reach) -> None:
        status = self._recorder.status()
        if status.missing:
            asked = [key for key in status.missing if "*" not in key]
            found = topics.list_topics(session, reach.timeout, asked)
            publishers = {topic.key: topic.publishers for topic in found if topic.publishers}
            for text in missing_so_far(status.missing, publishers, [one.topic for one in status.topics]):
                self._note(text)

    def _note(self, text: str) -> None:
        if self._display is not None:
            self._display.console.print(Text(text))
        else:
            note(text)


def missing_so_far(
    missing: Sequence[str], publishers: Mapping[str, Sequence[str]], recorded: Sequence[str]
) -> list[str]:
    """What to say of topics that were named, and of which nothing has come so far.

    Args:
        missing: those topics.
        publishers: of each topic that has some, their names; none where a busy router has not answered in time.
        recorded: the topics of which something has come.
    """
    told = []
    for key in missing:
        text = f"nothing has come on {shown_key(key)} yet"
        if key in publishers:
            text += f": {', '.join(publishers[key])} would publish it"
        elif "*" not in key:
            text += f": nobody publishes it so far; {suggest(key, [*publishers, *recorded])}"
        told.append(visible(text))
    return told


def render(status: Status, path: Path, width: int, height: int) -> RenderableType:
    """A picture of a recording that goes on, no higher than a terminal."""
    head = Text(no_wrap=True, overflow="ellipsis")
    head.append("recording", style="bold red")
    head.append(f"  {status.duration:.0f} s  {data_size(status.size)}  {visible(str(path))}  ")
    head.append(f"{status.received:,} messages")
    if status.lost:
        head.append(f"  {status.lost:,} lost", style="bold yellow")
    if status.malformed:
        head.append(f"  {status.malformed:,} malformed", style="bold yellow")
    if status.left_out:
        head.append(f"  {status.left_out:,} left out", style="bold yellow")
    head.append("  Ctrl-C ends", style="dim")
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, width=min(width, _WIDEST), padding=(0, 1, 0, 0))
    shown = [number for number, name in enumerate(_COLUMNS) if name != "TYPE" or width >= _WIDE]
    for number in shown:
        is_text = _COLUMNS[number] in ("TOPIC", "TYPE")
        justify: Literal["left", "right"] = "left" if is_text else "right"
        table.add_column(
            _COLUMNS[number], no_wrap=True, overflow="ellipsis", ratio=1 if is_text else None, justify=justify
        )
    rows = [_row(topic) for topic in status.topics]
    most = max(height - 5, 1)
    for row in rows if len(rows) <= most else rows[: most - 1]:
        table.add_row(*(Text(row[number]) for number in shown))
    if len(rows) > most:
        table.add_row(Text(f"… {len(rows) - most + 1} more", style="dim"))
    return Group(head, table)


def _row(topic: TopicFigures) -> tuple[str, ...]:
    rate = "-" if topic.rate is None else f"{topic.rate:.1f} Hz"
    kind = topic.type or "-"
    if topic.made_of:
        kind = f"{kind}, made of {topic.made_of}"
    elif topic.encoding not in ("cdr", ""):
        kind = f"{kind}, as {topic.encoding}"
    counts = (f"{topic.received}", rate, f"{topic.lost}", f"{topic.malformed}", data_size(topic.size))
    return (visible(topic.topic), visible(kind), *counts)


def _tell_end(status: Status, path: Path, *, json: bool, everything: bool) -> int:
    """Say what was recorded; the exit code."""
    if json:
        print_json(status)
    else:
        if status.topics:
            print_table([_COLUMNS, *map(_row, status.topics)], spared=("TYPE",))
        print_line(_sum(status, path))
    for key in status.missing:
        note(f"nothing came on {shown_key(key)}")
    if status.ended:
        note(f"error: {status.ended}")
    if not status.received:
        note(f"nothing was recorded{'' if everything else '; robo topic list shows what there is'}")
    return 1 if status.missing or status.ended or not status.received else 0


def _sum(status: Status, path: Path) -> str:
    """All of it in a line."""
    count = sum(1 for topic in status.topics if topic.received and not topic.made_of)
    words = [
        f"{path}: {data_size(status.size)}, {amount(status.received, 'message')} of {amount(count, 'topic')}"
        f" in {status.duration:.1f} s"
    ]
    if len(status.files) > 1:
        words.append(amount(len(status.files), "file"))
    words += [
        f"{number:,} {what}" for number, what in ((status.lost, "lost"), (status.malformed, "malformed")) if number
    ]
    if status.left_out:
        words.append(f"{status.left_out:,} left out: they came faster than they could be written")
    return ", ".join(words)
