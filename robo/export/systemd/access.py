"""Who may read what: a service often runs as somebody else than who tries it by hand."""

import grp
import os
import pwd
import stat
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from robo.errors import UsageError
from robo.export.systemd.devices import Found

_HOMES = (Path("/home"), Path("/root"), Path("/run/user"))
"""What `ProtectHome=` hides."""


class Reader(NamedTuple):
    """Somebody who reads files."""

    uid: int
    groups: frozenset[int]


STRANGER = Reader(-1, frozenset())
"""Whom no file is of."""


def reader(user: str) -> Reader:
    """A user of this machine.

    Raises:
        UsageError: there is none of this name.
    """
    try:
        found = pwd.getpwnam(user)
    except KeyError:
        raise UsageError(
            f"there is no user {user} on this machine; `--run-as dynamic` lets systemd make one up"
        ) from None
    return Reader(found.pw_uid, frozenset(os.getgrouplist(user, found.pw_gid)))


def hindered(path: Path, who: Reader) -> Path | None:
    """What keeps somebody from reading a file or folder: it, or a folder above it; None where nothing does."""
    real = path.resolve()
    for one in (*reversed(real.parents), real):
        try:
            mode = one.stat()
        except OSError:
            return one
        wanted = stat.S_IXOTH if stat.S_ISDIR(mode.st_mode) else stat.S_IROTH
        if who.uid != 0 and not mode.st_mode & (wanted << _shift(mode, who)):
            return one
    return None


def in_a_home(path: Path) -> bool:
    """Whether something is in somebody's home, as far as systemd hides it."""
    real = path.resolve()
    return any(real.is_relative_to(home) for home in _HOMES)


def found_devices(words: Collection[str]) -> dict[str, Found]:
    """What this machine knows of some devices, by their paths."""
    found = {}
    for word in words:
        try:
            group = grp.getgrgid(os.stat(word).st_gid).gr_name
        except (OSError, KeyError):
            continue
        found[word] = Found(os.path.realpath(word), group)
    return found


def group_names() -> frozenset[str]:
    """The groups of this machine."""
    return frozenset(group.gr_name for group in grp.getgrall())


def _shift(mode: os.stat_result, who: Reader) -> int:
    """Which bits of a file's mode are for somebody: the owner's, the group's, or those of all others."""
    if mode.st_uid == who.uid:
        return 6
    return 3 if mode.st_gid in who.groups else 0
