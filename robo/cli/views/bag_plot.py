"""`robo bag plot`: numbers of a recording over time, as a picture."""

from collections.abc import Sequence
from pathlib import Path

from robo import bag
from robo.bag.look.series import series
from robo.bag.moments import moment
from robo.bag.of_robot import only_robot
from robo.bag.patterns import chosen
from robo.cli.printing import amount, note, print_line
from robo.cli.views.bag_progress import progress
from robo.cli.views.pictures import STANDARD, check_ending, panels_of, written
from robo.text.dates import date
from robo.text.svg import Theme, curves
from robo.text.terminal import visible

_MOST_CURVES = 24
"""Of a picture: more nobody tells apart."""


def plot(
    path: str,
    topics: Sequence[str],
    fields: Sequence[str],
    output: str,
    start: str | None,
    end: str | None,
    theme: Theme,
) -> None:
    """Draw fields of topics.

    Raises:
        UsageError: no topic or field is meant, a time is none, or the picture cannot be written.
        BagError: the recording cannot be read.
    """
    check_ending(output, (".svg",))
    with progress(f"reading {path}") as tell, bag.open(path) as recording:
        meant = chosen(recording.topics, topics, (), path, robot=only_robot(recording))
        names = [name for name in recording.topics if meant(name)]
        begin = moment(start, recording.begin, recording.end, "--start") if start is not None else None
        until = moment(end, recording.begin, recording.end, "--end") if end is not None else None
        found = series(recording, names, fields, begin, until, tell)
        since = recording.begin if begin is None else begin
    title = f"{Path(path).name}: {', '.join(sorted({one.topic for one in found}))}"
    shown = found[:_MOST_CURVES]
    written(curves(title, panels_of(shown), f"s since {date(since)}", theme=theme), output)
    if len(found) > len(shown):
        note(f"{amount(len(found) - len(shown), 'field')} more would be too many: name some by --field")
    if output != STANDARD:
        count = sum(one.values for one in shown)
        print_line(visible(f"{output}: {amount(len(shown), 'curve')} of {count:,} values"))
