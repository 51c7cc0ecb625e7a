"""`robo view rerun`: robots and recordings in Rerun."""

import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple, NoReturn

from robo import bag
from robo.bag.of_robot import only_robot
from robo.bag.patterns import chosen
from robo.bridges.rerun.feed import Feed
from robo.bridges.rerun.pace import Pace
from robo.bridges.rerun.sink import Sink, import_rerun
from robo.bridges.rerun.viewer import Viewer, has_display
from robo.cli.connection import connect_to_robot, nodes_of
from robo.cli.printing import amount, note, print_line
from robo.cli.reach import Reach
from robo.cli.views.bag_progress import progress
from robo.errors import UsageError
from robo.text.terminal import visible
from robo.wire import names

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
    sink = Sink(Path(asked.recording).stem if asked.recording is not None else reach.namespace or "")
    viewer = _target(sink, asked)
    try:
        with _ended_by_term():
            # Of a recording all is drawn, as nobody waits for it.
            rate = asked.rate if asked.rate is not None else 0.0 if asked.recording is not None else None
            feed = Feed(sink, Pace(rate))
            _feed(feed, reach, asked, viewer)
            if viewer is not None and asked.recording is not None:
                sink.flush()
                _wait(viewer, asked.duration)
    finally:
        sink.close()
        if viewer is not None:
            viewer.close()
    return _told(feed, asked)


def _check(asked: Asked) -> None:
    if asked.save is None:
        return
    if asked.save.suffix.lower() != ".rrd":
        raise UsageError(f"--save {asked.save}: end its name in .rrd")
    if asked.save.exists() and not asked.force:
        raise UsageError(f"--save {asked.save} is there already: say another name, or --force")


def _target(sink: Sink, asked: Asked) -> Viewer | None:
    if asked.save is not None or asked.place is None:
        assert asked.save is not None
        sink.save(asked.save)
        return None
    port, web_port = asked.place
    if web_port is None and not has_display():
        note("there is no display: it is shown in a browser")
        web_port = asked.web_port
    viewer = Viewer(port, asked.memory, web_port)
    sink.connect(port)
    if viewer.address:
        print_line(f"Rerun is at {viewer.address}; Ctrl-C ends it")
    return viewer


def _feed(feed: Feed, reach: Reach, asked: Asked, viewer: Viewer | None) -> None:
    def goes_on() -> bool:
        return viewer is None or viewer.is_open

    if asked.recording is not None:
        with progress(f"reading {asked.recording}") as tell, bag.open(asked.recording) as recording:
            names_ = _recorded_names(recording, reach, asked)
            feed.recorded(recording, names_, goes_on, tell)
        return
    with connect_to_robot(reach) as session:
        nodes_of(session, reach)
        end = time.monotonic() + asked.duration if asked.duration is not None else None
        with suppress(KeyboardInterrupt):  # which is how it ends; the file is whole all the same
            feed.live(session, _keys(reach, asked.topics), goes_on, end)


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


@contextmanager
def _ended_by_term() -> Iterator[None]:
    """SIGTERM ends it as Ctrl-C does, so that neither a file is cut nor a viewer left."""

    def end(number: int, frame: object) -> NoReturn:
        del number, frame
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


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
