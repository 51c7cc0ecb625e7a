"""What is asked of a service of systemd: a field for each option, with what help says of it."""

import os
from typing import Annotated, NamedTuple

import typer

from robo.cli import completion
from robo.cli.options import Connect, Listen, RobotName, Security
from robo.errors import UsageError


class ServiceRequest(NamedTuple):
    """What is to be a service, and how: a field for each option."""

    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MANIFEST] [GROUP]... [NAME:=VALUE]...",
            help="What it runs, as for robo up.",
            show_default=False,
            autocompletion=completion.manifests,
        ),
    ] = None
    robot_name: RobotName = None
    user: Annotated[bool, typer.Option("--user", help="For your own service manager; needs no root.")] = False
    system: Annotated[bool, typer.Option("--system", help="For that of the machine: it starts at boot.")] = False
    run_as: Annotated[
        str | None,
        typer.Option(
            "--run-as",
            metavar="USER",
            help="Who it runs as, with --system: a user, or `dynamic`, one that systemd makes up.",
            show_default=False,
        ),
    ] = None
    device: Annotated[
        list[str] | None,
        typer.Option(
            "--device", metavar="DEVICE", help="What it may use: /dev/ttyUSB0, or char-video4linux. May be repeated."
        ),
    ] = None
    connect: Connect = None
    listen: Listen = None
    security: Security = None
    restart: Annotated[
        str | None,
        typer.Option(
            "--restart",
            metavar="WHEN",
            help="no, on-failure or always. By default on-failure, and no where no node is started again.",
            show_default=False,
        ),
    ] = None
    jit: Annotated[bool, typer.Option("--jit", help="Nodes may make machine code while they run: numba, torch.")] = (
        False
    )

    @property
    def by_user(self) -> bool:
        """Whether it is for a user's own service manager.

        Raises:
            UsageError: both are said.
        """
        return chosen_by_user(user=self.user, system=self.system)


def chosen_by_user(*, user: bool, system: bool) -> bool:
    """Which service manager is meant: where nothing is said, root means the machine's, and all others their own.

    Raises:
        UsageError: both are said.
    """
    if user and system:
        raise UsageError("--user and --system exclude each other")
    return user or (not system and os.geteuid() != 0)
