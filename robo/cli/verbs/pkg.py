"""`robo pkg`: Python packages with nodes, messages and manifests."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Json, JsonLines
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

PackageName = Annotated[
    str,
    typer.Argument(
        metavar="PACKAGE",
        help="A Python package, for example robo_services.",
        show_default=False,
        autocompletion=completion.packages,
    ),
]


@verb(verbs, "list", "robo pkg list", "robo pkg list --json | jq -r .name")
def pkg_list(json: JsonLines = False) -> None:
    """List the packages that are installed, and those of the current folder's project.

    They are announced by the entry point group robo.packages. One that is broken is named with its error.
    """
    from robo.cli.views.pkg import print_list

    print_list(json=json)


@verb(verbs, "executables", "robo pkg executables", "robo pkg executables robo_services --json")
def pkg_executables(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[PACKAGE]", help="Only this one.", autocompletion=completion.packages),
    ] = None,
    full_path: Annotated[bool, typer.Option("--full-path", help="Print the files instead.")] = False,
    json: JsonLines = False,
) -> int:
    """List the nodes of packages, as `robo run PACKAGE NODE` starts them.

    Their modules are imported for it, in a process of its own.

    Exit code: 0 fine, 1 a module cannot be imported, 2 there is no such package.
    """
    from robo.cli.views.pkg import print_executables

    return print_executables(name, full_path=full_path, json=json)


@verb(verbs, "prefix", "robo pkg prefix robo_services", "ls $(robo pkg prefix robo --share)/launch")
def pkg_prefix(
    name: PackageName,
    share: Annotated[
        bool, typer.Option("--share", help="Print the folder with its manifests and parameter files.")
    ] = False,
) -> None:
    """Print the folder of a package."""
    from robo.cli.views.pkg import print_prefix

    print_prefix(name, share=share)


@verb(verbs, "show", "robo pkg show robo_services", "robo pkg show robo_services --json")
def pkg_show(name: PackageName, json: Json = False) -> int:
    """Print all about a package: where it is from, its folders, manifests, nodes and messages.

    Exit code: 0 fine, 1 a module cannot be imported, 2 there is no such package.
    """
    from robo.cli.views.pkg import print_package

    return print_package(name, json=json)
