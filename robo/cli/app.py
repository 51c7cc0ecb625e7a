"""The verbs and their options."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from robo.errors import ManifestError, RoboError, UsageError


def examples(*lines: str) -> str:
    """The examples below a verb's help, each on a line of its own."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


app = typer.Typer(
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Robots as microservices over Zenoh: start them, look at them.",
)
topic = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Look at topics.")
app.add_typer(topic, name="topic")
param = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Look at and change parameters of running nodes.")
app.add_typer(param, name="param")
service = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Look at and call services.")
app.add_typer(service, name="service")

RobotName = Annotated[
    str | None, typer.Option("--robot-name", metavar="NAME", help="Namespace of the robot.", show_default=False)
]
Connect = Annotated[
    list[str] | None,
    typer.Option("--connect", metavar="ENDPOINT", help="Dial this Zenoh endpoint (or ROBO_CONNECT)."),
]
Listen = Annotated[
    list[str] | None,
    typer.Option("--listen", metavar="ENDPOINT", help="Listen here instead of tcp/127.0.0.1:7447 (or ROBO_LISTEN)."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
NodeName = Annotated[str, typer.Argument(metavar="NODE", help="A node's full name, or its name where only one has it.")]
Names = Annotated[list[str] | None, typer.Argument(metavar="[NAME]...", help="Parameters; all where none is named.")]
ServiceKey = Annotated[str, typer.Argument(metavar="SERVICE", help="A service's full name, for example r1/reset.")]
Keys = Annotated[str, typer.Argument(metavar="KEY", help="A topic's full name, for example r1/odom; * and ** match.")]


@contextmanager
def errors() -> Iterator[None]:
    """Show a mistake as a message, and leave quietly on Ctrl-C and when the reader of a pipe is gone."""
    try:
        yield
    except RoboError as error:
        typer.echo(_described(error), err=True)
        raise typer.Exit(2 if isinstance(error, UsageError) else 1) from None
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
    except BrokenPipeError:
        # What Python would still flush at exit has no reader either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit from None


def _described(error: RoboError) -> str:
    """An error for people; the mistakes of a manifest each with their line."""
    if not isinstance(error, ManifestError) or not hasattr(error, "faults"):
        return f"error: {error}"
    from robo.launch.faults import as_text

    count = "1 mistake" if len(error.faults) == 1 else f"{len(error.faults)} mistakes"
    return f"{as_text(error.faults)}\n{count}; nothing is started"


def version(wanted: bool) -> None:
    """Print the version."""
    if wanted:
        from importlib.metadata import version as version_of

        typer.echo(version_of("robo-zenoh"))
        raise typer.Exit


@app.callback()
def root(
    _version: Annotated[bool, typer.Option("--version", callback=version, is_eager=True, help="Show it.")] = False,
) -> None:
    """Show the version."""


@app.command(
    short_help="Start a robot, in the foreground or with -d behind.",
    epilog=examples(
        "robo up --robot-name r1",
        "robo up simulation.yaml --robot-name r2",
        "robo up replay.yaml log:=run.log.gz rate:=2.0",
        "robo up robot.yaml control tracking use_sim:=false",
        "robo up -p velocity_controller.linear_velocity:=0.3",
        "robo up fleet.yaml robots:=5 --dry-run",
        "robo up -d --wait --robot-name r1",
        "robo up mine.yaml --watch",
        "robo up simulation.yaml --show-args",
    ),
)
def up(
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[MANIFEST] [GROUP]... [NAME:=VALUE]...", help="What to start.", show_default=False),
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
    detach: Annotated[bool, typer.Option("-d", "--detach", help="Run in the background; `robo down` ends it.")] = False,
    wait: Annotated[bool, typer.Option("--wait", help="With -d: return once everything is ready.")] = False,
    watch: Annotated[
        bool, typer.Option("--watch", help="Start again what a changed source, parameter file or manifest touches.")
    ] = False,
    timing: Annotated[bool, typer.Option("--timing", help="Print where the time of the start went.")] = False,
) -> None:
    """Start a robot and keep it in the foreground until Ctrl-C, or in the background.

    MANIFEST is looked for as a path, then in ./launch, then among those that ship with robo
    (robot.yaml, simulation.yaml, real_robot.yaml, replay.yaml, fleet.yaml); robot.yaml by default.
    GROUPs start only these.

    Exit code: 0 ended by itself or by SIGTERM, 1 a mistake in a file or a node that failed, 2 words
    that make no sense, 130 Ctrl-C.
    """
    with errors():
        begun = None
        if not (dry_run or show_args or detach):
            from robo.supervisor.early import begin

            begun = begin()  # first of all: it gets ready while the rest is read
        from robo.cli.up import run_up

        code = run_up(
            words or [],
            robot_name=robot_name,
            parameters=param or [],
            dry_run=dry_run,
            show_args=show_args,
            json=json,
            connect=connect or [],
            listen=listen or [],
            log_level=log_level,
            timing=timing,
            watch=watch,
            detach=detach,
            wait=wait,
            begun=begun,
        )
    raise typer.Exit(code)


@app.command(
    short_help="Check manifests and their wiring; start nothing.",
    epilog=examples(
        "robo check launch/robot.yaml",
        "robo check launch/*.yaml --json",
        "robo check fleet.yaml robots:=5",
        "robo check robot.yaml --graph mermaid",
    ),
)
def check(
    words: Annotated[
        list[str],
        typer.Argument(metavar="FILE", help="Manifests to check; NAME:=VALUE for their arguments.", show_default=False),
    ],
    robot_name: RobotName = None,
    json: Annotated[bool, typer.Option("--json", help="Print faults and notes as JSON.")] = False,
    graph: Annotated[
        str | None, typer.Option("--graph", metavar="FORM", help="Draw nodes and topics: mermaid, dot or json.")
    ] = None,
) -> None:
    """Check manifests and how their nodes are wired, without starting anything.

    Beside every mistake that `robo up` would refuse: two types on one topic, subscriptions that
    nothing feeds, remappings of names that a node does not have, parameters that no node declares,
    promises about topics that nobody keeps.

    Exit code: 0 fine, 1 faults, 2 words that make no sense.
    """
    with errors():
        from robo.cli.check import run_check

        code = run_check(words, robot_name=robot_name, json=json, graph=graph)
    raise typer.Exit(code)


@app.command(
    short_help="Print the JSON Schema of manifests or of a type.",
    epilog=examples("robo schema manifest > robo.schema.json", "robo schema geometry/Twist"),
)
def schema(
    name: Annotated[str, typer.Argument(metavar="manifest|TYPE", help="What to describe.", show_default=False)],
) -> None:
    """Print the JSON Schema of manifests, by which editors complete them, or of a message type."""
    with errors():
        from robo.cli.check import print_schema

        print_schema(name)


Everything = Annotated[list[str], typer.Argument(metavar="NODE|GROUP...", help="Full names, names or groups.")]


@app.command(
    short_help="List processes: state, restarts, cpu, memory, rates.",
    epilog=examples("robo ps", "robo ps --watch", "robo ps --json | jq -r 'select(.state != \"ready\").node'"),
)
def ps(
    robot_name: RobotName = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON Lines, an object for each process.")] = False,
    watch: Annotated[bool, typer.Option("--watch", help="Again and again, until Ctrl-C.")] = False,
    interval: Annotated[float, typer.Option("--interval", metavar="S", help="How often, with --watch.", min=0.1)] = 1.0,
    connect: Connect = None,
) -> None:
    """List the processes of running robots: state, restarts, processor, memory, messages per second."""
    with errors():
        from robo.cli.runs import print_processes

        print_processes(robot=robot_name, json=json, watch=watch, interval=interval, connect=connect or [])


@app.command(
    short_help="Stop nodes or groups, until `robo start`.",
    epilog=examples("robo stop velocity_controller", "robo stop control --robot-name r1"),
)
def stop(names: Everything, robot_name: RobotName = None, json: Json = False, connect: Connect = None) -> None:
    """Stop nodes or groups of a running robot, until `robo start`."""
    _have_done("stop", names, robot_name, json, connect)


@app.command(
    short_help="Start what has stopped or failed.",
    epilog=examples("robo start velocity_controller", "robo start /r1/velocity_controller"),
)
def start(names: Everything, robot_name: RobotName = None, json: Json = False, connect: Connect = None) -> None:
    """Start nodes or groups of a running robot that have stopped or failed."""
    _have_done("start", names, robot_name, json, connect)


@app.command(
    short_help="Stop nodes or groups and start them again.",
    epilog=examples("robo restart position_tracker", "robo restart control --robot-name r1"),
)
def restart(names: Everything, robot_name: RobotName = None, json: Json = False, connect: Connect = None) -> None:
    """Stop nodes or groups of a running robot and start them again."""
    _have_done("restart", names, robot_name, json, connect)


def _have_done(verb: str, names: list[str], robot: str | None, json: bool, connect: list[str] | None) -> None:
    with errors():
        from robo.cli.runs import command

        command(verb, names, robot=robot, json=json, connect=connect or [])


@app.command(
    short_help="End the run of a robot.", epilog=examples("robo down", "robo down --robot-name r1", "robo down --all")
)
def down(
    robot_name: RobotName = None,
    every: Annotated[bool, typer.Option("--all", help="Every robot on the network.")] = False,
    timeout: Annotated[float, typer.Option("--timeout", metavar="S", help="How long to wait for its end.")] = 30.0,
    connect: Connect = None,
) -> None:
    """End the run of a robot, wherever it was started, and wait until it is over."""
    with errors():
        from robo.cli.runs import down as end

        end(robot=robot_name, every=every, timeout=timeout, connect=connect or [])


@app.command(
    short_help="Tell why nodes are as they are.", epilog=examples("robo why position_tracker", "robo why --json")
)
def why(
    names: Annotated[list[str] | None, typer.Argument(metavar="[NODE|GROUP]...", help="All by default.")] = None,
    robot_name: RobotName = None,
    json: Json = False,
    connect: Connect = None,
) -> None:
    """Tell why nodes are as they are: how they ended, their last words, what they wait for, stale inputs."""
    with errors():
        from robo.cli.runs import why as explain_nodes

        explain_nodes(names or [], robot=robot_name, json=json, connect=connect or [])


@app.command(
    short_help="Print what happens to processes.",
    epilog=examples("robo events", "robo events --json | jq 'select(.event == \"degraded\")'"),
)
def events(
    robot_name: RobotName = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON Lines.")] = False,
    follow: Annotated[bool, typer.Option("--follow/--no-follow", help="Wait for more, until Ctrl-C.")] = True,
    connect: Connect = None,
) -> None:
    """Print what has happened in running robots, and what happens."""
    with errors():
        from robo.cli.runs import print_events

        print_events(robot=robot_name, json=json, follow=follow, connect=connect or [])


@app.command(
    short_help="Print what processes have printed.",
    epilog=examples(
        "robo logs",
        "robo logs position_tracker -f",
        "robo logs --since 10m --level warn",
        "robo logs --list",
        "robo logs --run 2026-11-21_18-30-00_4711 --json",
    ),
)
def logs(
    nodes: Annotated[list[str] | None, typer.Argument(metavar="[NODE]...", help="Only these.")] = None,
    robot_name: RobotName = None,
    follow: Annotated[bool, typer.Option("-f", "--follow", help="Wait for more, until Ctrl-C.")] = False,
    lines: Annotated[int | None, typer.Option("-n", "--lines", metavar="N", help="Only the last N.", min=0)] = None,
    since: Annotated[
        str | None, typer.Option("--since", metavar="TIME", help="30s, 10m, 2h, 1d ago, or 2026-11-21T18:30.")
    ] = None,
    level: Annotated[str | None, typer.Option("--level", metavar="LEVEL", help="This level and above.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON Lines.")] = False,
    run_name: Annotated[str | None, typer.Option("--run", metavar="RUN", help="An earlier run.")] = None,
    list_runs: Annotated[bool, typer.Option("--list", help="List the runs that are kept.")] = False,
) -> None:
    """Print what the processes of a run on this machine have printed; of the latest run by default."""
    with errors():
        from robo.cli.logs import print_logs, print_runs

        if list_runs:
            print_runs(robot=robot_name, json=json)
            return
        print_logs(
            nodes or [],
            robot=robot_name,
            run=run_name,
            follow=follow,
            lines=lines,
            since=since,
            level=level,
            json=json,
        )


@app.command(
    short_help="Check this machine.", epilog=examples("robo doctor", "robo doctor --kill-test", "robo doctor --json")
)
def doctor(
    kill_test: Annotated[
        bool, typer.Option("--kill-test", help="Start a robot, kill -9 its supervisor, and look whether all is gone.")
    ] = False,
    json: Json = False,
    connect: Connect = None,
) -> None:
    """Check this machine: Python, packages, ports, multicast, router, clock, permissions, leftovers.

    Exit code: 0 all is well, 1 something has to be mended.
    """
    with errors():
        from robo.cli.doctor import examine

        code = examine(kill_test=kill_test, json=json, connect=connect or [])
    raise typer.Exit(code)


@app.command(
    short_help="Run one node, alone.", add_help_option=False, context_settings={"ignore_unknown_options": True}
)
def run(
    words: Annotated[list[str] | None, typer.Argument(metavar="SERVICE [OPTIONS]", show_default=False)] = None,
) -> None:
    """Run one node, alone; `robo run SERVICE --help` shows its contract."""
    from robo.cli.run import hand_over

    hand_over(words or [])


@topic.command("list", epilog=examples("robo topic list", "robo topic list --json"))
def topic_list(json: Json = False, connect: Connect = None) -> None:
    """List topics with their types, publishers and subscribers."""
    with errors():
        from robo.cli.topic import print_topics

        print_topics(json=json, connect=connect or [])


@topic.command(
    "echo",
    epilog=examples(
        "robo topic echo r1/odom",
        "robo topic echo r1/current_position --once",
        "robo topic echo 'r1/*' --json | jq .message",
    ),
)
def topic_echo(
    key: Keys,
    once: Annotated[bool, typer.Option("--once", help="Stop after one message.")] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON Lines: key, type, time (ns), sequence_number, message.")
    ] = False,
    connect: Connect = None,
) -> None:
    """Print messages as they come."""
    with errors():
        from robo.cli.topic import print_messages

        print_messages(key, once=once, json=json, connect=connect or [])


@topic.command("hz", epilog=examples("robo topic hz r1/odom", "robo topic hz 'r1/*' --duration 5 --json"))
def topic_hz(
    key: Keys,
    count: Annotated[int | None, typer.Option("--count", metavar="N", help="Stop after N windows.", min=1)] = None,
    duration: Annotated[float | None, typer.Option("--duration", metavar="S", help="Stop after S seconds.")] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON Lines: key, rate, count, min, max, std, lost.")
    ] = False,
    connect: Connect = None,
) -> None:
    """Measure how often messages are published, once a second.

    Rates come from the publisher's own times and sequence numbers, so they are exact even where
    messages are lost on the way.
    """
    with errors():
        from robo.cli.topic import print_rates

        print_rates(key, count=count, duration=duration, json=json, connect=connect or [])


