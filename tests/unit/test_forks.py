"""Asking the template for processes, without one."""

import asyncio
import socket
import subprocess
from typing import cast

from robo.machine.forks import Template


def test_what_has_a_variable_that_is_not_utf_8_is_started_in_another_way() -> None:
    async def scene() -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with ours, theirs:
            template = Template(cast("subprocess.Popen[bytes]", None), ours)
            assert await template.fork(["module"], {"NAME": b"\xff".decode(errors="surrogateescape")}, ()) is None

    asyncio.run(scene())
