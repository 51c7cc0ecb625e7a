"""`robo bag info`: what is in recordings."""

from collections.abc import Sequence

from robo import bag
from robo.bag.look.summary import Info, TopicInfo
from robo.cli.printing import amount, data_size, note, paint, print_json, print_line, print_table
from robo.cli.views.bag_progress import progress
from robo.cli.views.bag_times import duration
from robo.errors import BagError
from robo.text import colours
from robo.text.brief import brief
from robo.text.dates import date
from robo.text.terminal import visible

_MOST_LISTED = 50
"""Attachments, words and faults of a recording that are printed; --json has all."""


def print_info(paths: Sequence[str], *, quick: bool, json: bool) -> int:
    """Print what is in recordings, one after another.

    Returns:
        1 where one of several cannot be read; the others are told of all the same.

    Raises:
        BagError: the only one cannot be read, or is no recording.
    """
    failed = 0
    for number, path in enumerate(paths):
        try:
            with progress(f"reading {path}") as tell:
                info = bag.info(path, quick=quick, tell=tell)
        except BagError as error:
            if len(paths) == 1:
                raise
            note(visible(f"error: {error}"))
            failed = 1
            continue
        if json:
            print_json(info)
            continue
        if number:
            print_line("")
        _print(info, quick=quick)
    return failed


def _print(info: Info, *, quick: bool) -> None:
    files = "" if len(info.files) == 1 else f", {amount(len(info.files), 'file')}"
    print_line(paint(f"{info.path}: {data_size(info.size)}{files}", colours.BOLD))
    if info.count:
        print_line(f"from        {date(info.begin)}")
        print_line(f"to          {date(info.end)}, {duration(info.end - info.begin)}")
    print_line(f"messages    {info.count:,} on {amount(len(info.topics), 'topic')}{_lost(info)}")
    profile = f", profile {info.profile}" if info.profile else ""
    print_line(f"written by  {info.library or 'nobody says'}{profile}")
    if info.topics:
        print_line("")
        print_table(_table(info, quick=quick), ("DELAY", "AT", "SIZE"))
    _print_beside(info)
    for topic in info.topics:
        if topic.unknown:
            note(visible(f"{topic.name} stays bytes: {topic.unknown}"))
        if topic.malformed:
            note(visible(f"{topic.name}: {amount(topic.malformed, 'message')} came and could not be written down"))
    for fault in info.faults[:_MOST_LISTED]:
        note(visible(fault))
    if info.faults:
        note(f"`robo bag check {info.path}` tells more, and `robo bag recover` makes a whole file of what can be read")


def _table(info: Info, *, quick: bool) -> list[tuple[str, ...]]:
    if quick:
        return [("TOPIC", "COUNT", "TYPE"), *((one.name, f"{one.count:,}", _type(one)) for one in info.topics)]
    head = ("TOPIC", "COUNT", "RATE", "GAP", "AT", "LOST", "DELAY", "SIZE", "TYPE")
    return [head, *(_row(topic, info.begin) for topic in info.topics)]


def _row(topic: TopicInfo, begin: int) -> tuple[str, ...]:
    return (
        topic.name,
        f"{topic.count:,}",
        _or_dash(topic.rate, "{:.4g} Hz"),
        _or_dash(topic.gap, "{:.3g} s"),
        "-" if topic.gap_at is None else f"{(topic.gap_at - begin) * 1e-9:.1f} s",
        _or_dash(topic.lost, "{:,}"),
        "-" if topic.delay is None else f"{topic.delay * 1e3:.3g} ms",
        "-" if topic.size is None else data_size(topic.size),
        _type(topic),
    )


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)


def _type(topic: TopicInfo) -> str:
    return f"{topic.type or '-'}{', latched' if topic.latched else ''}"


def _lost(info: Info) -> str:
    lost = [topic.lost for topic in info.topics if topic.lost is not None]
    return f", {sum(lost):,} lost" if lost else ""


def _print_beside(info: Info) -> None:
    lines = [f"attachment  {name}, {data_size(size)}" for name, size in info.attachments.items()]
    for name, words in info.metadata.items():
        said = ", ".join(f"{key}: {value}" for key, value in words.items())
        lines.append(f"metadata    {name}: {brief(said, 300)}")
    if lines:
        print_line("")
    for line in lines[:_MOST_LISTED]:
        print_line(line)
    if len(lines) > _MOST_LISTED:
        print_line(f"… and {len(lines) - _MOST_LISTED:,} more; --json has all")
