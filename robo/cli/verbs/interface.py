"""`robo interface`: types of messages, services and actions."""

from pathlib import Path
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


@verb(
    verbs,
    "import",
    "robo interface import src/my_interfaces",
    "robo interface import src/my_interfaces -o my_interfaces.py",
    "robo interface import src -o my_messages",
    "robo interface import src --json | jq -r .ros_type",
)
def interface_import(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Files, packages or workspaces of ROS.", show_default=False)
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.py|FOLDER", help="Write a module or a package.")
    ] = None,
    package: Annotated[
        str | None, typer.Option("--package", metavar="NAME", help="The ROS package of files that are in none.")
    ] = None,
    json: JsonLines = False,
) -> None:
    """Make message types of ROS's .msg, .srv and .action files: Python classes with the same bytes and hashes.

    Below the paths each package.xml says a package. A type that robo ships is used and not made again; one that is
    neither there nor in robo is an error. Without -o the module is printed; a FOLDER gets a module for each package.
    Comments become docstrings. What was made before is written over, and nothing else.
    """
    from robo.cli.views.interface_import import import_types

    import_types(paths, output=output, package=package, json=json)
