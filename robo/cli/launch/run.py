"""`robo run`: one node, alone."""

import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from robo.cli.launch.modules import check_nothing_hides_robo, module_of
from robo.errors import UsageError

USAGE = """Usage: robo run SERVICE [OPTIONS]

Run one node. SERVICE is package.module, or package.module:Class; a file of this folder works too.

Options are the node's own: --robot-name NAME, --name NAME, -p NAME:=VALUE,
--params-file FILE, -r FROM:=TO, --connect ENDPOINT, --listen ENDPOINT.
`robo run SERVICE --help` also shows what it publishes and subscribes and how it is tuned.

Examples:
  robo run robo_services.position_tracker --robot-name r1
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
    if len(arguments) > 1 and not arguments[1].startswith("-"):  # as in ROS 2
        name = f"{arguments[0]}.{arguments[1].removesuffix('.py')}"
        print(f"error: a service is one word: robo run {name}", file=sys.stderr)
        sys.exit(2)
    service, colon, node_class = arguments[0].partition(":")
    try:
        check_nothing_hides_robo()
        if service.endswith(".py"):
            service = module_of(service)
    except UsageError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    words = [f"{service}{colon}{node_class}", *arguments[1:]]
    os.execv(sys.executable, [sys.executable, "-m", "robo.process.node", *words])
