"""Where the page is, who is let in, and the addresses that people open."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo.errors import UsageError
from robo.web.access import Tokens, host_of
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
    key: str = ""
    """By which browsers' cookies are made; empty for one of this process alone."""

    @classmethod
    def of(cls, host: str, port: int, token_file: Path | None, names: Sequence[str]) -> "Settings":
        """Those for a place; tokens are made up where any are needed and no file has them.

        Raises:
            UsageError: the file has no tokens, or something is no name.
        """
        check_names(host, names)
        # The first name is the one that is shown.
        known = tuple(dict.fromkeys([*names, shown_host(host)]))
        return cls(host, port, Tokens.of(host, token_file), known)

    def place(self, port: int) -> str:
        """Where it is, without a token; `port` is the one that was had."""
        return addresses("http", self._shown, port, Tokens())["drive"]

    def addresses(self, port: int) -> dict[str, str]:
        """What to open: by `drive`, and where there are tokens for it by `view`.

        Args:
            port: the one that was had.
        """
        return addresses("http", self._shown, port, self.tokens)

    @property
    def _shown(self) -> str:
        return self.names[0] if shown_host(self.host) != self.host else self.host


def check_names(host: str, given: Sequence[str]) -> None:
    """
    Raises:
        UsageError: `host` is no address, or a name has a port, which is not part of it.
    """
    if not host:
        raise UsageError("the dashboard's host is empty: say 127.0.0.1, or 0.0.0.0 for all addresses of this machine")
    for name in given:
        if not name or (name != "*" and host_of(f"[{name}]" if name.count(":") > 1 else name) != name.lower()):
            raise UsageError(f"--name {name}: say a name of this host alone, such as r1.local, without a port")
