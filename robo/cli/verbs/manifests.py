"""`robo check` and `schema`, and the group `export`: manifests, of which nothing is started."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import RobotName
from robo.cli.tree import Section
from robo.cli.verb import verb

verbs = Section("Manifests")


@verb(
    verbs,
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
    verbs,
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


verbs.group("export", "Write a manifest in the form of another system")
