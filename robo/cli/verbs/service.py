"""`robo service`: services of running nodes."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Json, JsonLines
from robo.cli.reach import Reach
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

ServiceName = Annotated[
    str,
    typer.Argument(
        metavar="SERVICE", help="A service's full name, for example r1/reset.", autocompletion=completion.services
    ),
]


@verb(verbs, "list", "robo service list", "robo service list --json")
def service_list(reach: Reach, json: JsonLines = False) -> None:
    """List services with their types and servers."""
    from robo.cli.views.offers import print_offers

    print_offers("service", reach, json=json)


@verb(verbs, "type", "robo service type r1/reset_distance")
def service_type(reach: Reach, name: ServiceName) -> None:
    """Print the type of a service."""
    from robo.cli.views.service import print_type

    print_type(name, reach)


@verb(verbs, "info", "robo service info r1/reset_distance")
def service_info(reach: Reach, name: ServiceName, json: Json = False) -> None:
    """Print who serves a service, what it takes and what it returns."""
    from robo.cli.views.service import print_info

    print_info(name, reach, json=json)


@verb(
    verbs,
    "call",
    "robo service call r1/reset_distance",
    "robo service call r1/lights '{data: true}' --json",
)
def service_call(
    reach: Reach,
    name: ServiceName,
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[TYPE] [REQUEST]", help="YAML or JSON, by default {}; the type need not be said."),
    ] = None,
    timeout: Annotated[float, typer.Option("--timeout", metavar="S", help="How long to wait for the answer.")] = 2.0,
    json: Json = False,
) -> None:
    """Call a service and print its answer."""
    from robo.cli.views.service import call

    call(name, words or [], reach, timeout=timeout, json=json)
