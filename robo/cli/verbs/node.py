"""`robo node`: nodes, running ones and classes."""

from typing import Annotated

import typer

from robo.cli.options import Json, JsonLines, NodeName
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()


@verb(verbs, "list", "robo node list", "robo node list --json --robot-name r1")
def node_list(reach: Reach, json: JsonLines = False) -> None:
    """List the nodes that are ready: class, process, host."""
    from robo.cli.views.node import print_nodes

    print_nodes(reach, json=json)


@verb(verbs, "info", "robo node info position_tracker", "robo node info /r1/safety_monitor --json")
def node_info(reach: Reach, name: NodeName, json: Json = False) -> int:
    """Print all about one node: topics with rates, services, parameters, process, load, what it dropped.

    Load is the part of the time that its callbacks take; it and the rates are measured over half a second.

    Exit code: 0 fine, 1 there is no such node or it does not answer.
    """
    from robo.cli.views.node import print_info

    return print_info(name, reach, json=json)


@verb(
    verbs,
    "show",
    "robo node show robo_services.safety_monitor",
    "robo node show my_package.my_node:MyNode --json",
)
def node_show(
    service: Annotated[
        str, typer.Argument(metavar="CLASS", help="package.module, or package.module:Class.", show_default=False)
    ],
    json: Json = False,
) -> None:
    """Print the contract of a node class that need not run: topics, services, timers, parameters."""
    from robo.cli.views.node import print_contract

    print_contract(service, json=json)
