"""Pictures as files, whatever is drawn."""

from collections.abc import Sequence
from pathlib import Path

from robo.bag.look.series import Series
from robo.cli.printing import print_text, write_file
from robo.errors import UsageError
from robo.text.svg import Curve, Panel

STANDARD = "-"
"""For standard output."""


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
