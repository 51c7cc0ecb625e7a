"""`robo ps`, `stop`, `start`, `restart`, `down`, `why`, `events`, `logs`: the processes of running robots."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.reach import Reach
from robo.cli.verb import Interval, Json, JsonLines, Watch, app, verb

Everything = Annotated[
    list[str],
    typer.Argument(metavar="NODE|GROUP...", help="Full names, names or groups.", autocompletion=completion.processes),
]


@verb(
    app,
    "ps",
    "robo ps",
    "robo ps --watch",
    "robo ps --json | jq -r 'select(.state != \"ready\").node'",
    short_help="List processes: state, restarts, cpu, memory, rates.",
)
def ps(reach: Reach, json: JsonLines = False, watch: Watch = False, interval: Interval = 1.0) -> None:
    """List the processes of running robots: state, restarts, processor, memory, messages per second."""
    from robo.cli.views.runs import print_processes

    print_processes(reach, json=json, watch=watch, interval=interval)


@verb(
    app,
    "stop",
    "robo stop velocity_controller",
    "robo stop control --robot-name r1",
    short_help="Stop nodes or groups, until `robo start`.",
)
def stop(reach: Reach, names: Everything, json: Json = False) -> None:
    """Stop nodes or groups of a running robot, until `robo start`."""
    _have_done("stop", names, reach, json=json)


@verb(
    app,
    "start",
    "robo start velocity_controller",
    "robo start /r1/velocity_controller",
    short_help="Start what has stopped or failed.",
)
def start(reach: Reach, names: Everything, json: Json = False) -> None:
    """Start nodes or groups of a running robot that have stopped or failed."""
    _have_done("start", names, reach, json=json)


@verb(
    app,
    "restart",
    "robo restart position_tracker",
    "robo restart control --robot-name r1",
    short_help="Stop nodes or groups and start them again.",
)
def restart(reach: Reach, names: Everything, json: Json = False) -> None:
    """Stop nodes or groups of a running robot and start them again."""
    _have_done("restart", names, reach, json=json)


def _have_done(what: str, names: list[str], reach: Reach, *, json: bool) -> None:
    from robo.cli.views.runs import command

    command(what, names, reach, json=json)


@verb(app, "down", "robo down", "robo down --robot-name r1", "robo down --all", short_help="End the run of a robot.")
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


@verb(app, "why", "robo why position_tracker", "robo why --json", short_help="Tell why nodes are as they are.")
def why(
    reach: Reach,
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NODE|GROUP]...", help="All by default.", autocompletion=completion.processes),
    ] = None,
    json: JsonLines = False,
) -> None:
    """Tell why nodes are as they are: how they ended, their last words, what they wait for, stale inputs."""
    from robo.cli.views.runs import why as explain_nodes

    explain_nodes(names or [], reach, json=json)


@verb(
    app,
    "events",
    "robo events",
    "robo events --json | jq 'select(.event == \"degraded\")'",
    short_help="Print what happens to processes.",
)
def events(
    reach: Reach,
    json: JsonLines = False,
    follow: Annotated[bool, typer.Option("--follow/--no-follow", help="Wait for more, until Ctrl-C.")] = True,
) -> None:
    """Print what has happened in running robots, and what happens."""
    from robo.cli.views.runs import print_events

    print_events(reach, json=json, follow=follow)


@verb(
    app,
    "logs",
    "robo logs",
    "robo logs position_tracker -f",
    "robo logs --since 10m --level warn",
    "robo logs --list",
    "robo logs --run 2026-11-21_18-30-00_4711 --json",
    short_help="Print what processes have printed.",
)
def logs(
    reach: Reach,
    nodes: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NODE|GROUP]...", help="Only these.", autocompletion=completion.processes),
    ] = None,
    follow: Annotated[bool, typer.Option("-f", "--follow", help="Wait for more, until Ctrl-C.")] = False,
    lines: Annotated[int | None, typer.Option("-n", "--lines", metavar="N", help="Only the last N.", min=0)] = None,
    since: Annotated[
        str | None, typer.Option("--since", metavar="TIME", help="30s, 10m, 2h, 1d ago, or 2026-11-21T18:30.")
    ] = None,
    level: Annotated[str | None, typer.Option("--level", metavar="LEVEL", help="This level and above.")] = None,
    json: JsonLines = False,
    run_name: Annotated[str | None, typer.Option("--run", metavar="RUN", help="An earlier run.")] = None,
    list_runs: Annotated[bool, typer.Option("--list", help="List the runs that are kept.")] = False,
) -> None:
    """Print what the processes of a run have printed; of the latest run on this machine by default.

    With --connect (or ROBO_CONNECT), and where no run is kept on this machine, supervisors are asked over the
    network, on all hosts of the robot: they keep the last 5,000 lines.
    """
    from robo.cli.views.logs import Wanted, print_logs, print_runs

    if list_runs:
        print_runs(robot=reach.robot, json=json)
        return
    print_logs(Wanted(nodes or (), follow, lines, since, level, json), reach, run_name)


@verb(
    app,
    "doctor",
    "robo doctor",
    "robo doctor --kill-test",
    "robo doctor --json",
    short_help="Check this machine.",
)
def doctor(
    reach: Reach,
    kill_test: Annotated[
        bool, typer.Option("--kill-test", help="Start a robot, kill -9 its supervisor, and look whether all is gone.")
    ] = False,
    json: JsonLines = False,
) -> int:
    """Check this machine: Python, packages, ports, multicast, router, clock, permissions, leftovers.

    Exit code: 0 all is well, 1 something has to be mended.
    """
    from robo.cli.views.doctor import examine

    return examine(kill_test=kill_test, json=json, connect=reach.connect)
