"""The keystore: a CA, the policy, and a folder for each name with its key, its certificate and the rules of its router.

    ca.pem  private/ca.key  policy.yaml  issued.jsonl  names/NAME/{ca.pem, cert.pem, key.pem, about.json, access.json}

Keys are written with mode 0600 in folders of mode 0700, whole or not at all, and never twice.
"""

import io
import os
import shutil
import tarfile
import time
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from robo.errors import PolicyError, SecurityError, UnreadableFile
from robo.security import certificates, policy, rules
from robo.security.certificates import Pair
from robo.security.policy import Entry, Policy, Rights
from robo.security.rights import Right, Role
from robo.text.files import read_bytes, read_text
from robo.text.readable import readable
from robo.wire import identity
from robo.wire.identity import ABOUT, CA, CERTIFICATE, KEY, NAMES, RULES, About

POLICY = "policy.yaml"
ISSUED = "issued.jsonl"
PRIVATE = "private"
CA_KEY = "ca.key"
HERE = ("localhost", "127.0.0.1", "::1")
"""By what a router is dialled on its own machine."""
SOON = 7
"""With fewer days left a certificate is worth a warning."""
_DAY = 86_400


class Issued(msgspec.Struct, frozen=True, kw_only=True):
    """A line of what the CA has done."""

    did: Literal["issued", "revoked"]
    time: int
    """s since the epoch."""
    name: str
    role: str
    serial: str
    not_after: int


class Listed(NamedTuple):
    """A name as a keystore has it."""

    name: str
    role: str
    serial: str
    not_after: int
    hosts: tuple[str, ...]
    days_left: float
    trouble: str
    """What is wrong with it; empty where nothing is."""