@param.command("list", epilog=examples("robo param list", "robo param list velocity_controller --json"))
def param_list(
    node: Annotated[str | None, typer.Argument(metavar="[NODE]", help="Only this node.")] = None,
    json: Json = False,
    connect: Connect = None,
) -> None:
    """List parameters and their values, of one node or of all."""
    with errors():
        from robo.cli.param import print_list

        print_list(node, json=json, connect=connect or [])


@param.command("get", epilog=examples("robo param get /r1/velocity_controller linear_velocity"))
def param_get(
    node: NodeName,
    names: Annotated[list[str], typer.Argument(metavar="NAME", help="Parameters.")],
    json: Json = False,
    connect: Connect = None,
) -> None:
    """Print values, one a line."""
    with errors():
        from robo.cli.param import print_values

        print_values(node, names, json=json, connect=connect or [])


@param.command(
    "set",
    context_settings={"ignore_unknown_options": True},
    epilog=examples(
        "robo param set /r1/velocity_controller linear_velocity 0.3",
        "robo param set velocity_controller linear_velocity:=0.3 angular_velocity:=-0.1",
    ),
)
def param_set(
    node: NodeName,
    words: Annotated[list[str], typer.Argument(metavar="NAME VALUE | NAME:=VALUE", help="What to set.")],
    connect: Connect = None,
) -> None:
    """Set parameters of a running node: all of them, or none."""
    with errors():
        from robo.cli.param import set_values

        set_values(node, words, connect=connect or [])


