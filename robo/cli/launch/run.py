"""`robo run`: one node, alone, or several in one process."""

import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from robo.cli.launch.modules import check_nothing_hides_robo, module_of
from robo.errors import SecurityError, UsageError

USAGE = """Usage: robo run SERVICE [OPTIONS]
       robo run PACKAGE NODE [OPTIONS]
       robo run SERVICE SERVICE... --one-process [OPTIONS]

Run one node, or several in one process. SERVICE is package.module, or package.module:Class; a file of
this folder works too.
NODE is one of `robo pkg executables PACKAGE`.

Options are the node's own: --robot-name NAME, --name NAME, -p NAME:=VALUE,
--params-file FILE, -r FROM:=TO, --connect ENDPOINT, --listen ENDPOINT. With --security DIR (or ROBO_SECURITY) it
has a name on a secured network, see docs/security.md.
`robo run SERVICE --help` also shows what it publishes and subscribes and how it is tuned.

Examples:
  robo run robo_services.position_tracker --robot-name r1
  robo run robo_services velocity_controller --name drive
  robo run robo_services.velocity_controller -p linear_velocity:=0.3 -r cmd_vel:=robot/cmd_vel
  robo run my_package.my_node:MyNode --help
  robo run robo_services.velocity_controller robo_services.position_tracker --one-process --robot-name r1
"""

ONE_PROCESS = "--one-process"


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
        arguments = _secured(arguments)
        if ONE_PROCESS in arguments:
            words = ["robo.process.together", *_services_of(arguments)]
        else:
            service, options = _service_of(arguments)
            words = ["robo.process.node", service, *options]
    except (UsageError, SecurityError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    os.execv(sys.executable, [sys.executable, "-m", *words])


def _secured(arguments: Sequence[str]) -> Sequence[str]:
    """What is left of a command line when its `--security DIR` holds for this process.

    Raises:
        UsageError: no folder follows.
        SecurityError: something is wrong with the folder.
    """
    from robo.cli.secured import secure

    left, given, robot = [], None, ""
    words = iter(arguments)
    for word in words:
        option, _, value = word.partition("=")
        if option == "--security":
            given = value or next(words, None)
            if not given:
                raise UsageError("--security: name a folder")
            continue
        left.append(word)
    if "--robot-name" in left[:-1]:
        robot = left[left.index("--robot-name") + 1]
    secure(given, robot)
    return left


def _services_of(arguments: Sequence[str]) -> list[str]:
    """The services that a command line begins with, and its options.

    Raises:
        UsageError: there is no such file.
    """
    left = [word for word in arguments if word != ONE_PROCESS]
    begin = next((index for index, word in enumerate(left) if word.startswith("-")), len(left))
    return [*map(_service, left[:begin]), *left[begin:]]


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
    return _service(arguments[0]), arguments[1:]


def _service(word: str) -> str:
    """The service that a word names.

    Raises:
        UsageError: there is no such file.
    """
    service, colon, node_class = word.partition(":")
    return f"{module_of(service) if service.endswith('.py') else service}{colon}{node_class}"
