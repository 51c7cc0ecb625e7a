"""`robo dashboard`: the page in a browser, served until Ctrl-C."""

import asyncio
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from robo.cli.connection import connect_to_robot
from robo.cli.printing import print_json, print_line
from robo.cli.reach import Reach
from robo.dashboard.access import Tokens
from robo.dashboard.server import Dashboard, Settings, import_websockets
from robo.errors import UsageError

_LOOPBACK = ("127.0.0.1", "::1", "localhost")


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
    import_websockets()  # what is missing is told before anything is dialled
    host, port = _place(listen)
    tokens = _tokens(token_file) if token_file is not None else Tokens() if host in _LOOPBACK else Tokens.new()
    shown = host if host not in ("0.0.0.0", "::") else names[0] if names else _own_name()
    settings = Settings(host, port, tokens, (*names, host, shown))
    with connect_to_robot(reach) as session:
        asyncio.run(_serve(Dashboard(session, settings), lambda port: _tell(shown, port, tokens, json=json)))


async def _serve(dashboard: Dashboard, ready: object) -> None:
    over = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, over.set)
    await dashboard.serve(ready, over.wait())  # type: ignore[arg-type]


def _tell(host: str, port: int, tokens: Tokens, *, json: bool) -> None:
    place = f"http://{f'[{host}]' if ':' in host else host}:{port}/"
    addresses = {"drive": f"{place}?token={tokens.drive}", "view": f"{place}?token={tokens.view}"} if tokens.drive else {
        "drive": place
    }
    if json:
        print_json(addresses)
    else:
        print_line(f"the dashboard is at {addresses['drive']}")
        if tokens.drive:
            print_line(f"  to look and not to drive: {addresses['view']}")
            print_line("  these words travel unencrypted: on a network of strangers put it behind a server with TLS")
        print_line("  Ctrl-C ends it")
    sys.stdout.flush()


def _place(text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not colon or not port.isascii() or not port.isdigit() or int(port) > 65_535:
        raise UsageError(f"--listen {text}: say HOST:PORT, such as 127.0.0.1:8080 or 0.0.0.0:8080")
    return host.strip("[]") or "127.0.0.1", int(port)


def _tokens(path: Path) -> Tokens:
    try:
        lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, ValueError) as error:
        raise UsageError(f"--token-file {path}: {getattr(error, 'strerror', None) or error}") from None
    if not lines or any(len(line) < 12 for line in lines):
        raise UsageError(
            f"--token-file {path}: its first line is the token to drive, its second one that to look, "
            "each of at least 12 characters"
        )
    return Tokens(lines[1] if len(lines) > 1 else "", lines[0])


def _own_name() -> str:
    return os.uname().nodename
