"""The door of a secured network: the router that others meet by TLS, opened anew when its files change.

A robot's nodes meet at a router of their own, behind the door and without any of this: its rules and keys can change
while the robot drives, and nothing of its inside is touched.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import msgspec
import zenoh

from robo.errors import NetworkError, SecurityError
from robo.process.zenoh_log import ZenohLog
from robo.wire import identity, keys, listeners, meeting, tcp, tls
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

LOOK_EVERY = 0.2
"""How often it is looked whether the files have changed, s."""
_LISTENS_WITHIN = 2.0
"""How long a router may take until it listens, s."""
_ROUTES_WITHIN = 0.5
"""How long routers take at most to find their ways through a new one, s; Zenoh begins 0.1 s after the last link."""
_READ_WITHIN = 0.5
"""How long it may take until what was refused just before is read in Zenoh's log and counted, s."""
_WARN_DAYS = 7
_DAY = 86_400

_CALLED = ("CA", "certificate", "key", "rules")
"""What people call `Identity.files`."""


def parted(network: Network) -> tuple[Network | None, Network]:
    """A router as two: one for what is its user's on this machine, if it has that, and the door that dials it.

    Unix sockets are of the inner one, which has no rules: they are in folders of one user's.
    """
    own = _unix(network.listen)
    if not network.security or not own:
        return None, network
    within = _unix(network.connect)
    inner = msgspec.structs.replace(network, listen=own, connect=within, more={}, security="")
    others = tuple(one for one in network.listen if one not in own)
    dialled = (*(one for one in network.connect if one not in within), own[0])
    return inner, msgspec.structs.replace(network, listen=others, connect=dialled, name=f"door of {network.name}")


def _unix(endpoints: Sequence[str]) -> tuple[str, ...]:
    return tuple(one for one in endpoints if one.startswith(meeting.UNIX))


class Door:
    """A router with its rules."""

    def __init__(self, network: Network, log: ZenohLog, tell: Callable[[str], None]) -> None:
        """
        Args:
            network: how it joins, with the folder of its name.
            log: what Zenoh says, in which is what was refused: whoever may see the robots is told of it.
            tell: takes what the owner is to know.

        Raises:
            SecurityError: something is wrong with its files.
            NetworkError: it cannot be opened, or nobody can reach it where it is to listen.
        """
        self._network = network
        self._log = log
        self._tell = tell
        self._identity = identity.load(identity.folder_of(network.security))
        self._stamp = _stamp(self._identity.files)
        self._doubted = False
        self._warned = 0.0
        self._places = [place for one in network.listen if (place := tcp.nearby(one)) is not None]
        self._tell_who_has_its_place()
        self._session = self._open()
        if not self._is_listened():
            close_session(self._session)
            raise NetworkError(f"nobody can reach this router: {self._deaf()}")
        self._tell_of_age()

    def look(self) -> None:
        """Open it anew if its certificate, its key, its CA or its rules are others now, and make sense."""
        if time.time() - self._warned > _DAY:
            self._tell_of_age()
        stamp = _stamp(self._identity.files)
        if stamp == self._stamp:
            self._doubted = False
            return
        try:
            changed = identity.load(self._identity.folder)
            identity.settings(changed, router=True)
        except SecurityError as error:
            if self._doubted:  # the second time: it is not just being written
                self._tell(f"its new files are not used, it goes on with those before: {error}")
                self._stamp, self._doubted = stamp, False
            else:
                self._doubted = True
            return
        begin = time.monotonic()
        pairs = zip(_CALLED, self._stamp, stamp, strict=True)
        what = " and ".join(f"its {name}" for name, before, now in pairs if before != now)
        self._identity, self._stamp, self._doubted = changed, stamp, False
        self._open_anew()
        if not self._is_listened():
            self._tell(f"nobody can reach it just now: {self._deaf()}")
        self._tell(f"{what} changed: opened anew, within {time.monotonic() - begin:.2f} s")
        self._tell_of_age()

    def close(self) -> bool:
        """Close it; as `close_session`."""
        return close_session(self._session)

    def _open_anew(self) -> None:
        """Open it with its new files: where it dials others, beside the former one, which is closed a moment later.

        A router of Zenoh 1.10 that takes the place of another one, between two that it links, within its time for
        finding routes was seen to lose what one of them had declared, for good, in one of two cases.
        """
        former = self._session
        if any(one not in self._network.listen for one in self._network.connect):
            self._session = self._open()
            time.sleep(_ROUTES_WITHIN)
            close_session(former)
        else:
            close_session(former)
            self._session = self._open()

    def _open(self) -> zenoh.Session:
        self._log.reader.known = identity.named(self._identity)
        session = open_session(msgspec.structs.replace(self._network, shared_memory=False))
        key = keys.refusals_key(self._identity.about.name)

        def answer(query: zenoh.Query) -> None:
            self._log.catch_up(_READ_WITHIN)
            with suppress(zenoh.ZError):  # who has asked is gone
                query.reply(key, msgspec.json.encode(self._log.tally.listed()))

        session.declare_queryable(key, answer)
        return session

    def _is_listened(self) -> bool:
        """Whether somebody listens where it is to, in time: Zenoh goes on without a listener that it could not make."""
        end = time.monotonic() + _LISTENS_WITHIN
        while any(wrong is not None for _, wrong in tcp.tried(self._places, _LISTENS_WITHIN)):
            if time.monotonic() >= end:
                return False
            time.sleep(0.01)
        return True

    def _deaf(self) -> str:
        """Where nobody listens though it should, and why, as far as the system says."""
        wrong = {place: error for place, error in tcp.tried(self._places, _LISTENS_WITHIN) if error is not None}
        said = []
        for place in wrong:
            port = (tcp.address_of(place) or ("", 0))[1]
            error = tcp.cannot_listen(place)
            why = error.strerror if error is not None else "Zenoh has not taken it"
            said.append(f"nothing listens at {place}, port {port}: {why}")
        return "; ".join(said)

    def _tell_who_has_its_place(self) -> None:
        """Name who listens where this door is to, if that is none of this network; another user is named elsewhere."""
        for place in tcp.answering(self._places, _LISTENS_WITHIN):
            found = listeners.holder(place)
            wrong = tls.refused(place, str(self._identity.folder), _LISTENS_WITHIN)
            if wrong and not (found is not None and found.is_stranger):
                port = (tcp.address_of(place) or ("", 0))[1]
                self._tell(f"{place} is taken{tcp.listener(port)}: {wrong}; this door is there when it is free")

    def _tell_of_age(self) -> None:
        self._warned = time.time()
        about = self._identity.about
        left = (about.not_after - time.time()) / _DAY
        if left <= 0:
            self._tell(f"the certificate of {about.name} has expired: nobody lets it in; `robo security renew`")
        elif left < _WARN_DAYS:
            self._tell(f"the certificate of {about.name} expires in {left:.1f} days; `robo security renew`")


def _stamp(files: tuple[Path, ...]) -> tuple[tuple[int, int, int], ...]:
    """What tells whether files are others now."""
    found = []
    for file in files:
        try:
            info = file.stat()
        except OSError:
            found.append((0, 0, 0))
        else:
            found.append((info.st_ino, info.st_mtime_ns, info.st_size))
    return tuple(found)
