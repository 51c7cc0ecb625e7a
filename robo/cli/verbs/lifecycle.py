"""`robo lifecycle`: the states of managed nodes."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Json, JsonLines
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

Managed = Annotated[
    str,
    typer.Argument(
        metavar="NODE",
        help="A managed node's full name, or its name where only one has it.",
        autocompletion=completion.managed_nodes,
    ),
]


@verb(verbs, "nodes", "robo lifecycle nodes", "robo lifecycle nodes --json --robot-name r1")
def lifecycle_nodes(reach: Reach, json: JsonLines = False) -> None:
    """List managed nodes, active or not."""
    from robo.cli.views.lifecycle import print_nodes

    print_nodes(reach, json=json)


@verb(verbs, "get", "robo lifecycle get", "robo lifecycle get gripper", "robo lifecycle get /r1/gripper --json")
def lifecycle_get(
    reach: Reach,
    node: Annotated[
        str | None,
        typer.Argument(metavar="[NODE]", help="Only this node.", autocompletion=completion.managed_nodes),
    ] = None,
    json: JsonLines = False,
) -> None:
    """Print the state of a managed node, or of all."""
    from robo.cli.views.lifecycle import print_states

    print_states(node, reach, json=json)


@verb(verbs, "list", "robo lifecycle list gripper", "robo lifecycle list /r1/gripper --all")
def lifecycle_list(
    reach: Reach,
    node: Managed,
    every: Annotated[bool, typer.Option("--all", "-a", help="All there are, in every state.")] = False,
    json: JsonLines = False,
) -> None:
    """List the transitions that begin in a node's present state."""
    from robo.cli.views.lifecycle import print_ways

    print_ways(node, reach, every=every, json=json)


@verb(
    verbs,
    "set",
    "robo lifecycle set gripper deactivate",
    "robo lifecycle set /r1/gripper activate --timeout 20",
)
def lifecycle_set(
    reach: Reach,
    node: Managed,
    transition: Annotated[
        str,
        typer.Argument(
            metavar="TRANSITION",
            help="configure, activate, deactivate, cleanup or shutdown; or its id.",
            autocompletion=completion.transitions,
        ),
    ],
    timeout: Annotated[float, typer.Option("--timeout", metavar="S", help="How long its hook may take.")] = 60.0,
    json: Json = False,
) -> int:
    """Take a managed node through a transition, and print where it is then.

    Exit code: 0 its hook succeeded, 1 it did not, or the transition is not possible now.
    """
    from robo.cli.views.lifecycle import set_state

    return set_state(node, transition, reach, patience=timeout, json=json)
