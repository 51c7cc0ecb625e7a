"""The options of `robo bag record`, and what they mean."""

import re
import time
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import typer

from robo.cli.reach import Reach
from robo.errors import UsageError
from robo.text.brief import shown

_SIZE = re.compile(r"(\d+(?:\.\d+)?) ?([kKMGT]?)(i?)B?")
_FACTORS = {"": 0, "k": 1, "K": 1, "M": 2, "G": 3, "T": 4}

EVERYTHING = "**"


class RecordWords(NamedTuple):
    """What is recorded, and how."""

    everything: Annotated[bool, typer.Option("-a", "--all", help="All topics, but for hidden ones.")] = False
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", metavar="KEY", help="Not these; * and ** match. May be repeated."),
    ] = None
    output: Annotated[
        str | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Default: robo_ with date and time. With splits: a folder."
        ),
    ] = None
    compression: Annotated[Literal["zstd", "none"], typer.Option("--compression", help="Of the file.")] = "zstd"
    split_size: Annotated[
        str | None,
        typer.Option("--split-size", metavar="SIZE", help="A new file begins where one has 500MB, or another size."),
    ] = None
    split_duration: Annotated[
        float | None,
        typer.Option("--split-duration", metavar="S", help="A new file begins after S seconds.", min=0.1),
    ] = None
    keep: Annotated[
        int | None, typer.Option("--keep", metavar="N", help="Of several files keep the newest N.", min=1)
    ] = None
    duration: Annotated[float | None, typer.Option("--duration", metavar="S", help="End after S seconds.", min=0.1)] = (
        None
    )
    least_free: Annotated[
        str, typer.Option("--least-free", metavar="SIZE", help="What is left to others on the disk.")
    ] = "200MB"
    when_full: Annotated[
        Literal["stop", "drop_oldest"],
        typer.Option("--when-full", help="Where less is left: end, or delete the oldest of several files."),
    ] = "stop"
    no_tf: Annotated[
        bool, typer.Option("--no-tf", help="Make no tf of odometry, and take no tf_static that is not named.")
    ] = False


def keys_of(names: list[str] | None, words: RecordWords, reach: Reach) -> list[str]:
    """The key expressions of the topics that are meant.

    Raises:
        UsageError: none are named, or some beside all.
        InvalidName: a word is no name.
    """
    if words.everything and names:
        raise UsageError(f"--all has {', '.join(names)} too: say one of both; --exclude leaves topics out")
    if words.everything:
        return [f"{reach.namespace}/{EVERYTHING}" if reach.namespace else EVERYTHING]
    if not names:
        raise UsageError("say which topics are to be recorded, such as r1/odom or 'r1/**', or --all")
    return [reach.key(name) for name in names]


def path_of(words: RecordWords, now: float) -> Path:
    """Where the recording goes: what somebody says, or a name of the time of now, s since the epoch."""
    if words.output is not None:
        return Path(words.output)
    name = time.strftime("robo_%Y_%m_%d-%H_%M_%S", time.localtime(now))
    splits = words.split_size is not None or words.split_duration is not None
    return Path(name if splits else f"{name}.mcap")


def size_of(text: str, option: str) -> int:
    """A number of bytes: `500MB`, `2GiB`, `1000`.

    Raises:
        UsageError: it is none.
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise UsageError(f"{option} {shown(text)}: use a size such as 500MB, 2GB or a number of bytes")
    number, prefix, binary = match.groups()
    factor: int = (1024 if binary else 1000) ** _FACTORS[prefix]
    return round(float(number) * factor)
