"""The options of `robo replay-test`."""

from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from robo.cli.options import RobotName


class ReplayWords(NamedTuple):
    """What `robo replay-test` is asked."""

    bag: Annotated[Path, typer.Argument(metavar="BAG", help="The recording: a file, or a folder.")]
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME:=VALUE]...", help="Arguments of the manifest.", show_default=False),
    ] = None
    node: Annotated[
        list[str] | None,
        typer.Option("--node", metavar="NODE", help="A node, a group, or a module; may be said several times."),
    ] = None
    manifest: Annotated[
        str | None,
        typer.Option("--manifest", metavar="FILE", help="Says how nodes are made; robot.yaml.", show_default=False),
    ] = None
    robot_name: RobotName = None
    tolerances: Annotated[
        Path | None, typer.Option("--tolerances", metavar="FILE", help="What may differ, and by how much, as YAML.")
    ] = None
    ignore: Annotated[
        list[str] | None,
        typer.Option("--ignore", metavar="[TOPIC:]FIELD", help="A field that does not count: header.stamp."),
    ] = None
    accept: Annotated[
        bool, typer.Option("--accept", help="What nodes say now takes the place of what was recorded.")
    ] = False
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="With --accept: a file of its own for that."),
    ] = None
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FOLDER", help="Draw each field that differs, as SVG.")
    ] = None
    runs: Annotated[
        int, typer.Option("--runs", metavar="N", help="So many runs have to say the same first.", min=1)
    ] = 2
    patience: Annotated[float, typer.Option("--patience", metavar="SECONDS", help="How long a callback may take.")] = (
        10.0
    )
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False
