"""Where the page is, who is let in, and the addresses that people open."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo.web.access import Tokens
from robo.web.place import addresses, shown_host

PORT = 8080


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
        # The first name is the one that is shown.
        known = tuple(dict.fromkeys([*names, shown_host(host)]))
        return cls(host, port, Tokens.of(host, token_file), known)

    def addresses(self, port: int) -> dict[str, str]:
        """What to open: by `drive`, and where there are tokens for it by `view`.

        Args:
            port: the one that was had.
        """
        shown = self.names[0] if shown_host(self.host) != self.host else self.host
        return addresses("http", shown, port, self.tokens)
