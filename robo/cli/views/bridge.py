"""`robo bridge foxglove`: viewers served until Ctrl-C."""

import os
import re
import signal
from pathlib import Path
from typing import NamedTuple

from robo.bridges.foxglove.layouts import layout_of
from robo.bridges.foxglove.library import import_websockets
from robo.cli.connection import connect_to_robot
from robo.cli.link import watched
from robo.cli.printing import note, print_json, print_line, print_text
from robo.cli.reach import Reach
from robo.dashboard.access import Tokens
from robo.errors import UsageError
from robo.text.terminal import visible

_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_LEAST_TOKEN = 12


class Access(NamedTuple):
    """Who is let in."""

    token_file: Path | None = None
    """Has the tokens; None to make some up where any are needed."""
    is_open: bool = False
    """Whether nobody needs one."""
    origins: tuple[str, ...] = ()
    """Pages that may connect without one."""


def print_layout(viewer: str, reach: Reach) -> None:
    """Print a layout of a viewer for the robot that is named.

    Raises:
        UsageError: there is none for such a viewer.
    """
    print_text(layout_of(viewer, reach.robot))


def serve(reach: Reach, *, listen: str, access: Access, json: bool) -> None:
    """Serve viewers until Ctrl-C.

    Args:
        reach: the robots' network.
        listen: HOST:PORT.
        access: who is let in.
        json: print the addresses as JSON.

    Raises:
        UsageError: `listen` is no place, or the file has no token.
        RunError: the library for sockets is not installed.
        NetworkError: no robot runs there, or the port cannot be had.
    """
    import_websockets()  # what is missing is told before anything is dialled
    host, port = _place(listen)
    tokens = _tokens(host, access)
    import asyncio

    from robo.bridges.foxglove.server import Server, Settings

    name = f"robo {reach.robot}" if reach.robot else "robo"
    settings = Settings(name, host, port, tokens, access.origins)

    async def until_stopped(server: Server) -> None:
        over = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, over.set)
        await server.serve(lambda port: _tell(host, port, tokens, json=json), over.wait())

    with connect_to_robot(reach) as session, watched(session, reach):
        asyncio.run(until_stopped(Server(session, settings, lambda text: note(visible(text)), reach.covers)))


def _tell(host: str, port: int, tokens: Tokens, *, json: bool) -> None:
    shown = os.uname().nodename if host in ("0.0.0.0", "::") else host
    place = f"ws://{f'[{shown}]' if ':' in shown else shown}:{port}"
    words = {"drive": tokens.drive, "view": tokens.view} if tokens.drive else {"drive": ""}
    addresses = {
        right: f"{place}/?token={word}" if word else place for right, word in words.items() if word or not tokens.drive
    }
    if json:
        print_json({**addresses, "open": not tokens.drive and host not in _LOOPBACK})
        return
    print_line(f"viewers connect to {addresses['drive']}")
    if "view" in addresses:
        print_line(f"  to look and not to drive: {addresses['view']}")
    if tokens.drive:
        print_line(f"  these words travel unencrypted; safer: ssh -L {port}:127.0.0.1:{port} {shown}")
    elif host not in _LOOPBACK:
        print_line("  OPEN: whoever reaches this port drives the robot")
    print_line("  Ctrl-C ends it")


def _place(text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not colon or not re.fullmatch(r"[0-9]{1,5}", port) or int(port) > 65_535:
        raise UsageError(f"--listen {text}: say HOST:PORT, such as 127.0.0.1:8765 or 0.0.0.0:8765")
    return host.strip("[]") or "127.0.0.1", int(port)


def _tokens(host: str, access: Access) -> Tokens:
    if access.token_file is not None:
        if access.is_open:
            raise UsageError("--open asks for no token, and --token-file names some: say one of them")
        return _tokens_of(access.token_file)
    return Tokens() if access.is_open or host in _LOOPBACK else Tokens.new()


def _tokens_of(path: Path) -> Tokens:
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, ValueError) as error:
        raise UsageError(f"--token-file {path}: {getattr(error, 'strerror', None) or error}") from None
    if not lines or any(len(line) < _LEAST_TOKEN or not re.fullmatch(r"[\w.~-]+", line) for line in lines):
        raise UsageError(
            f"--token-file {path}: its first line is the token to drive, its second one that to look, each of at least "
            f"{_LEAST_TOKEN} letters, digits, - and _"
        )
    return Tokens(lines[1] if len(lines) > 1 else "", lines[0])
