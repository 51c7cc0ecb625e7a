"""`robo up`, `check`, `schema` and `run`: from a manifest or a class to running nodes."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.verb import Connect, Listen, RobotName, app, verb

NetworkConfig = Annotated[
    Path | None,
    typer.Option(
        "--network-config", metavar="FILE", help="More of Zenoh's settings for the router: down-sampling, TLS, access."
    ),
]


@verb(
    app,
    "up",
    "robo up --robot-name r1",
    "robo up simulation.yaml --robot-name r2",
    "robo up replay.yaml log:=run.log.gz rate:=2.0",
    "robo up robot.yaml control tracking use_sim:=false",
    "robo up -p velocity_controller.linear_velocity:=0.3",
    "robo up fleet.yaml robots:=5 --dry-run",
    "robo up -d --wait --robot-name r1",
    "robo up mine.yaml --watch",
    "robo up simulation.yaml --show-args",
    "robo up two_hosts.yaml --host arm --connect tcp/base.local:7447",
    "robo up --connect tcp/site.example:7447 --network-config config/uplink.yaml",
    short_help="Start a robot, in the foreground or with -d in the background.",
)
def up(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MANIFEST] [GROUP]... [NAME:=VALUE]...",
            help="What to start.",
            show_default=False,
            autocompletion=completion.manifests,
        ),
    ] = None,
    robot_name: RobotName = None,
    param: Annotated[
        list[str] | None,
        typer.Option(
            "-p",
            "--param",
            metavar="NODE.NAME:=VALUE",
            help="Set a parameter of a node; NAME:=VALUE of all that have it.",
        ),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and start nothing.")] = False,
    show_args: Annotated[bool, typer.Option("--show-args", help="List the manifest's arguments.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the plan, the arguments or the faults as JSON.")] = False,
    connect: Connect = None,
    listen: Listen = None,
    log_level: Annotated[
        str | None,
        typer.Option("--log-level", metavar="LEVEL", help="debug, info, warn, error or fatal (or ROBO_LOG_LEVEL)."),
    ] = None,
    host: Annotated[
        str | None,
        typer.Option("--host", metavar="NAME", help="Start only what the manifest says runs on this host."),
    ] = None,
    detach: Annotated[bool, typer.Option("-d", "--detach", help="Run in the background; `robo down` ends it.")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="With -d: return once everything is ready.")] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Start again what a changed source, parameter file or manifest touches.")
    ] = False,
    config: NetworkConfig = None,
    timing: Annotated[bool, typer.Option("--timing", help="Print where the time of the start went.")] = False,
) -> int:
    """Start a robot and keep it in the foreground until Ctrl-C, or in the background.

    MANIFEST is looked for as a path, then in ./launch, then among those that ship with robo
    (robot.yaml, simulation.yaml, real_robot.yaml, replay.yaml, fleet.yaml); robot.yaml by default.
    PACKAGE:FILE is a manifest of a Python package.
    GROUPs start only these.

    Exit code: 0 ended by itself or by SIGTERM, 1 a mistake in a file or a node that failed, 2 words
    that make no sense, 130 Ctrl-C.
    """
    from robo.cli.launch.modules import check_nothing_hides_robo

    check_nothing_hides_robo()
    begun = None
    if not (dry_run or show_args or detach):
        from robo.supervisor.early import begin

        begun = begin()  # first of all: it gets ready while the rest is read
    from robo.cli.launch.up import run_up

    return run_up(
        words or [],
        robot_name=robot_name,
        parameters=param or [],
        dry_run=dry_run,
        show_args=show_args,
        json=json,
        connect=connect or [],
        listen=listen or [],
        log_level=log_level,
        config=config,
        timing=timing,
        watch=watch,
        host=host,
        detach=detach,
        wait=wait,
        begun=begun,
    )


@verb(
    app,
    "check",
    "robo check launch/robot.yaml",
    "robo check launch/*.yaml --json",
    "robo check fleet.yaml robots:=5",
    "robo check robot.yaml --graph mermaid",
    short_help="Check manifests and their wiring; start nothing.",
)
def check(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE",
            help="Manifests to check; NAME:=VALUE for their arguments.",
            show_default=False,
            autocompletion=completion.manifests,
        ),
    ],
    robot_name: RobotName = None,
    json: Annotated[bool, typer.Option("--json", help="Print faults and notes as JSON.")] = False,
    graph: Annotated[
        str | None,
        typer.Option("--graph", metavar="FORM", help="Draw nodes, topics and services: text, mermaid, dot or json."),
    ] = None,
) -> int:
    """Check manifests and how their nodes are wired, without starting anything.

    Beside every mistake that `robo up` would refuse: two types on one topic, subscriptions that
    nothing feeds, remappings of names that a node does not have, parameters that no node declares,
    promises about topics that nobody keeps.

    Exit code: 0 fine, 1 faults, 2 words that make no sense.
    """
    from robo.cli.launch.check import run_check

    return run_check(words, robot_name=robot_name, json=json, graph=graph)


@verb(
    app,
    "schema",
    "robo schema manifest > robo.schema.json",
    "robo schema geometry/Twist",
    short_help="Print the JSON Schema of manifests or of a type.",
)
def schema(
    name: Annotated[str, typer.Argument(metavar="manifest|TYPE", help="What to describe.", show_default=False)],
) -> None:
    """Print the JSON Schema of manifests, by which editors complete them, or of a message type."""
    from robo.cli.launch.check import print_schema

    print_schema(name)


export = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Write a manifest in the form of another system."
)
app.add_typer(export, name="export")


@verb(
    export,
    "compose",
    "robo export compose launch/mine.yaml > docker-compose.yml",
    "robo export compose launch/mine.yaml -o docker-compose.yml",
    "robo export compose robot.yaml use_sim:=false --robot-name r1",
)
def export_compose(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MANIFEST] [NAME:=VALUE]...",
            help="What to export.",
            show_default=False,
            autocompletion=completion.manifests,
        ),
    ] = None,
    robot_name: RobotName = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write it there.")] = None,
    keeper: Annotated[
        bool, typer.Option("--keeper", help="With a profile `keeper`: a container that starts killed ones again.")
    ] = False,
) -> None:
    """Write a manifest as a Compose file: a router for each robot, a container for each process.

    The robot's name becomes ${ROBOT_NAME}, unless --robot-name says it; ${env:NAME} becomes ${NAME}. An argument
    that is false by default, and starts more processes when it is true, becomes a profile. No container holds the
    engine's socket, unless --keeper asks for a profile with one that does: see `robo keeper --help`.
    The Dockerfile of the current folder makes the image; where there is none the file builds nothing.
    """
    from robo.cli.launch.export import export_compose as write

    write(words or [], robot=robot_name, output=output, keeper=keeper)


@verb(export, "dockerfile", "robo export dockerfile > Dockerfile")
def export_dockerfile() -> None:
    """Print a Dockerfile for nodes of your own: robo's image with the Python package of the current folder."""
    from robo.cli.launch.export import export_dockerfile as write

    write()


