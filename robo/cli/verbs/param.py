"""`robo param`: parameters of running nodes."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Json, JsonLines, NodeName, NodeNames, OptionalNode
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

Names = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[NAME]...", help="Parameters; all where none is named.", autocompletion=completion.parameters
    ),
]


@verb(
    verbs,
    "list",
    "robo param list",
    "robo param list waypoint_follower --json",
    "robo param list 'r*/waypoint_follower'",
)
def param_list(reach: Reach, node: OptionalNode = None, json: Json = False) -> None:
    """List parameters and their values, of one node, of those that a pattern matches, or of all."""
    from robo.cli.views.param import print_list

    print_list(node, reach, json=json)


@verb(
    verbs,
    "get",
    "robo param get /r1/waypoint_follower speed",
    "robo param get 'r*/waypoint_follower' speed",
    short_help="Print values, one a line.",
)
def param_get(
    reach: Reach,
    node: NodeNames,
    names: Annotated[
        list[str], typer.Argument(metavar="NAME", help="Parameters.", autocompletion=completion.parameters)
    ],
    json: Json = False,
) -> int:
    """Print values, one a line; of the nodes that a pattern matches as a table.

    Exit code: 0 all of them told, 1 one did not.
    """
    from robo.cli.views.param import print_values

    return print_values(node, names, reach, json=json)


@verb(
    verbs,
    "set",
    "robo param set /r1/waypoint_follower speed 0.3",
    "robo param set waypoint_follower speed:=0.3 tolerance:=0.2",
    "robo param set 'r*/waypoint_follower' speed 0.3 --dry-run",
    short_help="Set parameters of running nodes.",
    context_settings={"ignore_unknown_options": True},
)
def param_set(
    reach: Reach,
    node: NodeNames,
    words: Annotated[
        list[str],
        typer.Argument(metavar="NAME VALUE | NAME:=VALUE", help="What to set.", autocompletion=completion.parameters),
    ],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say who would be asked, and ask nobody.")] = False,
    json: Json = False,
) -> int:
    """Set parameters of a running node: all of them, or none.

    A pattern means each node whose full name it matches: * one part of it, or letters of a part, ** any number of
    parts. Each is asked by itself, and what each answered is told; what one refuses is set at the others.

    Exit code: 0 it is set, 1 a node refused or did not answer, 2 words that make no sense.
    """
    from robo.cli.views.param import set_values

    return set_values(node, words, reach, dry_run=dry_run, json=json)


@verb(
    verbs,
    "describe",
    "robo param describe safety_monitor",
    "robo param describe safety_monitor rate",
    "robo param describe '**/safety_monitor' rate",
    short_help="Print type, range, unit, default and description.",
)
def param_describe(reach: Reach, node: NodeNames, names: Names = None, json: Json = False) -> int:
    """Print type, range, unit, default and description; of each node that a pattern matches."""
    from robo.cli.views.param import print_descriptions

    return print_descriptions(node, names or [], reach, json=json)


@verb(verbs, "dump", "robo param dump waypoint_follower", "robo param dump --all -o params.yaml")
def param_dump(
    reach: Reach,
    node: OptionalNode = None,
    every: Annotated[bool, typer.Option("--all", help="Every node.")] = False,
    file: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write it there.")] = None,
) -> None:
    """Write values as a parameter file, which `robo up` and ROS 2 read."""
    from robo.cli.views.param import dump

    dump(node, reach, every=every, file=file)


@verb(verbs, "load", "robo param load waypoint_follower params.yaml")
def param_load(
    reach: Reach,
    node: NodeName,
    file: Annotated[str, typer.Argument(metavar="FILE", help="A parameter file.")],
) -> None:
    """Set what a parameter file says of a running node: all of it, or nothing."""
    from robo.cli.views.param import load

    load(node, file, reach)


@verb(verbs, "explain", "robo param explain waypoint_follower speed")
def param_explain(reach: Reach, node: NodeName, names: Names = None, json: Json = False) -> None:
    """Print everything that was said of parameters, from the weakest to what holds, each with its place."""
    from robo.cli.views.param import explain

    explain(node, names or [], reach, json=json)


@verb(verbs, "watch", "robo param watch", "robo param watch waypoint_follower --json")
def param_watch(reach: Reach, node: OptionalNode = None, json: JsonLines = False) -> None:
    """Print changes of parameters as they come."""
    from robo.cli.views.param import watch

    watch(node, reach, json=json)
