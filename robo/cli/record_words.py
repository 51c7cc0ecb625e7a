"""The options of `robo bag record`."""

from typing import Annotated, Literal, NamedTuple

import typer


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
            "-o", "--output", metavar="FILE", help="Default: robo_ with date and time, and .mcap; with splits a folder."
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
