"""Who a process is on a secured network: the folder with its key, its certificate and its CA, and Zenoh's settings.

Only paths are passed on: Zenoh reads the files itself, so a key stands in no setting, no environment and no message.
All of it is looked at before Zenoh sees it, which prints a key that does not fit its certificate.
"""

import os
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from robo.errors import SecurityError, UnreadableFile
from robo.text.files import read_bytes
from robo.text.readable import readable

NAMES = "names"
"""The folder of a keystore in which each name has its own."""
CA, CERTIFICATE, KEY, RULES, ABOUT = "ca.pem", "cert.pem", "key.pem", "access.json", "about.json"
"""What is in the folder of a name; rules where it is that of a robot or a router."""

PROTOCOLS = ("tls", "unixsock-stream")
"""What a secured process listens at and dials: nobody can talk it into a word in the clear."""

MOST_OF_RULES = 64_000_000
"""Bytes."""


class Finding(NamedTuple):
    """Something that is wrong."""

    file: Path
    text: str


class About(msgspec.Struct, frozen=True, kw_only=True):
    """What a folder says of its name, beside the certificate."""

    name: str
    role: Literal["robot", "router", "operator", "viewer"]
    not_after: int
    """When the certificate expires, s since the epoch."""
    serial: str
    """Of the certificate, in hexadecimal digits."""
    hosts: tuple[str, ...] = ()
    """By what names and addresses it may be dialled."""


class Identity(NamedTuple):
    """A folder that has been looked at."""

    folder: Path
    about: About

    @property
    def files(self) -> tuple[Path, ...]:
        """What a router reads when it starts."""
        return tuple(self.folder / name for name in (CA, CERTIFICATE, KEY, RULES))


def folder_of(given: str, called: str = "") -> Path:
    """The folder of a name that somebody means by `--security DIR`: that very folder, or a keystore that has it.

    Args:
        given: a folder.
        called: what the robot or router is called: in a keystore it is that name.

    Raises:
        SecurityError: there is none; says which there are.
    """
    folder = Path(given).absolute()
    if (folder / CERTIFICATE).exists() or (folder / KEY).exists():
        return folder
    if not (folder / NAMES).is_dir():
        there = "it is not there" if not folder.exists() else f"it has neither {CERTIFICATE} nor {NAMES}/"
        raise SecurityError(f"--security {given}: {there}; `robo security init` makes a keystore, `add` a name in it")
    names = sorted(path.name for path in (folder / NAMES).iterdir())
    if called in names:
        return folder / NAMES / called
    if len(names) == 1 and not called:
        return folder / NAMES / names[0]
    which = f"it has no name {called}" if called else "it has several names, and only one can be meant"
    there = f"; say --security {given}/{NAMES}/NAME: {', '.join(names)}" if names else "; it has none so far"
    raise SecurityError(f"--security {given}: {which}{there}")


def load(folder: str | Path) -> Identity:
    """A name's folder, once all is well with it.

    Raises:
        SecurityError: something is missing, a key may be read by others, or does not fit; a line for each.
    """
    folder = Path(folder)
    found = [*faults(folder)]
    if found:
        raise SecurityError("\n".join(f"{fault.file}: {fault.text}" for fault in found))
    return Identity(folder, _about(folder / ABOUT))


def faults(folder: Path) -> list[Finding]:
    """What is wrong with a name's folder."""
    found = [
        *too_open(folder, folder=True),
        *too_open(folder / KEY, folder=False),
        *(Finding(folder / name, "it is missing") for name in (CA, CERTIFICATE, ABOUT) if not (folder / name).exists()),
    ]
    if found:
        return found
    try:
        about = _about(folder / ABOUT)
    except SecurityError as error:
        return [Finding(folder / ABOUT, str(error))]
    if about.role in ("robot", "router") and not (folder / RULES).exists():
        found.append(Finding(folder / RULES, "the rules of this router are missing; `robo security renew` writes them"))
    return [*found, *_misfit(folder)]


def too_open(path: Path, *, folder: bool) -> list[Finding]:
    """Whether somebody else may read a key, or put another one in its place."""
    what, mode = ("folder", 0o700) if folder else ("key", 0o600)
    try:
        info = path.lstat()
    except OSError as error:
        return [Finding(path, f"the {what} cannot be used: {error.strerror}")]
    if stat.S_ISLNK(info.st_mode):
        return [Finding(path, f"the {what} is a link, and what it leads to may change; put the {what} itself there")]
    if not (stat.S_ISDIR(info.st_mode) if folder else stat.S_ISREG(info.st_mode)):
        return [Finding(path, f"it is no {'folder' if folder else 'file'}")]
    if info.st_uid != os.geteuid():
        return [Finding(path, f"the {what} belongs to user {info.st_uid}, and this process is of user {os.geteuid()}")]
    if info.st_mode & 0o077:
        return [
            Finding(
                path, f"the {what} is open to others (mode {stat.S_IMODE(info.st_mode):04o}): chmod {mode:o} {path}"
            )
        ]
    return []


