"""`robo router`, `health` and `keeper`: what serves networks and containers."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli.options import Connect, Listen, NetworkConfig, Security
from robo.cli.tree import Section
from robo.cli.verb import verb

verbs = Section("Networks and containers")
verbs.group("security", "Who may do what on a network")


@verb(
    verbs,
    "router",
    "robo router",
    "robo router --listen tcp/0.0.0.0:7447 --name site",
    "robo router --connect tcp/site.example:7447",
    "robo router --name site --listen tls/0.0.0.0:7447 --security security",
    "robo router --print-config > zenohd.json5",
    short_help="Run a Zenoh router for robots and hosts to meet at.",
)
def router(
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="What it is called in `robo net`.")] = "router",
    listen: Listen = None,
    connect: Connect = None,
    security: Security = None,
    config: NetworkConfig = None,
    print_config: Annotated[
        bool, typer.Option("--print-config", help="Print the configuration for zenohd, and end.")
    ] = False,
) -> None:
    """Run a Zenoh router with robo's settings, until Ctrl-C.

    On loopback only, unless --listen says otherwise. Each `robo up` has a router of its own; one by itself is
    for a site with several robots: their `robo up --connect tcp/SITE:7447` dials it.
    """
    from robo.cli.launch.router import print_config as show
    from robo.cli.launch.router import run_router
    from robo.cli.secured import secure

    secure(security, name)
    (show if print_config else run_router)(name=name, listen=listen or [], connect=connect or [], config=config)


@verb(
    verbs,
    "health",
    short_help="Tell whether the router, nodes or a robot are well.",
    add_help_option=False,
    context_settings={"ignore_unknown_options": True},
)
def health(
    words: Annotated[list[str] | None, typer.Argument(metavar="[NODE]... [OPTIONS]", show_default=False)] = None,
) -> int:
    """Tell whether the router, nodes or a whole robot are well; for health checks of containers."""
    from robo.process.health import main

    return main(words or [])


@verb(
    verbs,
    "keeper",
    "robo keeper --project my_robot",
    "robo keeper --project my_robot --socket $XDG_RUNTIME_DIR/docker.sock",
    short_help="Start containers again that were killed by hand.",
)
def keeper(
    project: Annotated[str, typer.Option("--project", metavar="NAME", help="The Compose project.")],
    socket: Annotated[
        Path | None,
        typer.Option("--socket", metavar="FILE", help="The engine's socket (default /var/run/docker.sock)."),
    ] = None,
    ready_file: Annotated[
        Path | None, typer.Option("--ready-file", metavar="FILE", help="Is there while it watches; for health checks.")
    ] = None,
) -> None:
    """Start containers of a Compose project again that were killed by hand, until Ctrl-C.

    An engine starts what crashes again by its restart policy, but not what `docker kill` or `docker compose kill`
    ended: that is obeyed. Where killing nodes is to be a test of the robot, the keeper starts them, a second later,
    if the policy is on-failure or always; what was stopped stays stopped. It needs the engine's socket, and whoever
    holds that is root on the host: so no Compose file starts a keeper unasked, and it listens to the engine alone.
    """
    from robo.cli.launch.keeper import run_keeper

    run_keeper(project=project, socket=socket, ready_file=ready_file)
