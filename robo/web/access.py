"""Who may look and who may drive: tokens, addresses of the page, guesses that take longer and longer."""

import enum
import hashlib
import hmac
import ipaddress
import os
import secrets
import tempfile
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from robo.errors import UsageError

_GUESSES = 5
"""Wrong tokens of one address that cost nothing: somebody mistypes."""
_WAIT = 1.0
"""After the next one, s; twice as long after each further one."""
_LONGEST_WAIT = 60.0
_MOST_ADDRESSES = 1_000
"""That are remembered; beyond them all strangers wait together."""
_FORGOTTEN = 600.0
"""An address that has been quiet for so long begins anew, s."""
_SHORTEST = 12
"""Of a token, characters."""
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


class Right(enum.IntEnum):
    """What somebody may do; who may drive may look as well."""

    NONE = 0
    VIEW = 1
    DRIVE = 2


class Tokens(msgspec.Struct, frozen=True):
    """The words by which rights are shown. Empty where none is asked for: on this machine alone."""

    view: str = ""
    drive: str = ""

    @classmethod
    def new(cls) -> "Tokens":
        """Two that nobody can guess."""
        return cls(secrets.token_urlsafe(18), secrets.token_urlsafe(18))

    @classmethod
    def kept(cls, file: Path) -> "Tokens":
        """Those of a file of one's own, which is made, with new ones, where there is none.

        Raises:
            UsageError: it cannot be read or written, or is no such file.
        """
        made = cls.new()
        keep_secret(file, f"{made.drive}\n{made.view}\n")
        return cls.of("", file)

    @classmethod
    def of(cls, host: str, file: Path | None) -> "Tokens":
        """Those of a file; without one none for this machine alone, else two that nobody can guess.

        Args:
            host: the address where the page is to be.
            file: its first line is the token to drive, its second one, if it has one, that to look.

        Raises:
            UsageError: the file cannot be read, or is no such file.
        """
        if file is None:
            return cls() if is_loopback(host) else cls.new()
        try:
            lines = [line.strip() for line in file.read_text(encoding="utf-8").splitlines() if line.strip()]
        except (OSError, ValueError) as error:
            raise UsageError(f"token file {file}: {getattr(error, 'strerror', None) or error}") from None
        if not lines or len(lines) > 2 or any(len(line) < _SHORTEST for line in lines):
            raise UsageError(
                f"token file {file}: its first line is the token to drive, its second one that to look, "
                f"each of at least {_SHORTEST} characters"
            )
        return cls(lines[1] if len(lines) > 1 else "", lines[0])

    def right(self, token: str) -> Right:
        """What a token allows."""
        if not self.drive:
            return Right.DRIVE
        # Both are compared, each in a time that says nothing of how much of it was right.
        given = token.encode(errors="replace")
        drives = hmac.compare_digest(given, self.drive.encode())
        views = bool(self.view) and hmac.compare_digest(given, self.view.encode())
        return Right.DRIVE if drives else Right.VIEW if views else Right.NONE


def keep_secret(file: Path, text: str) -> str:
    """What a file holds that only this user may read; it is made with a text where there is none.

    Raises:
        UsageError: it cannot be read or written.
    """
    try:
        if not file.exists():
            _make(file, text)
        return file.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise UsageError(f"{file}: {getattr(error, 'strerror', None) or error}") from None


def _make(file: Path, text: str) -> None:
    """Make a file that only this user may read: with all of the text at once, however this ends, or as another made it.

    Raises:
        OSError: it cannot be written.
    """
    descriptor, name = tempfile.mkstemp(prefix=f".{file.name[:100]}.", dir=file.parent)
    try:
        with open(descriptor, "w", encoding="utf-8") as out:
            out.write(text)
        try:
            os.link(name, file)
        except FileExistsError:
            pass
        except OSError:  # a file system without links
            os.replace(name, file)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(name)


class _Guesses(msgspec.Struct):
    wrong: int
    until: float
    last: float
    tried: set[str] = msgspec.field(default_factory=set)
    """Digests of the first few wrong tokens: a page with an old one that tries it again and again guesses nothing."""


class Doorkeeper:
    """Lets in who has a token, and makes those wait who guess."""

    def __init__(self, tokens: Tokens) -> None:
        self._tokens = tokens
        self._of: dict[str, _Guesses] = {}

    def right(self, token: str, address: str, now: float) -> Right:
        """What somebody may do.

        Args:
            token: what was shown; empty where nothing was.
            address: of who shows it.
            now: s, by a clock that never goes back.
        """
        if self.wait(address, now) > 0:
            return Right.NONE  # even if it is right: else a guess could be tried meanwhile
        right = self._tokens.right(token)
        # A right one takes back no wrong ones: else who may look could guess, in between, the token to drive.
        if right is Right.NONE and token:
            self._count(token, address, now)
        return right

    def wait(self, address: str, now: float) -> float:
        """How long nothing that this address shows counts, s; 0 where it does."""
        found = self._of.get(self._name(address))
        return max(0.0, found.until - now) if found is not None else 0.0

    def _count(self, token: str, address: str, now: float) -> None:
        self._forget(now)
        found = self._of.setdefault(self._name(address), _Guesses(0, 0.0, now))
        found.last = now
        digest = hashlib.sha256(token.encode(errors="replace")).hexdigest()
        if digest in found.tried:
            return
        if len(found.tried) < _GUESSES:
            found.tried.add(digest)
        found.wrong += 1
        if (beyond := found.wrong - _GUESSES) > 0:
            found.until = now + min(_WAIT * 2.0 ** min(beyond - 1, 10), _LONGEST_WAIT)

    def _forget(self, now: float) -> None:
        for name in [name for name, one in self._of.items() if now - one.last > _FORGOTTEN and one.until <= now]:
            del self._of[name]

    def _name(self, address: str) -> str:
        name = _neighbourhood(address)
        return name if name in self._of or len(self._of) < _MOST_ADDRESSES else ""


def _neighbourhood(address: str) -> str:
    """Whose guesses count together: an address, or of IPv6 the 2^64 that one host may have for itself."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address):
        return address
    return str(found.ipv4_mapped or ipaddress.IPv6Network((int(found), 64), strict=False))


def is_loopback(host: str) -> bool:
    """Whether a page at this address is for this machine alone."""
    return host in _LOOPBACK


def is_own_host(host: str, names: tuple[str, ...] = (), *, addresses: bool = False) -> bool:
    """Whether a request is for this page by a name that it has: another one may lead here by a foreign name server.

    Args:
        host: the header `Host`.
        names: by which it may be called beside those of this machine alone; `*` for any.
        addresses: whether it may be called by any address in numbers, which no name server leads here.
    """
    name = host_of(host)
    if not name:
        return False
    return name in _LOOPBACK or name in map(str.lower, names) or "*" in names or (addresses and _is_address(name))


def host_of(host: str) -> str:
    """The name in a header `Host`, without its port; empty where there is none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return False
    return True


def is_own_origin(origin: str | None, host: str) -> bool:
    """Whether a socket is opened by this page: a browser says which page it is, and lets no page say another one.

    A client that is no browser says none, and has nobody's cookies.
    """
    if origin is None:
        return True
    try:
        said = urlsplit(origin)
    except ValueError:
        return False
    return said.scheme in ("http", "https") and said.netloc.lower() == host.lower()
