"""Pictures as files, whatever is drawn."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from robo.bag.look.series import Series
from robo.cli.printing import print_text, write_file
from robo.errors import UsageError
from robo.text.svg import Curve, Panel, Theme

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


def check_picture(output: str, endings: Sequence[str], *, standard: bool = True) -> None:
    """Whether a picture can be written there, before anything is done for it.

    Args:
        output: a name that says that it is a picture: what is written would else take the place of something else.
        endings: that such names have.
        standard: whether `-` is standard output.

    Raises:
        UsageError: it cannot.
    """
    if standard and output == STANDARD:
        if sys.stdout.isatty():
            raise UsageError(f"-: a terminal shows no picture; say a name that ends in {endings[0]}")
        return
    file = Path(output)
    if not output.lower().endswith(tuple(endings)):
        raise UsageError(f"{output}: end its name in {' or '.join(endings)}")
    if not file.parent.is_dir():
        raise UsageError(f"{output} cannot be written: there is no folder {file.parent}")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise UsageError(f"{output} cannot be written: you may not")


def check_theme(theme: Theme, svg: Path | None) -> None:
    """Whether there is a picture for colours that somebody has asked for.

    Raises:
        UsageError: there is none.
    """
    if theme != "auto" and svg is None:
        raise UsageError("--theme: say --svg FILE, for these are the colours of a picture")


def written(text: str, output: str) -> None:
    """Write a picture.

    Raises:
        UsageError: it cannot be written.
    """
    if output == STANDARD:
        print_text(text.rstrip("\n"))
    else:
        write_file(text, Path(output))