def _misfit(folder: Path) -> list[Finding]:
    import ssl  # which most processes do without

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_cert_chain(folder / CERTIFICATE, folder / KEY, password=_no_password)
    except (ssl.SSLError, OSError, ValueError) as error:
        mismatch = isinstance(error, ssl.SSLError) and error.reason == "KEY_VALUES_MISMATCH"
        why = "it is not the key of the certificate beside it" if mismatch else "key or certificate cannot be read"
        return [Finding(folder / KEY, f"{why}; `robo security renew` makes a certificate for it")]
    try:
        context.load_verify_locations(folder / CA)
    except (ssl.SSLError, OSError):
        return [Finding(folder / CA, "it holds no certificate")]
    return []


def _no_password() -> str:
    raise ValueError("the key is encrypted")  # else OpenSSL would ask on the terminal


def about_of(folder: Path) -> About:
    """What a name's folder says of it, without a look at its key.

    Raises:
        SecurityError: it cannot be read.
    """
    try:
        return _about(folder / ABOUT)
    except SecurityError as error:
        raise SecurityError(f"{folder / ABOUT}: {error}") from None


def _about(file: Path) -> About:
    try:
        return msgspec.json.decode(read_bytes(file), type=readable(About))
    except (UnreadableFile, msgspec.MsgspecError) as error:
        raise SecurityError(f"it cannot be read ({error}); `robo security renew` writes it") from None


def check_endpoints(endpoints: Sequence[str]) -> None:
    """Refuse endpoints that a secured process must not use.

    Raises:
        SecurityError: one is not encrypted, or changes what is checked.
    """
    for endpoint in endpoints:
        protocol, _, rest = endpoint.partition("/")
        if protocol not in PROTOCOLS:
            raise SecurityError(
                f"{endpoint} is in the clear, and security is on: write tls/{rest}, or leave --security out"
            )
        if "#" in rest:
            raise SecurityError(f"{endpoint}: with security on, an endpoint has no settings of its own (#…)")


def settings(identity: Identity, *, router: bool) -> dict[str, object]:
    """Zenoh's settings, by path, for a process that is somebody.

    Raises:
        SecurityError: rules are missing or cannot be read.
    """
    own = {name: str(identity.folder / file) for name, file in (("private_key", KEY), ("certificate", CERTIFICATE))}
    found: dict[str, object] = {
        "transport/link/protocols": PROTOCOLS,
        "transport/link/tls": {
            "root_ca_certificate": str(identity.folder / CA),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            **{f"connect_{name}": file for name, file in own.items()},
            **{f"listen_{name}": file for name, file in own.items()},
            # Only the side that is dialled cuts a link in time; on the other one a client gets in again.
            "close_link_on_expiration": router,
        },
    }
    if router:
        # What a router tells of its nodes, others would dial past it.
        found |= {"scouting/gossip/enabled": False, "access_control": _rules(identity.folder / RULES)}
    else:
        # A router is gone for some hundredths of a second when its certificate or its rules change.
        found["connect/retry"] = {"period_init_ms": 20, "period_max_ms": 500, "period_increase_factor": 1.3}
    return found


def named(identity: Identity) -> frozenset[str]:
    """The names that the rules of a router know.

    Raises:
        SecurityError: they are missing or cannot be read.
    """
    subjects = msgspec.convert(_rules(identity.folder / RULES), readable(_Named), strict=False).subjects
    return frozenset(name for subject in subjects for name in subject.cert_common_names)


class _Subject(msgspec.Struct):
    cert_common_names: list[str] = []


class _Named(msgspec.Struct):
    subjects: list[_Subject] = []


def _rules(file: Path) -> dict[str, object]:
    try:
        rules: dict[str, object] = msgspec.json.decode(read_bytes(file, MOST_OF_RULES), type=dict[str, object])
    except (UnreadableFile, msgspec.MsgspecError) as error:
        raise SecurityError(f"{file}: the rules cannot be read ({error}); `robo security renew` writes them") from None
    if not (rules.get("enabled") is True and rules.get("default_permission") == "deny"):
        raise SecurityError(f"{file}: these rules let in whom nobody named; `robo security renew` writes them")
    return rules