@verb(
    app,
    "router",
    "robo router",
    "robo router --listen tcp/0.0.0.0:7447 --name site",
    "robo router --connect tcp/site.example:7447",
    "robo router --print-config > zenohd.json5",
    short_help="Run a Zenoh router for robots and hosts to meet at.",
)
def router(
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="What it is called in `robo net`.")] = "router",
    listen: Listen = None,
    connect: Connect = None,
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

    (show if print_config else run_router)(name=name, listen=listen or [], connect=connect or [], config=config)


@verb(
    app,
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


@verb(
    app,
    "health",
    short_help="Tell whether the router, or a node, is well.",
    add_help_option=False,
    context_settings={"ignore_unknown_options": True},
)
def health(
    words: Annotated[list[str] | None, typer.Argument(metavar="[NODE] [OPTIONS]", show_default=False)] = None,
) -> int:
    """Tell whether the router, or a node, is well; for health checks of containers."""
    from robo.process.health import main

    return main(words or [])


@verb(
    app,
    "run",
    short_help="Run one node, alone.",
    add_help_option=False,
    context_settings={"ignore_unknown_options": True},
)
def run(
    words: Annotated[list[str] | None, typer.Argument(metavar="SERVICE [OPTIONS]", show_default=False)] = None,
) -> None:
    """Run one node, alone; `robo run SERVICE --help` shows its contract."""
    from robo.cli.launch.run import hand_over

    hand_over(words or [])