class Keystore:
    """A keystore on this machine."""

    def __init__(self, folder: Path, ca_key: Path | None = None) -> None:
        """
        Args:
            folder: where it is.
            ca_key: the CA's key, where that is kept elsewhere.
        """
        self.folder = folder.absolute()
        self.ca_key = ca_key if ca_key is not None else self.folder / PRIVATE / CA_KEY

    # -- what is there -----------------------------------------------------------------------------

    @property
    def policy_file(self) -> Path:
        """The policy."""
        return self.folder / POLICY

    def name_folder(self, name: str) -> Path:
        """The folder of a name."""
        return self.folder / NAMES / name

    def policy(self) -> Policy:
        """The policy.

        Raises:
            SecurityError: there is no keystore.
            PolicyError: the policy has mistakes.
        """
        try:
            text = read_text(self.policy_file)
        except UnreadableFile as error:
            if error.missing:
                raise SecurityError(f"{self.folder} is no keystore; `robo security init` makes one") from None
            raise SecurityError(f"{self.policy_file} cannot be read: {error}") from None
        return policy.read(text, self.policy_file)

    def listed(self) -> list[Listed]:
        """All names of the policy and all that have a folder, by name.

        Raises:
            SecurityError: there is no keystore, or its policy has mistakes.
        """
        known = self.policy()
        folders = {path.name for path in (self.folder / NAMES).iterdir()} if (self.folder / NAMES).is_dir() else set()
        return [self._listed(name, known) for name in sorted({*known.names, *folders})]

    def _listed(self, name: str, known: Policy) -> Listed:
        entry = known.names.get(name)
        try:
            about = identity.load(self.name_folder(name)).about
        except SecurityError as error:
            role = entry.role if entry is not None else "-"
            return Listed(name, role, "", 0, (), 0.0, str(error).partition("\n")[0])
        left = (about.not_after - time.time()) / _DAY
        trouble = ""
        if entry is None:
            trouble = "it is not in the policy: nobody lets it in"
        elif entry.role != about.role:
            trouble = f"the policy calls it a {entry.role}; `robo security renew {name}` makes it one"
        elif left <= 0:
            trouble = f"its certificate has expired; `robo security renew {name}`"
        elif left < SOON:
            trouble = f"its certificate expires in {left:.1f} days; `robo security renew {name}`"
        return Listed(name, about.role, about.serial, about.not_after, about.hosts, left, trouble)

    # -- what changes ------------------------------------------------------------------------------

    def init(self, name: str) -> None:
        """Make it.

        Raises:
            SecurityError: there is one already, or it cannot be written.
        """
        if self.policy_file.exists() or (self.folder / CA).exists():
            raise SecurityError(f"{self.folder} is a keystore already; nothing was changed")
        ca = certificates.make_ca(name)
        _make_private(self.folder)
        _make_private(self.ca_key.parent)
        _make_private(self.folder / NAMES)
        _write(self.ca_key, ca.key, new=True)
        _write(self.folder / CA, ca.certificate)
        _write(self.policy_file, policy.text_of(Policy(roles=policy.DEFAULT_ROLES)).encode())
        _write(self.folder / ".gitignore", f"{PRIVATE}/\n{NAMES}/*/{KEY}\n*.tar\n".encode())

    def add(self, name: str, role: Role, hosts: Sequence[str], days: float) -> About:
        """Give a name a key and a certificate, and a place in the policy.

        Raises:
            SecurityError: it has them, or something cannot be written.
        """
        name = policy.checked_name(name)
        known = self.policy()
        if name in known.names or self.name_folder(name).exists():
            raise SecurityError(f"{name} is there already; `robo security renew {name}` renews its certificate")
        if hosts and role not in ("router", "robot"):
            raise SecurityError(f"--host goes with a router or a robot: nobody dials a {role}")
        ca = self._ca()
        folder = self.name_folder(name)
        _make_private(folder)
        try:
            key = certificates.make_key()
            _write(folder / KEY, key, new=True)
            about = self._issue(ca, key, name, role, hosts, days)
            self._write_policy(msgspec.structs.replace(known, names={**known.names, name: Entry(role=role)}))
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return about

    def renew(self, names: Collection[str], days: float, hosts: Sequence[str] = ()) -> list[About]:
        """Give names certificates anew, for the keys that they have, and write all rules anew.

        Raises:
            SecurityError: there is no such name, or something cannot be written.
        """
        known = self.policy()
        for name in names:
            policy.entry_of(known, name)
        ca = self._ca()
        found = []
        for name in names:
            key = self._key(name)
            role = known.names[name].role
            found.append(self._issue(ca, key, name, role, hosts or self._hosts_before(name), days))
        self.write_rules(known)
        return found

    def revoke(self, name: str) -> int:
        """Take a name out of the policy; its certificate is known as revoked, and its key is deleted here.

        Returns:
            How many certificates of it are revoked.

        Raises:
            SecurityError: there is no such name.
        """
        known = self.policy()
        entry = policy.entry_of(known, name)
        left = {one: known.names[one] for one in known.names if one != name}
        self._write_policy(msgspec.structs.replace(known, names=left))
        now = int(time.time())
        serials = {one.serial: one for one in self.issued() if one.name == name and one.did == "issued"}
        gone = {one.serial for one in self.issued() if one.did == "revoked"}
        for serial in serials.keys() - gone:
            self._note(Issued(did="revoked", time=now, name=name, role=entry.role, serial=serial,
                              not_after=serials[serial].not_after))  # fmt: skip
        shutil.rmtree(self.name_folder(name), ignore_errors=True)
        return len(serials.keys() - gone)

    def change(self, whom: str, right: Right, key: str, *, allow: bool) -> Policy:
        """Allow a role or a name something, or deny it.

        Raises:
            SecurityError: there is no such role or name, or the key is none.
        """
        after = policy.changed(self.policy(), whom, right, key, allow=allow)
        self._write_policy(after)
        return after

    def narrow(self, name: str, only: Rights) -> None:
        """Let a robot do nothing but what is said, in place of what its role may.

        Raises:
            SecurityError: there is no such name, or it is no robot.
        """
        known = self.policy()
        entry = policy.entry_of(known, name)
        if entry.role != "robot":
            raise PolicyError(f"{name} is a {entry.role}; the contracts of a manifest are about a robot")
        entry = Entry(role=entry.role, more=entry.more, only=only)
        self._write_policy(msgspec.structs.replace(known, names={**known.names, name: entry}))

    def write_rules(self, known: Policy) -> None:
        """Write the rules of every router and robot anew."""
        for name, entry in known.names.items():
            if entry.role in ("router", "robot") and self.name_folder(name).is_dir():
                _write(self.name_folder(name) / RULES, self._rules(known, name))

    def stale_rules(self, known: Policy) -> list[str]:
        """The names whose rules are not those of the policy, as where that was edited by hand."""
        found = []
        for name, entry in known.names.items():
            if entry.role in ("router", "robot"):
                with suppress(UnreadableFile):
                    if read_bytes(self.name_folder(name) / RULES, identity.MOST_OF_RULES) == self._rules(known, name):
                        continue
                found.append(name)
        return found

    def bundle(self, name: str) -> bytes:
        """What goes to the machine of a name, as a tar file: its folder, and nothing of others.

        Raises:
            SecurityError: there is no such name, or something is wrong with its folder.
        """
        policy.entry_of(self.policy(), name)
        folder = self.name_folder(name)
        identity.load(folder)
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w") as tar:
            top = tarfile.TarInfo(name)
            top.type, top.mode = tarfile.DIRTYPE, 0o700
            tar.addfile(top)
            for file in (CA, CERTIFICATE, KEY, ABOUT, RULES):
                if (folder / file).exists():
                    data = read_bytes(folder / file, identity.MOST_OF_RULES)
                    info = tarfile.TarInfo(f"{name}/{file}")
                    info.size, info.mode = len(data), 0o600
                    info.mtime = int((folder / file).stat().st_mtime)
                    tar.addfile(info, io.BytesIO(data))
        return packed.getvalue()

    def issued(self) -> list[Issued]:
        """What the CA has signed and revoked."""
        try:
            lines = read_bytes(self.folder / ISSUED, identity.MOST_OF_RULES).splitlines()
        except UnreadableFile:
            return []
        found = []
        for line in lines:
            with suppress(msgspec.MsgspecError):
                found.append(msgspec.json.decode(line, type=readable(Issued)))
        return found

    # -- its files ---------------------------------------------------------------------------------

    def _ca(self) -> Pair:
        for fault in identity.too_open(self.ca_key.parent, folder=True), identity.too_open(self.ca_key, folder=False):
            for finding in fault:
                hint = "" if finding.file.exists() else "; --ca-key FILE says where it is kept"
                raise SecurityError(f"{finding.file}: {finding.text}{hint}")
        try:
            return Pair(read_bytes(self.ca_key), read_bytes(self.folder / CA))
        except UnreadableFile as error:
            raise SecurityError(f"the CA of {self.folder} cannot be read: {error}") from None

    def _key(self, name: str) -> bytes:
        folder = self.name_folder(name)
        _make_private(folder)
        if not (folder / KEY).exists():
            _write(folder / KEY, certificates.make_key(), new=True)
        for finding in identity.too_open(folder / KEY, folder=False):
            raise SecurityError(f"{finding.file}: {finding.text}")
        return read_bytes(folder / KEY)

    def _hosts_before(self, name: str) -> tuple[str, ...]:
        try:
            said = certificates.facts(read_bytes(self.name_folder(name) / CERTIFICATE)).hosts
        except (UnreadableFile, SecurityError):
            return ()
        return tuple(host for host in said if host not in HERE)

    def _issue(self, ca: Pair, key: bytes, name: str, role: Role, hosts: Sequence[str], days: float) -> About:
        serves = role in ("router", "robot")
        said = tuple(dict.fromkeys((*hosts, *HERE))) if serves else ()
        certificate = certificates.issue(ca, key, name, said, days=days, serves=serves)
        facts = certificates.facts(certificate)
        folder = self.name_folder(name)
        about = About(name=name, role=role, not_after=facts.not_after, serial=facts.serial, hosts=facts.hosts)
        _write(folder / CA, ca.certificate)
        _write(folder / ABOUT, msgspec.json.encode(about))
        _write(folder / CERTIFICATE, certificate)
        self._note(Issued(did="issued", time=int(time.time()), name=name, role=role, serial=facts.serial,
                          not_after=facts.not_after))  # fmt: skip
        return about

    def _note(self, line: Issued) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(self.folder / ISSUED, flags, 0o600), "ab") as file:
            file.write(msgspec.json.encode(line) + b"\n")

    def _write_policy(self, after: Policy) -> None:
        _write(self.policy_file, policy.text_of(after).encode())
        self.write_rules(after)

    def _rules(self, known: Policy, name: str) -> bytes:
        made = rules.access_control(known, robot=name if known.names[name].role == "robot" else "")
        return msgspec.json.format(msgspec.json.encode(made), indent=1)


def _make_private(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise SecurityError(f"{folder} cannot be made: {error.strerror}") from None
    for finding in identity.too_open(folder, folder=True):
        raise SecurityError(f"{finding.file}: {finding.text}")


def _write(path: Path, data: bytes, *, new: bool = False) -> None:
    """Write a file whole or not at all, so that nobody reads half of it; open to its owner alone.

    Raises:
        SecurityError: it cannot be written, or must not be there and is.
    """
    if not new and _holds(path, data):
        return  # who looks whether it has changed is not told that it has
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        if new and path.exists():
            raise FileExistsError(17, "it is there already")
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(descriptor)
        beside.replace(path)
    except OSError as error:
        with suppress(OSError):
            beside.unlink()
        raise SecurityError(f"{path} cannot be written: {error.strerror}") from None


def _holds(path: Path, data: bytes) -> bool:
    try:
        return not identity.too_open(path, folder=False) and read_bytes(path, identity.MOST_OF_RULES) == data
    except UnreadableFile:
        return False
