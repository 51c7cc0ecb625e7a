"""`robo run`: one node, alone."""

import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from robo.cli.launch.modules import check_nothing_hides_robo, module_of
from robo.errors import UsageError

USAGE = """Usage: robo run SERVICE [OPTIONS]
       robo run PACKAGE NODE [OPTIONS]

Run one node. SERVICE is package.module, or package.module:Class; a file of this folder works too.
NODE is one of `robo pkg executables PACKAGE`.

Options are the node's own: --robot-name NAME, --name NAME, -p NAME:=VALUE,
--params-file FILE, -r FROM:=TO, --connect ENDPOINT, --listen ENDPOINT.
`robo run SERVICE --help` also shows what it publishes and subscribes and how it is tuned.

Examples:
  robo run robo_services.position_tracker --robot-name r1
  robo run robo_services velocity_controller --name drive
  robo run robo_services.velocity_controller -p linear_velocity:=0.3 -r cmd_vel:=robot/cmd_vel
  robo run my_package.my_node:MyNode --help
"""


def hand_over(arguments: Sequence[str]) -> NoReturn:
    """Become the node's process."""
    if not arguments or arguments[0] in ("-h", "--help"):
        print(USAGE, end="")
        sys.exit(0 if arguments else 2)
    if "--ros-args" in arguments:
        print("error: leave --ros-args out: -p, -r and --params-file are options of robo run itself", file=sys.stderr)
        sys.exit(2)
    try:
        check_nothing_hides_robo()
        service, options = _service_of(arguments)
    except UsageError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    os.execv(sys.executable, [sys.executable, "-m", "robo.process.node", service, *options])


def _service_of(arguments: Sequence[str]) -> tuple[str, Sequence[str]]:
    """The service that a command line names in a word or two, and its options.

    Raises:
        UsageError: there is no such file or package.
    """
    if len(arguments) > 1 and not arguments[1].startswith("-"):
        from robo.packages.find import find

        try:
            package = find(arguments[0])
        except LookupError as error:
            raise UsageError(str(error)) from None
        return f"{package.module}.{arguments[1].removesuffix('.py')}", arguments[2:]
    service, colon, node_class = arguments[0].partition(":")
    if service.endswith(".py"):
        service = module_of(service)
    return f"{service}{colon}{node_class}", arguments[1:]
