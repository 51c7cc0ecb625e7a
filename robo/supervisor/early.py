"""What a run begins with before it knows what to start: its id, and the template of its nodes.

The template imports what nodes need while the command still reads the manifest. This module imports
next to nothing, so that it can begin at once.
"""

import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from robo.environment import RUN_VARIABLE, SECURITY_VARIABLE
from robo.machine.service_manager import ServiceManager
from robo.process.template import PADDING
from robo.wire.run_id import new_run_id

_ALLOCATOR = {"MALLOC_ARENA_MAX": "2"}
"""glibc gives threads memory from pools of their own, up to eight for each processor core, and each keeps up to twice
the largest message that it ever held. A node has some twenty threads, few of which are busy at once."""


class HeadStart(NamedTuple):
    """A run that has begun."""

    run_id: str
    template: "tuple[subprocess.Popen[bytes], socket.socket] | None"
    """The template process and the socket to ask it on; None where processes are not forked."""
    manager: ServiceManager | None = None
    """What has started this process as a service; None where it was not."""


def begin() -> HeadStart:
    """Begin a run. What has been begun ends with this process."""
    manager = ServiceManager.from_environment()  # first, so that nobody else finds it there
    run_id = new_run_id()
    return HeadStart(run_id, _start_template({**base_environment(), RUN_VARIABLE: run_id}), manager)


def base_environment() -> dict[str, str]:
    """What every process of a run finds: this one's environment, and the programs that run here."""
    # Nodes meet at their robot's router, and have no name of their own on a secured network.
    environment = {name: value for name, value in os.environ.items() if name != SECURITY_VARIABLE}
    return {**_ALLOCATOR, **environment, "PYTHONUNBUFFERED": "1", "PATH": search_path()}


def search_path() -> str:
    """Where the programs of a launch are looked for: `python` and `robo` are those that run here."""
    return os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])


def _start_template(environment: dict[str, str]) -> "tuple[subprocess.Popen[bytes], socket.socket] | None":
    if sys.platform != "linux":  # a changed command line, and message boundaries on a socket
        return None
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    with theirs:
        command = [sys.executable, "-m", "robo.process.template", str(theirs.fileno()), PADDING]
        try:
            process = subprocess.Popen(
                command, env=environment, stdin=subprocess.DEVNULL, pass_fds=(theirs.fileno(),), process_group=0
            )
        except OSError:
            ours.close()
            return None
    return process, ours
