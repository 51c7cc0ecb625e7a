"""`robo action`: actions of running nodes."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Json, JsonLines
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

ActionName = Annotated[
    str,
    typer.Argument(
        metavar="ACTION", help="An action's full name, for example r1/follow.", autocompletion=completion.actions
    ),
]


@verb(verbs, "list", "robo action list", "robo action list --json")
def action_list(reach: Reach, json: JsonLines = False) -> None:
    """List actions with their types and servers."""
    from robo.cli.views.offers import print_offers

    print_offers("action", reach, json=json)


@verb(verbs, "type", "robo action type r1/fibonacci")
def action_type(reach: Reach, name: ActionName) -> None:
    """Print the type of an action."""
    from robo.cli.views.action import print_type

    print_type(name, reach)


@verb(verbs, "info", "robo action info r1/fibonacci")
def action_info(reach: Reach, name: ActionName, json: Json = False) -> None:
    """Print who executes an action, who sends goals to it, and its three types."""
    from robo.cli.views.action import print_info

    print_info(name, reach, json=json)


@verb(
    verbs,
    "send-goal",
    "robo action send-goal r1/fibonacci '{order: 5}' --feedback",
    "robo action send-goal r1/fibonacci --no-wait",
    "robo action send-goal r1/fibonacci '{order: 5}' --timeout 60 --json",
)
def action_send_goal(
    reach: Reach,
    name: ActionName,
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[TYPE] [GOAL]", help="YAML or JSON, by default {}; the type need not be said."),
    ] = None,
    feedback: Annotated[bool, typer.Option("--feedback", "-f", help="Print what is told meanwhile.")] = False,
    no_wait: Annotated[bool, typer.Option("--no-wait", help="Print the goal's id and end.")] = False,
    timeout: Annotated[
        float | None, typer.Option("--timeout", metavar="S", help="Cancel the goal after so long.", min=0.0)
    ] = None,
    json: JsonLines = False,
) -> int:
    """Send a goal, wait for its result and print it.

    Ctrl-C cancels the goal, and so does the end of the time. Ends with 1 where the goal is refused, canceled or
    aborted.
    """
    from robo.cli.views.action import send_goal

    return send_goal(name, words or [], reach, feedback=feedback, wait=not no_wait, timeout=timeout, json=json)


@verb(
    verbs,
    "cancel",
    "robo action send-goal r1/fibonacci '{order: 500}' --no-wait && robo action cancel r1/fibonacci",
    "robo action cancel r1/fibonacci $(robo action send-goal r1/fibonacci '{order: 500}' --no-wait)",
)
def action_cancel(
    reach: Reach,
    name: ActionName,
    goal: Annotated[str | None, typer.Argument(metavar="[GOAL]", help="Its id; by default all goals.")] = None,
    json: Json = False,
) -> int:
    """Cancel a goal of an action, or all of them."""
    from robo.cli.views.action import cancel

    return cancel(name, goal, reach, json=json)


@verb(verbs, "echo", "robo action echo r1/fibonacci", "robo action echo r1/fibonacci --json")
def action_echo(reach: Reach, name: ActionName, json: JsonLines = False) -> None:
    """Print the feedback and the states of all goals, until Ctrl-C."""
    from robo.cli.views.action import echo

    echo(name, reach, json=json)
