"""Where something is served, and the addresses that people open."""

import os
from urllib.parse import quote

from robo.errors import UsageError
from robo.web.access import Tokens

_ANYWHERE = ("0.0.0.0", "::")


def place(text: str, port: int) -> tuple[str, int]:
    """The host and the port of what `--listen` says.

    Args:
        text: `HOST:PORT`.
        port: for an example.

    Raises:
        UsageError: it is no such words.
    """
    host, colon, number = text.rpartition(":")
    if not (colon and number.isascii() and number.isdigit() and len(number) <= 5 and int(number) <= 65_535):
        raise UsageError(f"--listen {text}: say HOST:PORT, such as 127.0.0.1:{port} or 0.0.0.0:{port}")
    return host.strip("[]") or "127.0.0.1", int(number)


def shown_host(host: str) -> str:
    """By which others reach what is served at an address: this machine's name where it is served at all of them."""
    return os.uname().nodename if host in _ANYWHERE else host


def addresses(scheme: str, shown: str, port: int, tokens: Tokens) -> dict[str, str]:
    """What to open: by `drive`, and where there is a token for it by `view`.

    Args:
        scheme: `http`, `ws`.
        shown: the host, as others reach it.
        port: the one that was had.
        tokens: who is let in.
    """
    where = f"{scheme}://{f'[{shown}]' if ':' in shown else shown}:{port}/"
    if not tokens.drive:
        return {"drive": where}
    words = {"drive": tokens.drive, "view": tokens.view}
    return {right: f"{where}?token={quote(word, safe='')}" for right, word in words.items() if word}
