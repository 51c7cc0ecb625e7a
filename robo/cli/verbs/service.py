"""`robo service`: services of running nodes; and robots as services of the machine, which systemd runs."""

from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.launch.service_request import ServiceRequest, chosen_by_user
from robo.cli.options import Json, JsonLines, RobotName
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


Force = Annotated[bool, typer.Option("--force", help="Also where somebody has changed the unit, or written it.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Print what would be done, and do nothing.")]
OfUser = Annotated[bool, typer.Option("--user", help="Of your own service manager.")]
OfSystem = Annotated[bool, typer.Option("--system", help="Of the machine's; root's default.")]


@verb(
    verbs,
    "install",
    "robo service install robot.yaml --robot-name r1 --user --dry-run",
    "robo service install robot.yaml --robot-name r1 --system --run-as dynamic --device /dev/ttyUSB0 --dry-run",
    short_help="Have systemd run a robot, from the next boot on.",
)
def service_install(request: ServiceRequest, force: Force = False, dry_run: DryRun = False) -> None:
    """Have systemd run a robot: write its unit, as `robo export systemd` prints it, and enable it.

    This is about the robot as a service of the machine, not about services of its nodes. Done twice it is done once.
    A unit that somebody has changed is left alone, but for --force. It tells what it has done, and what to type next.
    """
    from robo.cli.launch.service import install

    install(request, force=force, dry_run=dry_run)


@verb(
    verbs,
    "remove",
    "robo service remove --robot-name r1 --user --dry-run",
    short_help="Have systemd run a robot no more.",
)
def service_remove(
    robot_name: Annotated[str, typer.Option("--robot-name", metavar="NAME", help="The robot.")],
    user: OfUser = False,
    system: OfSystem = False,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """Stop a robot that systemd runs, and remove its unit. The file with its variables stays."""
    from robo.cli.launch.service import remove

    remove(robot_name, by_user=chosen_by_user(user=user, system=system), force=force, dry_run=dry_run)


@verb(
    verbs,
    "status",
    "robo service status",
    "robo service status --robot-name r1 --user --json",
    short_help="List the robots that systemd runs.",
)
def service_status(
    robot_name: RobotName = None, user: OfUser = False, system: OfSystem = False, json: Json = False
) -> None:
    """List the robots that systemd runs: enabled or not, how they are, how often they were started again.

    Without --user and --system those of the machine's service manager and of your own.
    """
    from robo.cli.launch.service import status

    which = chosen_by_user(user=user, system=system) if user or system else None
    status(robot_name, by_user=which, json=json)
