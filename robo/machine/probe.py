"""Whether something works on this machine: an address that listens, a command that succeeds."""

import asyncio
import os
import signal
from collections.abc import Mapping, Sequence
from contextlib import suppress

from robo.machine.child import Spawned


async def listens(address: str) -> bool:
    """Whether something accepts connections at `host:port`."""
    host, _, port = address.rpartition(":")
    try:
        _, writer = await asyncio.open_connection(host, int(port))
    except OSError:
        return False
    writer.close()
    return True


async def succeeds(command: Sequence[str], environment: Mapping[str, str], cwd: str | None, spawned: Spawned) -> bool:
    """Whether a command ends with exit code 0; a caller that gives up kills it and all that it has started.

    Args:
        command: its words.
        environment: all of it.
        cwd: the folder it runs in.
        spawned: the processes of the run, to which it belongs while it runs.
    """
    try:
        probe = await asyncio.create_subprocess_exec(
            *command,
            env=environment,
            cwd=cwd,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL,
            process_group=0,
        )
    except OSError:
        return False
    spawned.add(probe.pid)
    try:
        return await probe.wait() == 0
    finally:
        spawned.discard(probe.pid)
        if probe.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(probe.pid, signal.SIGKILL)
