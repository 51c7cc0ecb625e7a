"""Where what one user runs on a machine meets: a socket in a folder that is that user's alone.

Everybody may dial a port of loopback, and whoever is first may listen there. A socket has the rights of its folder.
The folder is at the same place for whoever has the same user id: a login, a service, a cron job, `sudo -u`. The one
that XDG_RUNTIME_DIR names is not set for all of these, and goes with the last login while robots run on.
"""

import math
import os
import pwd
import stat
import time

from robo.environment import MEETING_VARIABLE
from robo.errors import NetworkError

UNIX = "unixsock-stream/"
"""What an endpoint over a unix socket begins with."""

_NAME = "router.sock"
_LONGEST = 100
"""Of a socket's path, bytes: the system takes 107, and Zenoh puts a lock beside it."""

LINKED_WITHIN = 2.0
"""How long robots may take to link to the router that has taken the place over, s.

They dial it 0.3 s after they have lost the one before, and where it was not there yet half a second later; a machine
may be busy.
"""


def folder() -> str:
    """The folder of this process's user: what ROBO_MEETING says, else `/tmp/robo-UID`."""
    # As text: every node comes here, and `pathlib` with what it brings along would cost each of them 0.7 MB.
    return os.path.normpath(os.environ.get(MEETING_VARIABLE) or f"/tmp/robo-{os.geteuid()}")


def endpoint() -> str:
    """Where robots of this user listen, and their tools dial."""
    return f"{UNIX}{_socket()}"


def _socket() -> str:
    return os.path.join(folder(), _NAME)


def prepare() -> None:
    """Make sure that the folder is there, and that it is this user's alone.

    Raises:
        NetworkError: it cannot be made, or is not to be trusted.
    """
    place = folder()
    if len(os.fsencode(_socket())) > _LONGEST or not os.path.isabs(place):
        raise NetworkError(
            f"{MEETING_VARIABLE}={place}: say the whole path of a folder, of {_LONGEST - len(_NAME) - 1} bytes at most"
        )
    try:
        os.mkdir(place, mode=0o700)
    except FileExistsError:
        pass  # whatever it is, that is looked at next
    except OSError as error:
        raise NetworkError(
            f"the folder {place}, where robots of this user meet, cannot be made: {error.strerror}\n"
            f"  name another one in {MEETING_VARIABLE}, or say an endpoint: --listen tcp/127.0.0.1:7448"
        ) from None
    check()


def check() -> None:
    """See that the folder, if there is one, is this user's alone.

    Raises:
        NetworkError: it is somebody else's, a link, or open to others: who dials there may meet anybody.
    """
    place = folder()
    try:
        found = os.lstat(place)
    except OSError:
        return  # nothing to be trusted
    wrong = distrust(found, os.geteuid())
    if wrong is not None:
        raise NetworkError(
            f"{place}, where robots of this user meet, {wrong}: nothing is looked for there\n"
            f"  remove it, or name another folder in {MEETING_VARIABLE}"
        )


def distrust(found: os.stat_result, uid: int) -> str | None:
    """What is wrong with what stands at a place that is to be one user's alone; None where nothing is.

    Args:
        found: what stands there, a link not followed.
        uid: of the user.
    """
    if not stat.S_ISDIR(found.st_mode):
        return f"is {'a link' if stat.S_ISLNK(found.st_mode) else 'no folder'}, made by user {user_name(found.st_uid)}"
    if found.st_uid != uid:
        return f"belongs to user {user_name(found.st_uid)}"
    if found.st_mode & 0o077:
        return f"is open to others (mode {found.st_mode & 0o777:03o}; chmod 700 closes it)"
    return None


def user_name(uid: int) -> str:
    """The name of a user; the number where it has none, as in containers."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def path_of(place: str) -> str | None:
    """The path of an endpoint over a unix socket; None for another kind."""
    return place.removeprefix(UNIX) if place.startswith(UNIX) else None


def knock(path: str, within: float) -> OSError | None:
    """What is wrong with a unix socket, or None where somebody listens there.

    Args:
        path: the socket's.
        within: how long somebody who is busy may take to let one in, s.
    """
    import socket  # only those need it who look for others

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as caller:
        caller.settimeout(within)
        try:
            caller.connect(path)
        except FileNotFoundError as error:
            return ConnectionRefusedError(error.errno, error.strerror)  # nobody has ever listened there
        except OSError as error:
            return error
    return None


def is_met() -> bool:
    """Whether a robot of this user listens, or was here a moment ago and may be handing the place over.

    Raises:
        NetworkError: the folder is not to be trusted.
    """
    check()
    return os.path.exists(_socket())


def held_for() -> float:
    """How long whoever listens there has done so, s; infinite where nobody does."""
    try:
        return time.time() - os.stat(_socket()).st_mtime
    except FileNotFoundError:
        return math.inf


def gathers_for() -> float:
    """How much longer those who meet there may take until all have linked, s; 0 where they have met for long."""
    return max(0.0, LINKED_WITHIN - abs(held_for()))  # below 0 where the clock was put back since
