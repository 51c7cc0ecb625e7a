"""The verbs and their options."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
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
    epilog=examples(
        "robo up --robot-name r1",
        "robo up simulation.yaml --robot-name r2",
        "robo up replay.yaml log:=run.log.gz rate:=2.0",
        "robo up robot.yaml control tracking use_sim:=false",
        "robo up -p velocity_controller.linear_velocity:=0.3",
        "robo up fleet.yaml robots:=5 --dry-run",
        "robo up simulation.yaml --show-args",
    )
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
) -> None:
    """Start a robot and keep it in the foreground until Ctrl-C.

    MANIFEST is looked for as a path, then in ./launch, then among those that ship with robo
    (robot.yaml, simulation.yaml, real_robot.yaml, replay.yaml, fleet.yaml); robot.yaml by default.
    GROUPs start only these.

    Exit code: 0 ended by itself or by SIGTERM, 1 a mistake in a file or a node that failed, 2 words
    that make no sense, 130 Ctrl-C.
    """
    with errors():
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
        )
    raise typer.Exit(code)


@app.command(
    epilog=examples(
        "robo check launch/robot.yaml",
        "robo check launch/*.yaml --json",
        "robo check fleet.yaml robots:=5",
        "robo check robot.yaml --graph mermaid",
    )
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


@app.command(epilog=examples("robo schema manifest > robo.schema.json", "robo schema geometry/Twist"))
def schema(
    name: Annotated[str, typer.Argument(metavar="manifest|TYPE", help="What to describe.", show_default=False)],
) -> None:
    """Print the JSON Schema of manifests, by which editors complete them, or of a message type."""
    with errors():
        from robo.cli.check import print_schema

        print_schema(name)


@app.command(add_help_option=False, context_settings={"ignore_unknown_options": True})
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
