"""`robo view rerun`: robots and recordings in Rerun."""

import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from robo import bag
from robo.bag.forms.choice import form_of_input
from robo.bag.of_robot import only_robot
from robo.bridges.rerun.feed import Feed
from robo.bridges.rerun.pace import Pace
from robo.bridges.rerun.sink import Sink, import_rerun
from robo.bridges.rerun.viewer import Viewer, has_display
from robo.cli.connection import connect_to_robot, nodes_of
from robo.cli.ending import ended_by_signals
from robo.cli.link import watched
from robo.cli.printing import amount, note, print_line
from robo.cli.reach import Reach
from robo.cli.views.bag_progress import progress
from robo.errors import BagError, UsageError
from robo.process.endings import raised_by_signals
from robo.text.patterns import chosen
from robo.text.terminal import visible
from robo.wire import names

_SIZE = re.compile(r"\d{1,9}(\.\d{1,9})?(B|[kKMGT]i?B|%)")
_PERIOD = 0.2
"""How often it is looked whether a viewer is closed, s."""


class Asked(NamedTuple):
    """What is asked for."""

    recording: str | None
    topics: Sequence[str]
    save: Path | None
    force: bool
    place: tuple[int, int | None] | None
    """Ports of the viewer, and of its page where it is to be in a browser; None for a file."""
    web_port: int
    """Of its page where there is no display."""
    memory: str
    rate: float | None
    duration: float | None


def show(reach: Reach, asked: Asked) -> int:
    """Show it.

    Returns:
        1 where there was nothing to see.

    Raises:
        UsageError: words make no sense, or the file is there already.
        RunError: Rerun is not installed, or its viewer does not begin.
        NetworkError: no robot runs there, or a port is taken.
        BagError: the recording cannot be read.
    """
    _check(asked)
    import_rerun()  # what is missing is told before anything is dialled
    with ended_by_signals():
        if asked.recording is not None:
            feed = _show_recording(asked, asked.recording, reach)
        else:
            feed = _show_live(asked, reach)
    return _told(feed, asked)


def _show_recording(asked: Asked, path: str, reach: Reach) -> Feed:
    with suppress(BagError):  # which the reader tells better
        if form_of_input(path) != "mcap":
            raise UsageError(f"{path}: make a recording of it first: robo bag convert {path} -o NEW.mcap")
    with bag.open(path) as recording:
        meant = _recorded_names(recording, reach, asked)
        with _target(asked, Path(path).stem) as (sink, viewer):
            # Nobody waits for it, so all is drawn.
            feed = Feed(sink, Pace(asked.rate or 0.0))
            with progress(f"reading {path}") as tell:
                feed.recorded(recording, meant, _goes_on(viewer), tell)
            if viewer is not None:
                _wait(viewer, asked.duration)
            return feed


def _show_live(asked: Asked, reach: Reach) -> Feed:
    with connect_to_robot(reach) as session, watched(session, reach):
        nodes_of(session, reach)
        with _target(asked, reach.namespace) as (sink, viewer):
            feed = Feed(sink, Pace(asked.rate))
            end = time.monotonic() + asked.duration if asked.duration is not None else None
            # Which is how it ends; the file is whole all the same.
            with suppress(KeyboardInterrupt), raised_by_signals():
                feed.live(session, _keys(reach, asked.topics), _goes_on(viewer), end)
            if viewer is None:
                feed.flush(_goes_on(None))
            return feed


def _check(asked: Asked) -> None:
    if not _SIZE.fullmatch(asked.memory):
        raise UsageError(f"--memory {asked.memory}: write a size such as 1GiB or 500MB, or a part of all such as 50%")
    if asked.place is not None:
        port, web_port = asked.place
        if port == (web_port or (None if has_display() else asked.web_port)):
            raise UsageError(f"--port and --web-port are both {port}: the viewer and its page need one each")
    if asked.save is None:
        return
    if asked.save.suffix.lower() != ".rrd":
        raise UsageError(f"--save {asked.save}: end its name in .rrd")
    if asked.save.exists() and not asked.force:
        raise UsageError(f"--save {asked.save} is there already: say another name, or --force")


@contextmanager
def _target(asked: Asked, name: str) -> Iterator[tuple[Sink, Viewer | None]]:
    """The file or the viewer, which ends with us."""
    viewer: Viewer | None = None
    if asked.place is not None:
        port, web_port = asked.place
        if web_port is None and not has_display():
            note("there is no display: it is shown in a browser")
            web_port = asked.web_port
        viewer = Viewer(port, asked.memory, web_port)
    with ExitStack() as stack:
        if viewer is not None:
            stack.callback(viewer.close)
        sink = Sink(name)
        stack.callback(_end, sink, viewer, asked.save)
        if asked.save is not None:
            sink.save(asked.save)
        elif asked.place is not None:
            sink.connect(asked.place[0])
        if viewer is not None and viewer.address:
            print_line(f"Rerun is at {viewer.address}; Ctrl-C ends it")
        yield sink, viewer


def _end(sink: Sink, viewer: Viewer | None, file: Path | None) -> None:
    if not sink.flush() and viewer is not None:
        viewer.close()  # else it would be waited for what it takes no more
    sink.close()
    if file is not None and sink.is_file and sink.is_empty:
        file.unlink(missing_ok=True)


def _goes_on(viewer: Viewer | None) -> Callable[[], bool]:
    return lambda: viewer is None or viewer.is_open


def _recorded_names(recording: bag.Bag, reach: Reach, asked: Asked) -> list[str]:
    there = recording.topics
    if reach.namespace:
        there = {name: topic for name, topic in there.items() if name.startswith(f"{reach.namespace}/")}
        if not there:
            raise UsageError(f"{asked.recording}: it has no topics of {reach.namespace}")
    meant = chosen(there, asked.topics, (), asked.recording or "", robot=reach.namespace or only_robot(recording))
    return [name for name in there if meant(name) and recording.topics[name].known is not None]


def _keys(reach: Reach, topics: Sequence[str]) -> list[str]:
    if not topics:
        return [names.join(reach.namespace, "**") if reach.namespace else "**"]
    return [reach.key(topic) for topic in topics]


def _wait(viewer: Viewer, duration: float | None) -> None:
    """Until somebody closes it, or has seen enough."""
    end = time.monotonic() + duration if duration is not None else None
    with suppress(KeyboardInterrupt):
        while viewer.is_open and (end is None or time.monotonic() < end):
            time.sleep(_PERIOD)


def _told(feed: Feed, asked: Asked) -> int:
    if feed.left_out:
        note(f"{amount(feed.left_out, 'message')} left out, for which Rerun was too slow")
    if feed.unreadable:
        note(f"{amount(feed.unreadable, 'message')} could not be read")
    if not feed.drawn:
        note("nothing came that could be shown")
        return 1
    if asked.save is not None:
        print_line(visible(f"{asked.save}: {amount(feed.drawn, 'message')}"))
    return 0
