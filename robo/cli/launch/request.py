"""What `robo up` is asked: a field for each of its options, with what help says of it."""

from typing import Annotated, NamedTuple

import typer

from robo.cli import completion
from robo.cli.options import Connect, Listen, NetworkConfig, RobotName, Security


class UpRequest(NamedTuple):
    """What to start, and how. From its fields follow the options of `robo up`, and the words of `robo up -d`."""

    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MANIFEST] [GROUP]... [NAME:=VALUE]...",
            help="What to start.",
            show_default=False,
            autocompletion=completion.manifests,
        ),
    ] = None
    robot_name: RobotName = None
    param: Annotated[
        list[str] | None,
        typer.Option(
            "-p",
            "--param",
            metavar="NODE.NAME:=VALUE",
            help="Set a parameter of a node; NAME:=VALUE of all that have it.",
        ),
    ] = None
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan and start nothing.")] = False
    show_args: Annotated[bool, typer.Option("--show-args", help="List the manifest's arguments.")] = False
    json: Annotated[bool, typer.Option("--json", help="Print the plan, the arguments or the faults as JSON.")] = False
    connect: Connect = None
    listen: Listen = None
    security: Security = None
    share: Annotated[
        bool,
        typer.Option("--share", help="Let other users of this machine do all with it, and not only look."),
    ] = False
    log_level: Annotated[
        str | None,
        typer.Option("--log-level", metavar="LEVEL", help="debug, info, warn, error or fatal (or ROBO_LOG_LEVEL)."),
    ] = None
    host: Annotated[
        str | None,
        typer.Option("--host", metavar="NAME", help="Start only what the manifest says runs on this host."),
    ] = None
    detach: Annotated[bool, typer.Option("-d", "--detach", help="Run in the background; `robo down` ends it.")] = False
    wait: Annotated[bool, typer.Option("--wait", help="With -d: return once everything is ready.")] = False
    watch: Annotated[
        bool, typer.Option("--watch", help="Start again what a changed source, parameter file or manifest touches.")
    ] = False
    config: NetworkConfig = None
    timing: Annotated[bool, typer.Option("--timing", help="Print where the time of the start went.")] = False

    @property
    def starts(self) -> bool:
        """Whether this very process is to run something."""
        return not (self.dry_run or self.show_args or self.detach)
