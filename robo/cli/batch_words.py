"""The options of `robo batch`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from robo.cli import completion


class EngineName(StrEnum):
    """What runs a batch."""

    RAY = "ray"
    LOCAL = "local"


class BatchWords(NamedTuple):
    """How a batch is run, whatever it runs."""

    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FOLDER", help="For results; what is there is not run again.")
    ]
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers", metavar="N", help="Runs at a time on this machine; one a core.", min=1, show_default=False
        ),
    ] = None
    engine: Annotated[
        EngineName, typer.Option("--engine", help="Ray, or threads of this process, which need nothing installed.")
    ] = EngineName.RAY
    address: Annotated[
        str | None,
        typer.Option("--address", metavar="HOST:PORT", help="A cluster of Ray's that is there.", show_default=False),
    ] = None
    retry: Annotated[bool, typer.Option("--retry", help="Run again what has failed.")] = False
    again: Annotated[bool, typer.Option("--again", help="Run all of it again.")] = False
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List the runs, and start nothing.")] = False
    json: Annotated[bool, typer.Option("--json", help="Print JSON Lines: a result each.")] = False


class Varied(NamedTuple):
    """What varies from run to run, and how long each may take."""

    sets: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NODE.PARAM=VALUE", help="A parameter in all runs. May be repeated."),
    ] = None
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            "--sweep", metavar="NODE.PARAM=VALUE,…", help="A run for each value; of several, for each combination."
        ),
    ] = None
    seeds: Annotated[
        str | None, typer.Option("--seeds", metavar="1-20", help="A run for each seed.", show_default=False)
    ] = None
    limit: Annotated[float, typer.Option("--limit", metavar="S", help="How long a run may take.", min=0.001)] = 600.0
    attempts: Annotated[
        int, typer.Option("--attempts", metavar="N", help="How often a run begins whose process dies.", min=1)
    ] = 3


class NodeWords(NamedTuple):
    """Which nodes are replayed."""

    node: Annotated[
        list[str] | None,
        typer.Option("--node", metavar="NODE", help="A node, a group, or a module; may be said several times."),
    ] = None
    manifest: Annotated[
        str | None,
        typer.Option(
            "--manifest",
            metavar="FILE",
            help="Says how nodes are made; robot.yaml.",
            show_default=False,
            autocompletion=completion.manifests,
        ),
    ] = None
    robot_name: Annotated[
        str | None, typer.Option("--robot-name", metavar="NAME", help="By default that of each recording.")
    ] = None
    patience: Annotated[float, typer.Option("--patience", metavar="SECONDS", help="How long a callback may take.")] = (
        10.0
    )


Recordings = Annotated[
    list[str],
    typer.Argument(
        metavar="RECORDING...",
        help="Recordings, or patterns of them in quotes: 'bags/*.mcap'.",
        autocompletion=completion.recordings,
    ),
]
