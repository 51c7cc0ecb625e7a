"""`robo interface`: types of messages, services and actions."""

from typing import Annotated

import typer

from robo.cli.options import Json, JsonLines, TypeName, only_one
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()


@verb(verbs, "list", "robo interface list", "robo interface list --json | jq -r .name")
def interface_list(json: JsonLines = False) -> None:
    """List types of messages, services and actions: those that ship, those of installed packages and of this folder.

    Packages of your own are found by the entry point group robo.messages, by ROBO_MESSAGES=module,…, and in Python
    files below the current folder.
    """
    from robo.cli.views.interface import print_list

    print_list(json=json)


@verb(
    verbs,
    "show",
    "robo interface show nav/Odometry",
    "robo interface show std/Trigger",
    "robo interface show example/Fibonacci",
    "robo interface show sensor/LaserScan --ros",
    "robo interface show sensor/LaserScan --type-hash",
    "robo interface show my_robot/Gripper --json-schema > gripper.schema.json",
)
def interface_show(
    type_name: TypeName,
    json: Json = False,
    json_schema: Annotated[bool, typer.Option("--json-schema", help="Print its JSON Schema.")] = False,
    ros: Annotated[bool, typer.Option("--ros", help="Print it as ROS writes it, with the messages in it.")] = False,
    type_hash: Annotated[bool, typer.Option("--type-hash", help="Print the hash that ROS gives it.")] = False,
) -> None:
    """Print a type: fields, types, defaults, units."""
    from robo.cli.views.interface import print_type

    print_type(type_name, only_one(json=json, json_schema=json_schema, ros=ros, type_hash=type_hash))
