"""`robo ps`, `why`, `events` and `logs`: the processes of running robots, and what they have printed."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Interval, JsonLines, Watch
from robo.cli.reach import Reach
from robo.cli.tree import Section
from robo.cli.verb import verb

verbs = Section("Processes")


@verb(
    verbs,
    "ps",
    "robo ps",
    "robo ps --watch",
    "robo ps --json | jq -r 'select(.state != \"ready\").node'",
    "robo ps --fleet",
    short_help="List processes: state, restarts, cpu, memory, rates.",
)
def ps(
    reach: Reach,
    fleet: Annotated[bool, typer.Option("--fleet", help="A line a robot, rather than a line a process.")] = False,
    json: JsonLines = False,
    watch: Watch = False,
    interval: Interval = 1.0,
) -> None:
    """List the processes of running robots: state, restarts, processor, memory, messages per second.

    Nodes that no supervisor runs (`robo run`, containers) tell of themselves: their figures are of the time since their
    start, with --watch since the look before.

    With --fleet: how many nodes of each robot are ready, the worst health, the version of robo, the manifest, and what
    is wrong first. With --watch, too, robots that have gone are shown as offline, with since when.
    """
    if fleet:
        from robo.cli.views.fleet import print_fleet

        print_fleet(reach, json=json, watch=watch, interval=interval)
        return
    from robo.cli.views.runs import print_processes

    print_processes(reach, json=json, watch=watch, interval=interval)


@verb(verbs, "why", "robo why position_tracker", "robo why --json", short_help="Tell why nodes are as they are.")
def why(
    reach: Reach,
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NODE|GROUP]...", help="All by default.", autocompletion=completion.processes),
    ] = None,
    json: JsonLines = False,
) -> None:
    """Tell why nodes are as they are: how they ended, their last words, what they wait for, stale inputs.

    Where no robot runs any more, it tells how the last run on this machine ended, and names the files of its flight
    recorder. With --json that is an error.
    """
    from robo.cli.views.runs import why as explain_nodes

    explain_nodes(names or [], reach, json=json)


@verb(
    verbs,
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
    verbs,
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
    network, on all hosts of the robot: they keep the last 5,000 lines. Where a robot has no supervisor (`robo run`,
    containers), its nodes are asked, which keep 500 each.
    """
    from robo.cli.views.logs import Wanted, print_logs, print_runs

    if list_runs:
        print_runs(robot=reach.robot, json=json)
        return
    print_logs(Wanted(nodes or (), follow, lines, since, level, json), reach, run_name)
