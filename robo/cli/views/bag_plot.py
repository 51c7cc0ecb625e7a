"""`robo bag plot`: numbers of a recording over time, as a picture."""

from collections.abc import Sequence
from pathlib import Path

from robo import bag
from robo.bag.look.series import Series, series
from robo.bag.moments import moment
from robo.bag.of_robot import only_robot
from robo.bag.patterns import chosen
from robo.cli.printing import amount, note, print_line, print_text, write_file
from robo.cli.views.bag_progress import progress
from robo.errors import UsageError
from robo.text.dates import date
from robo.text.svg import Curve, Panel, Theme, curves
from robo.text.terminal import visible

STANDARD = "-"
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


def panels_of(found: Sequence[Series]) -> list[Panel]:
    """Curves by their units, in the order in which these come."""
    several = len({one.topic for one in found}) > 1
    by_unit: dict[str, list[Curve]] = {}
    for one in found:
        name = f"{one.topic} {one.field}" if several else one.field
        by_unit.setdefault(one.unit, []).append(Curve(name, one.points))
    return [Panel(lines, unit) for unit, lines in by_unit.items()]


def check_ending(output: str, endings: Sequence[str]) -> None:
    """Whether a name says that it is a picture: what is written would else take the place of something else.

    Raises:
        UsageError: it does not.
    """
    if output != STANDARD and not output.lower().endswith(tuple(endings)):
        raise UsageError(f"{output}: end its name in {' or '.join(endings)}")


def written(text: str, output: str) -> None:
    """Write a picture.

    Raises:
        UsageError: it cannot be written.
    """
    if output == STANDARD:
        print_text(text.rstrip("\n"))
    else:
        write_file(text, Path(output))