@param.command(
    "describe", epilog=examples("robo param describe safety_monitor", "robo param describe safety_monitor rate")
)
def param_describe(node: NodeName, names: Names = None, json: Json = False, connect: Connect = None) -> None:
    """Print type, range, unit, default and description."""
    with errors():
        from robo.cli.param import print_descriptions

        print_descriptions(node, names or [], json=json, connect=connect or [])


@param.command("dump", epilog=examples("robo param dump velocity_controller", "robo param dump --all -o params.yaml"))
def param_dump(
    node: Annotated[str | None, typer.Argument(metavar="[NODE]", help="A node.")] = None,
    every: Annotated[bool, typer.Option("--all", help="Every node.")] = False,
    file: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write it there.")] = None,
    connect: Connect = None,
) -> None:
    """Write values as a parameter file, which `robo up` and ROS 2 read."""
    with errors():
        if every == (node is not None):
            raise UsageError("name a node, or say --all")
        from robo.cli.param import dump

        dump(node, file, connect=connect or [])


@param.command("load", epilog=examples("robo param load velocity_controller params.yaml"))
def param_load(
    node: NodeName,
    file: Annotated[str, typer.Argument(metavar="FILE", help="A parameter file.")],
    connect: Connect = None,
) -> None:
    """Set what a parameter file says of a running node: all of it, or nothing."""
    with errors():
        from robo.cli.param import load

        load(node, file, connect=connect or [])


