"""`robo bag plot`: numbers of a recording over time, as a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from robo import bag
from robo.bag.look.series import series
from robo.bag.moments import moment
from robo.bag.of_robot import only_robot
from robo.cli.printing import amount, note, print_json, print_line
from robo.cli.views.bag_progress import progress
from robo.cli.views.pictures import STANDARD, check_picture, panels_of, written
from robo.errors import UsageError
from robo.text.dates import date
from robo.text.patterns import chosen
from robo.text.svg import Theme, curves
from robo.text.terminal import visible

_MOST_CURVES = 24
"""Of a picture: more nobody tells apart."""


class Fields(NamedTuple):
    """What is drawn of topics."""

    paths: Sequence[str]
    """Empty for all numbers that change."""
    start: str | None
    end: str | None
    """From when to when, as people write it."""


def plot(path: str, topics: Sequence[str], fields: Fields, output: str, theme: Theme, *, json: bool = False) -> None:
    """Draw fields of topics, and tell what is drawn; with `json` as an object.

    Raises:
        UsageError: no topic or field is meant, a time is none, or the picture cannot be written.
        BagError: the recording cannot be read.
    """
    check_picture(output, (".svg",))
    if output == STANDARD and json:
        raise UsageError("--json: say -o FILE.svg, for standard output has one of both")
    with progress(f"reading {path}") as tell, bag.open(path) as recording:
        meant = chosen(recording.topics, topics, (), path, robot=only_robot(recording))
        every = [name for name in recording.topics if meant(name)]
        names = [name for name in every if recording.topics[name].known is not None] or every
        begin, until = (
            moment(text, recording.begin, recording.end, option) if text is not None else None
            for text, option in ((fields.start, "--start"), (fields.end, "--end"))
        )
        found, by_arrival, readable = series(recording, names, fields.paths, begin, until, tell)
        since = recording.begin if begin is None else begin
    if len(names) < len(every):
        note(visible(f"left out, for their types are not known: {', '.join(one for one in every if one not in names)}"))
    for text in readable.notes():
        note(visible(text))
    if by_arrival:
        note(visible(f"drawn by when they came, for they were published by another clock: {', '.join(by_arrival)}"))
    title = f"{Path(path).name}: {', '.join(sorted({one.topic for one in found}))}"
    shown = found[:_MOST_CURVES]
    written(curves(title, panels_of(shown), f"s since {date(since)}", theme=theme), output)
    if len(found) > len(shown):
        note(f"{amount(len(found) - len(shown), 'field')} more would be too many: name some by --field")
    if json:
        drawn = [{"topic": one.topic, "field": one.field, "unit": one.unit, "values": one.values} for one in shown]
        print_json({"file": output, "curves": drawn})
    elif output != STANDARD:
        count = sum(one.values for one in shown)
        print_line(visible(f"{output}: {amount(len(shown), 'curve')} of {count:,} values"))
