"""`robo bag cut`, `filter`, `merge` and `recover`: new recordings made of others."""

from collections.abc import Sequence

from robo import bag
from robo.bag.edit.editing import Edited
from robo.bag.mcap.compression import Compression
from robo.bag.moments import moment
from robo.bag.of_robot import only_robot
from robo.cli.printing import amount, data_size, note, print_line
from robo.cli.views.bag_progress import progress
from robo.cli.views.bag_times import duration
from robo.errors import BagError, UsageError
from robo.text.dates import date
from robo.text.patterns import chosen
from robo.text.terminal import visible


def cut(path: str, output: str, start: str | None, end: str | None, compression: Compression, *, force: bool) -> None:
    """Make a recording of a part of the time of another.

    Raises:
        UsageError: no time is said, or it is none.
        BagError: nothing came in it, or a file cannot be read or written.
    """
    if start is None and end is None:
        raise UsageError("say from when or up to when: --start, --end or both")
    with progress(f"cutting {path}") as tell:
        with bag.open(path) as opened:
            first, last = opened.begin, opened.end
            known = bool(opened.count) and not opened.faults
        begin = moment(start, first, last, "--start") if start is not None else None
        until = moment(end, first, last, "--end") if end is not None else None
        if begin is not None and until is not None and begin >= until:
            raise UsageError(f"--end {end} is not after --start {start}")
        if known and ((begin is not None and begin > last) or (until is not None and until <= first)):
            there = f"it begins {date(first)} and lasts {duration(last - first)}"
            raise BagError(f"nothing is there at that time: {there}", path)
        _tell(bag.cut(path, output, begin, until, compression, force=force, tell=tell))


def keep(
    path: str, output: str, topics: Sequence[str], exclude: Sequence[str], compression: Compression, *, force: bool
) -> None:
    """Make a recording of some topics of another.

    Raises:
        UsageError: no topic is said, or one that it has not.
        BagError: a file cannot be read or written.
    """
    if not topics and not exclude:
        raise UsageError("say which topics: TOPICS, --exclude or both")
    with progress(f"filtering {path}") as tell:
        with bag.open(path) as opened:
            wanted = chosen(opened.topics, topics, exclude, path, robot=only_robot(opened))
        _tell(bag.keep(path, output, wanted, compression, force=force, tell=tell))


def merge(paths: Sequence[str], output: str, compression: Compression, *, force: bool) -> None:
    """Make one recording of several.

    Raises:
        UsageError: there is one alone.
        BagError: a file cannot be read or written.
    """
    if len(paths) < 2:
        raise UsageError("name two recordings or more")
    with progress(f"merging {amount(len(paths), 'recording')}") as tell:
        _tell(bag.merge(paths, output, compression, force=force, tell=tell))


def recover(path: str, output: str, *, force: bool) -> None:
    """Make a whole file of one that is cut or damaged.

    Raises:
        BagError: it is no recording, or a file cannot be read or written.
    """
    with progress(f"recovering {path}") as tell:
        found = bag.recover(path, output, force=force, tell=tell)
    for fault in found.faults[:20]:
        note(visible(str(fault)))
    if len(found.faults) > 20:
        note(f"… and {len(found.faults) - 20:,} faults more")
    left = found.size - found.read if any(fault.cut for fault in found.faults) else 0
    lost = f", {data_size(left)} at its end left out" if left > 0 else ""
    print_line(f"{found.output}: {amount(found.messages, 'message')}{lost}")
    if not found.faults:
        note(f"nothing was wrong with {path}")


def _tell(edited: Edited) -> None:
    latched = f", {edited.latched} of them what latched topics had said before" if edited.latched else ""
    messages, topics = amount(edited.messages, "message"), amount(edited.topics, "topic")
    print_line(f"{edited.output}: {messages} on {topics}{latched}")
