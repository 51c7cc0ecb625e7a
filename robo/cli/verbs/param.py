"""`robo param`: parameters of running nodes."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Json, JsonLines, NodeName, OptionalNode
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


@verb(verbs, "list", "robo param list", "robo param list waypoint_follower --json")
def param_list(reach: Reach, node: OptionalNode = None, json: Json = False) -> None:
    """List parameters and their values, of one node or of all."""
    from robo.cli.views.param import print_list

    print_list(node, reach, json=json)


@verb(verbs, "get", "robo param get /r1/waypoint_follower speed")
def param_get(
    reach: Reach,
    node: NodeName,
    names: Annotated[
        list[str], typer.Argument(metavar="NAME", help="Parameters.", autocompletion=completion.parameters)
    ],
    json: Json = False,
) -> None:
    """Print values, one a line."""
    from robo.cli.views.param import print_values

    print_values(node, names, reach, json=json)


@verb(
    verbs,
    "set",
    "robo param set /r1/waypoint_follower speed 0.3",
    "robo param set waypoint_follower speed:=0.3 tolerance:=0.2",
    context_settings={"ignore_unknown_options": True},
)
def param_set(
    reach: Reach,
    node: NodeName,
    words: Annotated[
        list[str],
        typer.Argument(metavar="NAME VALUE | NAME:=VALUE", help="What to set.", autocompletion=completion.parameters),
    ],
) -> None:
    """Set parameters of a running node: all of them, or none."""
    from robo.cli.views.param import set_values

    set_values(node, words, reach)


@verb(
    verbs,
    "describe",
    "robo param describe safety_monitor",
    "robo param describe safety_monitor rate",
    short_help="Print type, range, unit, default and description.",
)
def param_describe(reach: Reach, node: NodeName, names: Names = None, json: Json = False) -> None:
    """Print type, range, unit, default and description."""
    from robo.cli.views.param import print_descriptions

    print_descriptions(node, names or [], reach, json=json)


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
