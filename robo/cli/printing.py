"""How things are printed: lines, tables, JSON, hints, amounts."""

import os
import shutil
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from robo.cli.json_text import to_json
from robo.errors import UsageError
from robo.text import colours
from robo.text.columns import aligned, fitted
from robo.text.terminal import own, visible


def print_line(text: str) -> None:
    """A line of data, at once; a newline in it is no way to begin another."""
    print(visible(text, keep="\t"), flush=True)


def print_lines(lines: Iterable[str]) -> None:
    """Lines of data, each as `print_line` has it."""
    for line in lines:
        print_line(line)


def print_text(text: str) -> None:
    """Data of several lines, at once."""
    print(text, flush=True)


def write_file(data: str | bytes, file: Path) -> None:
    """Write data to a file that somebody has named, over one that is there: whole, or not at all.

    Raises:
        UsageError: it cannot be written.
    """
    whole = data.encode() if isinstance(data, str) else data
    try:
        place = file.resolve()  # what a link leads to, rather than the link
        if place.exists() and not (place.is_file() and os.access(place.parent, os.W_OK)):
            place.write_bytes(whole)  # such as /dev/stdout
            return
        part = place.with_name(f".{place.name[:100]}.{os.getpid()}.part")
        try:
            part.write_bytes(whole)
            if place.exists():
                shutil.copymode(place, part)
            part.replace(place)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(f"{file} cannot be written: {error.strerror}") from None


def print_json(value: object) -> None:
    """An object as a line of JSON, at once."""
    print_text(to_json(value))


def print_table(rows: Sequence[Sequence[str]], spared: Sequence[str] = ()) -> None:
    """A table whose first row is its head; on a narrow terminal without some of the columns that are `spared`."""
    if spared and sys.stdout.isatty():
        rows = fitted(rows, shutil.get_terminal_size().columns, spared)
    for number, line in enumerate(aligned(rows)):
        print(paint(line, colours.BOLD) if number == 0 else line)


def paint(text: str, colour: str) -> str:
    """Text in a colour, where a terminal shows it and nobody has said NO_COLOR."""
    return own(colours.begin(colour)) + text + own(colours.END) if colours.shown_on(sys.stdout) else text


def clear_screen() -> None:
    """Begin again at the top, on a terminal."""
    if sys.stdout.isatty():
        print(own("\x1b[H\x1b[J"), end="")


def hint(text: str) -> None:
    """Talk for people who wait, beside the data."""
    if sys.stderr.isatty():
        note(text)


def note(text: str) -> None:
    """Something to know about the data, beside them; a line of its own, whoever else prints at this moment."""
    sys.stderr.write(f"{text}\n")  # `print` writes the end of the line apart
    sys.stderr.flush()


def clock_time(nanoseconds: int) -> str:
    """A time of today: `18:30:00.123`."""
    stamp = time.strftime("%H:%M:%S", time.localtime(nanoseconds / 1e9))
    return f"{stamp}.{nanoseconds // 10**6 % 1000:03d}"


def amount(count: int, what: str) -> str:
    """How many of something: `1 node`, `2 nodes`."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def data_size(size: float, unit: str = "B") -> str:
    """A number of bytes for people: `1.2 MB`, or `1.2 MB/s`."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(size) >= factor:
            return f"{size / factor:.3g} {prefix}{unit}"
    return f"{size:.3g} {unit}"
