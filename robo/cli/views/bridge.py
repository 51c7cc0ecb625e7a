"""`robo bridge foxglove`: viewers served until Ctrl-C."""

import signal
from pathlib import Path
from typing import NamedTuple

from robo.bridges.foxglove.layouts import layout_of
from robo.cli.connection import connect_to_robot, tell_where_it_is_read_only
from robo.cli.link import watched
from robo.cli.printing import note, print_json, print_line, print_text
from robo.cli.reach import Reach
from robo.errors import UsageError
from robo.text.terminal import visible
from robo.web.access import Tokens, is_loopback
from robo.web.place import addresses, place, shown_host
from robo.web.sockets import import_websockets

_PORT = 8765


class Access(NamedTuple):
    """Who is let in."""

    token_file: Path | None = None
    """Has the tokens; None to make some up where any are needed."""
    is_open: bool = False
    """Whether nobody needs one."""
    origins: tuple[str, ...] = ()
    """Pages that may connect without one."""
    look: bool = False
    """Whether nobody may do more than look."""


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
    import_websockets("the bridge", "foxglove")  # what is missing is told before anything is dialled
    host, port = place(listen, _PORT)
    if access.is_open and access.token_file is not None:
        raise UsageError("--open asks for no token, and --token-file names some: say one of them")
    tokens = Tokens() if access.is_open else Tokens.of(host, access.token_file)
    import asyncio

    from robo.bridges.foxglove.server import Server, Settings

    name = f"robo {reach.robot}" if reach.robot else "robo"
    settings = Settings(name, host, port, tokens, look=access.look, origins=access.origins)

    async def until_stopped(server: Server) -> None:
        over = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, over.set)
        await server.serve(lambda port: _tell(host, port, tokens, look=access.look, json=json), over.wait())

    with connect_to_robot(reach) as session, watched(session, reach) as link:
        if not access.look:
            tell_where_it_is_read_only(session, reach)
        server = Server(session, settings, lambda text: note(visible(text)), reach.covers, lambda: link.lost)
        asyncio.run(until_stopped(server))


def _tell(host: str, port: int, tokens: Tokens, *, look: bool, json: bool) -> None:
    shown = shown_host(host)
    found = addresses("ws", shown, port, tokens)
    if json:
        print_json({**found, "open": not tokens.drive and not is_loopback(host)})
        return
    print_line(f"viewers connect to {found['drive']}")
    if look:
        print_line("  all may look, and nobody drives")
    elif "view" in found:
        print_line(f"  to look and not to drive: {found['view']}")
    if tokens.drive:
        print_line(f"  these words travel unencrypted; safer: ssh -L {port}:127.0.0.1:{port} {shown}")
    elif not is_loopback(host):
        print_line(f"  OPEN: whoever reaches this port {'sees all' if look else 'drives the robot'}")
    print_line("  Ctrl-C ends it")
