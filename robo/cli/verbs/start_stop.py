"""`robo up`, `run`, `stop`, `start`, `restart` and `down`: robots and nodes begin and end."""

from typing import Annotated, Literal

import typer

from robo.cli import completion
from robo.cli.launch.request import UpRequest
from robo.cli.options import Json
from robo.cli.reach import Reach
from robo.cli.tree import Section
from robo.cli.verb import verb
from robo.errors import UsageError

verbs = Section("Start and stop")

Names = Annotated[
    list[str],
    typer.Argument(metavar="NODE|GROUP...", help="Full names, names or groups.", autocompletion=completion.processes),
]


@verb(
    verbs,
    "up",
    "robo up --robot-name r1",
    "robo up simulation.yaml --robot-name r2",
    "robo up replay.yaml log:=run.log.gz rate:=2.0",
    "robo up robot.yaml control tracking use_sim:=false",
    "robo up -p waypoint_follower.speed:=0.3",
    "robo up fleet.yaml robots:=5 --dry-run",
    "robo up -d --wait --robot-name r1",
    "robo up --share --robot-name r1",
    "robo up mine.yaml --watch",
    "robo up simulation.yaml --show-args",
    "robo up two_hosts.yaml --host arm --connect tcp/base.local:7447",
    "robo up --connect tcp/site.example:7447 --network-config config/uplink.yaml",
    short_help="Start a robot, in the foreground or with -d in the background.",
)
def up(request: UpRequest) -> int:
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
    if request.starts:
        from robo.supervisor.early import begin

        begun = begin()  # first of all: it gets ready while the rest is read
    from robo.cli.launch.up import run_up

    return run_up(request, begun)


@verb(
    verbs,
    "run",
    short_help="Run one node, alone.",
    add_help_option=False,
    context_settings={"ignore_unknown_options": True},
)
def run(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="SERVICE|PACKAGE NODE [OPTIONS]", show_default=False, autocompletion=completion.services_to_run
        ),
    ] = None,
) -> None:
    """Run one node, alone; `robo run SERVICE --help` shows its contract. With --one-process several, in one process."""
    from robo.cli.launch.run import hand_over

    hand_over(words or [])


def _commanding(what: Literal["stop", "start"], about: str, *examples: str, short_help: str) -> None:
    """Make a verb of what a supervisor does to some of its processes: they all take the same words."""

    def have_done(reach: Reach, names: Names, json: Json = False) -> None:
        from robo.cli.views.runs import command

        command(what, names, reach, json=json)

    have_done.__doc__ = about
    verb(verbs, what, *examples, short_help=short_help)(have_done)


_commanding(
    "stop",
    "Stop nodes or groups of a running robot, until `robo start`.",
    "robo stop waypoint_follower",
    "robo stop control --robot-name r1",
    short_help="Stop nodes or groups, until `robo start`.",
)
_commanding(
    "start",
    "Start nodes or groups of a running robot that have stopped or failed.",
    "robo start waypoint_follower",
    "robo start /r1/waypoint_follower",
    short_help="Start what has stopped or failed.",
)


@verb(
    verbs,
    "restart",
    "robo restart position_tracker",
    "robo restart control --robot-name r1",
    "robo restart --rolling --dry-run",
    "robo restart --rolling 'r*' --batch 2 --settle 5",
    short_help="Stop nodes or groups and start them again.",
)
def restart(
    reach: Reach,
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NODE|GROUP...",
            help="Full names, names or groups; with --rolling robots, too, and patterns: 'r*', 'r*/base'.",
            autocompletion=completion.processes,
        ),
    ] = None,
    rolling: Annotated[
        bool, typer.Option("--rolling", help="One after another, each only when those before are healthy.")
    ] = False,
    batch: Annotated[int, typer.Option("--batch", metavar="N", help="With --rolling, so many at a time.", min=1)] = 1,
    settle: Annotated[
        float, typer.Option("--settle", metavar="S", help="With --rolling, how long each has to stay healthy.", min=0.0)
    ] = 5.0,
    timeout: Annotated[
        float | None,
        typer.Option(
            "--timeout",
            metavar="S",
            help="With --rolling, how long each may take to be healthy, by default 60; else how long to wait for the"
            " network.",
            min=0.0,
            show_default=False,
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="With --rolling, say who would be started again, in which order.")
    ] = False,
    json: Json = False,
) -> int:
    """Stop nodes or groups of a running robot and start them again.

    With --rolling, robots or nodes one after another, all robots where none is named. The next one's turn comes when
    the one before is ready, with all its checks ok, and has stayed so. At the first that does not become healthy it
    stops, tells why, and leaves the rest as they are. Nodes that were stopped stay so. --json prints JSON Lines then.

    Exit code: 0 it is done, 1 something did not become healthy or is not there, 2 words that make no sense, 130 Ctrl-C.
    """
    if rolling:
        from robo.cli.views.rolling import restart_rolling
        from robo.tools.rollout import Terms

        terms = Terms(batch, settle, 60.0 if timeout is None else timeout)
        return restart_rolling(names or [], reach, terms, dry_run=dry_run, json=json)
    if dry_run or (batch, settle) != (1, 5.0):
        raise UsageError("--batch, --settle and --dry-run go with --rolling")
    if not names:
        raise UsageError("name nodes or groups, or say --rolling")
    from robo.cli.views.runs import command

    command("restart", names, reach._replace(given_timeout=timeout), json=json)
    return 0


@verb(verbs, "down", "robo down", "robo down --robot-name r1", "robo down --all", short_help="End the run of a robot.")
def down(
    reach: Reach,
    every: Annotated[
        bool, typer.Option("--all", help="Every robot on the network, but those of other users of this machine.")
    ] = False,
    everyone: Annotated[bool, typer.Option("--everyone", help="Those too.")] = False,
    timeout: Annotated[float, typer.Option("--timeout", metavar="S", help="How long to wait for its end.")] = 30.0,
) -> None:
    """End the run of a robot, wherever it was started, and wait until it is over.

    A robot that is only a part of its run, as one of a fleet is, is stopped, and the run goes on.
    """
    from robo.cli.views.runs import down as end

    end(reach, every=every, everyone=everyone, timeout=timeout)