@param.command("explain", epilog=examples("robo param explain velocity_controller linear_velocity"))
def param_explain(node: NodeName, names: Names = None, json: Json = False, connect: Connect = None) -> None:
    """Print everything that was said of parameters, from the weakest to what holds, each with its place."""
    with errors():
        from robo.cli.param import explain

        explain(node, names or [], json=json, connect=connect or [])


@param.command("watch", epilog=examples("robo param watch", "robo param watch velocity_controller --json"))
def param_watch(
    node: Annotated[str | None, typer.Argument(metavar="[NODE]", help="Only this node.")] = None,
    json: Json = False,
    connect: Connect = None,
) -> None:
    """Print changes of parameters as they come."""
    with errors():
        from robo.cli.param import watch

        watch(node, json=json, connect=connect or [])


@service.command("list", epilog=examples("robo service list", "robo service list --json"))
def service_list(json: Json = False, connect: Connect = None) -> None:
    """List services with their types and servers."""
    with errors():
        from robo.cli.service import print_services

        print_services(json=json, connect=connect or [])


@service.command("type", epilog=examples("robo service type r1/reset_distance"))
def service_type(key: ServiceKey, connect: Connect = None) -> None:
    """Print the type of a service."""
    with errors():
        from robo.cli.service import print_type

        print_type(key, connect=connect or [])


@service.command("info", epilog=examples("robo service info r1/reset_distance"))
def service_info(key: ServiceKey, json: Json = False, connect: Connect = None) -> None:
    """Print who serves a service, what it takes and what it returns."""
    with errors():
        from robo.cli.service import print_info

        print_info(key, json=json, connect=connect or [])


@service.command(
    "call", epilog=examples("robo service call r1/reset_distance", "robo service call r1/lights '{data: true}' --json")
)
def service_call(
    key: ServiceKey,
    request: Annotated[str | None, typer.Argument(metavar="[REQUEST]", help="YAML or JSON; by default {}.")] = None,
    timeout: Annotated[float, typer.Option("--timeout", metavar="S", help="How long to wait for the answer.")] = 2.0,
    json: Json = False,
    connect: Connect = None,
) -> None:
    """Call a service and print its answer."""
    with errors():
        from robo.cli.service import call

        call(key, request, timeout=timeout, json=json, connect=connect or [])
