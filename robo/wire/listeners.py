"""Who listens at a port of this machine: which user, and which process where one may know it."""

import os
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from robo.wire import meeting, tcp

_LISTENS = "0A"
"""The state of a socket that listens, as the kernel's table has it."""


class Holder(NamedTuple):
    """Who listens at a port."""

    port: int
    host: str
    uid: int
    is_deaf: bool = False
    """Whether no Zenoh has answered there to somebody who has asked."""

    @property
    def is_stranger(self) -> bool:
        """Whether it is another user. One who is root may do all on a machine anyway, as an engine of containers is."""
        return self.uid not in (os.geteuid(), 0)

    def __str__(self) -> str:
        deaf = " and no Zenoh answers there" if self.is_deaf else ""
        return f"port {self.port} on {self.host} is held{tcp.listener(self.port, self.uid)}{deaf}"


def holder(endpoint: str) -> Holder | None:
    """Who listens at an endpoint of loopback over TCP; None where nobody does, or where that cannot be known."""
    address = tcp.address_of(endpoint)
    if address is None or sys.platform != "linux":
        return None
    for table in ("tcp", "tcp6"):
        with suppress(OSError):
            for uid in users_listening(Path("/proc/net", table).read_text(), address[1]):
                return Holder(address[1], address[0], uid)
    return None


def users_listening(table: str, port: int) -> Iterator[int]:
    """The ids of the users who listen at a port of loopback, or at that port of all addresses.

    Args:
        table: the kernel's, of /proc/net/tcp or tcp6: after a line of heads one for each socket, with the address in
            hexadecimal digits, each four bytes in the machine's order.
        port: the number.
    """
    for line in table.splitlines()[1:]:
        columns = line.split()
        if len(columns) < 8 or columns[3] != _LISTENS:
            continue
        address, _, number = columns[1].partition(":")
        if int(number, 16) == port and (not address.strip("0") or _is_loopback(address)):
            yield int(columns[7])


def _is_loopback(address: str) -> bool:
    words = [bytes.fromhex(address[i : i + 8]) for i in range(0, len(address), 8)]
    if sys.byteorder == "little":
        words = [word[::-1] for word in words]
    whole = b"".join(words)
    if len(whole) == 4:
        return whole[0] == 127
    return whole == b"\0" * 15 + b"\1" or (whole[:12] == b"\0" * 10 + b"\xff\xff" and whole[12] == 127)


def in_the_way(doors: Iterable[str], within: float) -> list[Holder]:
    """Who holds the doors at which routers let others in, and keeps others from finding robots there.

    That is another user, who is not dialled, whatever he runs there; and a program, this user's or root's, at which no
    Zenoh answers. What a door of TLS has to say of that is for whoever has a key.

    Args:
        doors: endpoints, as `Network.doors` has them.
        within: how long a router may take to answer, s: it may be held up.
    """
    found = []
    for door in doors:
        one = holder(door)
        if one is not None and one.is_stranger:
            found.append(one)
        elif one is not None and door.startswith("tcp/") and _is_deaf(door, within):
            found.append(one._replace(is_deaf=True))
    return found


def _is_deaf(endpoint: str, within: float) -> bool:
    end = time.monotonic() + within
    while (left := end - time.monotonic()) > 0:
        speaks = tcp.speaks_zenoh(endpoint, left)
        if speaks is not None:
            return not speaks
        if holder(endpoint) is None:
            return False  # it has left meanwhile
        time.sleep(0.02)
    return True


def owner_of(endpoint: str) -> str | None:
    """The name of another user who listens at an endpoint; None where it is not another."""
    found = holder(endpoint)
    return meeting.user_name(found.uid) if found is not None and found.is_stranger else None
