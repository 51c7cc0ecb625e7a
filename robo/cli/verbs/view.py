"""`robo view`: viewers of others."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()


@verb(
    verbs,
    "rerun",
    "robo view rerun",
    "robo view rerun --robot-name r1 --web",
    "robo view rerun drive.mcap",
    "robo view rerun drive.mcap --save drive.rrd",
    "robo view rerun --duration 3 --save now.rrd",
)
def view_rerun(
    reach: Reach,
    recording: Annotated[
        str | None,
        typer.Argument(
            metavar="[BAG]",
            help="A recording; else what runs is shown.",
            autocompletion=completion.recordings,
            show_default=False,
        ),
    ] = None,
    topics: Annotated[
        list[str] | None,
        typer.Option(
            "--topic", metavar="TOPIC", help="Only these; * and ** match; may be repeated.", show_default=False
        ),
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option(
            "--save", metavar="FILE", help="Write a .rrd for Rerun; no viewer is started.", show_default=False
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a file of this name.")] = False,
    web: Annotated[
        bool, typer.Option("--web", help="In a browser rather than a window; so it is where there is no display.")
    ] = False,
    port: Annotated[int, typer.Option("--port", metavar="PORT", help="Of the viewer.", min=1, max=65535)] = 9876,
    web_port: Annotated[int, typer.Option("--web-port", metavar="PORT", help="Of its page.", min=1, max=65535)] = 9090,
    memory: Annotated[
        str, typer.Option("--memory", metavar="SIZE", help="What the viewer keeps: 1GiB, 50%; the oldest goes first.")
    ] = "1GiB",
    rate: Annotated[
        float | None,
        typer.Option(
            "--rate", metavar="HZ", help="Messages of a topic a second; 0 for all.", min=0.0, show_default=False
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option("--duration", metavar="S", help="End after S seconds.", min=0.0, show_default=False)
    ] = None,
) -> int:
    """Show robots in Rerun: frames, scans, trail, paths, maps, pictures, curves and log on one timeline.

    Live until Ctrl-C or until the viewer is closed, or of a recording. The viewer is for this machine alone: it
    listens on 127.0.0.1. It only looks; nobody drives from there. Live as many messages are drawn as somebody sees,
    fewer where the viewer does not keep up; of a recording all. Needs the extra `rerun`.

    Exit code: 0 shown, 1 nothing came or Rerun is not there, 2 words that make no sense.
    """
    from robo.cli.views.view_rerun import Asked, show

    place = None if save is not None else (port, web_port if web else None)
    return show(reach, Asked(recording, topics or [], save, force, place, web_port, memory, rate, duration))
