"""`robo dashboard`: the page in a browser, served until Ctrl-C."""

import asyncio
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from robo.cli.connection import connect_to_robot, tell_where_it_is_read_only
from robo.cli.printing import print_json, print_line
from robo.cli.reach import Reach
from robo.dashboard.place import PORT, Settings
from robo.dashboard.server import Dashboard
from robo.web.place import place
from robo.web.sockets import import_websockets


def serve(reach: Reach, *, listen: str, token_file: Path | None, names: Sequence[str], json: bool) -> None:
    """Serve the page until Ctrl-C.

    Args:
        reach: the robots' network.
        listen: HOST:PORT.
        token_file: has the tokens; None to make some up where any are needed.
        names: by which the page may be called.
        json: print its addresses as JSON.

    Raises:
        UsageError: `listen` is no place, or the file has no token.
        RunError: the library for sockets is not installed.
        NetworkError: no robot runs there, or the port cannot be had.
    """
    import_websockets("the dashboard", "dashboard")  # what is missing is told before anything is dialled
    host, port = place(listen, PORT)
    settings = Settings.of(host, port, token_file, names)
    with connect_to_robot(reach) as session:
        tell_where_it_is_read_only(session, reach)
        asyncio.run(_serve(Dashboard(session, settings), lambda port: _tell(settings, port, json=json)))


async def _serve(dashboard: Dashboard, ready: Callable[[int], object]) -> None:
    over = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, over.set)
    await dashboard.serve(ready, over)


def _tell(settings: Settings, port: int, *, json: bool) -> None:
    addresses = settings.addresses(port)
    if json:
        print_json(addresses)
    else:
        print_line(f"the dashboard is at {addresses['drive']}")
        if "view" in addresses:
            print_line(f"  to look and not to drive: {addresses['view']}")
        if settings.tokens.drive:
            print_line("  these words travel unencrypted: on a network of strangers put it behind a server with TLS")
        print_line("  Ctrl-C ends it")
    sys.stdout.flush()
