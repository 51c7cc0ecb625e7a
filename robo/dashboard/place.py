"""Where the page is, who is let in, and the addresses that people open."""

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import msgspec

from robo.dashboard.access import Tokens

PORT = 8080
_ANYWHERE = ("0.0.0.0", "::")


class Settings(msgspec.Struct, frozen=True):
    """Where the page is, and who is let in."""

    host: str = "127.0.0.1"
    port: int = PORT
    """0 for any that is free."""
    tokens: Tokens = Tokens()
    """Empty for no tokens, on this machine alone."""
    names: tuple[str, ...] = ()
    """By which the page may be called beside those of this machine; `*` for any."""

    @classmethod
    def of(cls, host: str, port: int, token_file: Path | None, names: Sequence[str]) -> "Settings":
        """Those for a place; tokens are made up where any are needed and no file has them.

        Raises:
            UsageError: the file has no tokens.
        """
        own = host if host not in _ANYWHERE else os.uname().nodename
        # The first name is the one that is shown.
        known = tuple(dict.fromkeys([*names, own]))
        return cls(host, port, Tokens.of(host, token_file), known)

    def addresses(self, port: int) -> dict[str, str]:
        """What to open: by `drive`, and where there are tokens for it by `view`.

        Args:
            port: the one that was had.
        """
        shown = self.host if self.host not in _ANYWHERE else self.names[0]
        place = f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/"
        if not self.tokens.drive:
            return {"drive": place}
        tokens = {"drive": self.tokens.drive, "view": self.tokens.view}
        return {right: f"{place}?token={quote(token, safe='')}" for right, token in tokens.items() if token}
