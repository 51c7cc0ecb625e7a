"""`robo security`: a keystore made, changed, looked at and told of."""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo.cli.json_text import document
from robo.cli.printing import amount, note, paint, print_line, print_table, print_text
from robo.errors import SecurityError, UnreadableFile, UsageError
from robo.security import certificates, policy, verdicts
from robo.security.keystore import SOON, Keystore
from robo.security.rights import RIGHTS, Right, Role
from robo.text import colours
from robo.text.files import read_bytes
from robo.wire import identity, tls
from robo.wire.names import key_of

_APPLIES = "routers that use this keystore take it over within a second; others need a new bundle"


def make(folder: Path, ca_key: Path | None, name: str) -> None:
    """Make a keystore.

    Raises:
        SecurityError: there is one already, or it cannot be written.
    """
    store = Keystore(folder, ca_key)
    store.init(name)
    print_line(f"{folder} is a keystore: the CA {name}, and a policy in {store.policy_file}")
    print_line(f"  who has {store.ca_key} makes names at will: keep it here, or offline")
    print_line("  next: robo security add site --as router --host ADDRESS, and add r1 --as robot")


def add(folder: Path, ca_key: Path | None, name: str, role: Role, hosts: Sequence[str], days: float) -> None:
    """Give a name a key and a certificate.

    Raises:
        SecurityError: it has them already, or something cannot be written.
    """
    store = Keystore(folder, ca_key)
    about = store.add(name, role, hosts, days)
    print_line(f"{name} is {_article(role)}, until {_day(about.not_after)}: {store.name_folder(name)}")
    print_line(f"  here: --security {store.name_folder(name)}; elsewhere: robo security bundle {name} -o {name}.tar")


def renew(folder: Path, ca_key: Path | None, names: Sequence[str], hosts: Sequence[str], days: float) -> None:
    """Make certificates anew.

    Raises:
        SecurityError: there is no such name, or something cannot be written.
        UsageError: hosts are said of several names.
    """
    store = Keystore(folder, ca_key)
    if hosts and len(names) != 1:
        raise UsageError("--host goes with one name")
    due = names or [one.name for one in store.listed() if one.days_left < days / 2 and one.name in store.policy().names]
    found = store.renew(due, days, hosts)
    for about in found:
        print_line(f"{about.name} is valid until {_day(about.not_after)}")
    note(f"{amount(len(found), 'certificate')} made; {_APPLIES}")


def revoke(folder: Path, name: str) -> None:
    """Take a name out of the policy.

    Raises:
        SecurityError: there is no such name.
    """
    count = Keystore(folder).revoke(name)
    print_line(f"{name} is out of the policy; {amount(count, 'certificate')} of it revoked")
    note(_APPLIES)


def change(folder: Path, whom: str, right: Right | None, key: str | None, *, allow: bool) -> None:
    """Allow or deny something.

    Raises:
        UsageError: right or key are missing.
        SecurityError: there is no such role or name, or the key is none.
    """
    if right is None or key is None:
        raise UsageError(f"say a right and a key, for example {whom} publish r1/cmd_vel; rights: {', '.join(RIGHTS)}")
    key = _key(right, key)
    Keystore(folder).change(whom, right, key, allow=allow)
    print_line(f"{whom} {'may' if allow else 'may not'} {right} {key}")
    note(_APPLIES)


def narrow(folder: Path, name: str, manifest: str, right: Right | None) -> None:
    """Let a robot do what the contracts of a manifest say.

    Raises:
        UsageError: a right is said as well, or there is no such manifest.
        ManifestFaults: the manifest has mistakes.
        SecurityError: there is no such robot.
    """
    from robo.cli.launch.words import manifest_file
    from robo.launch import resolve
    from robo.launch.faults import ManifestFaults
    from robo.launch.outside import rights_of

    if right is not None:
        raise UsageError("--from says all rights; leave the right out")
    found = resolve.resolve(manifest_file(manifest), {}, robot=name, stand_ins=True)
    if found.problems:
        raise ManifestFaults(found.problems)
    rights, silent = rights_of(found)
    Keystore(folder).narrow(name, {one: rights[one] for one in RIGHTS if one in rights})
    said = ", ".join(f"{one} {amount(len(keys), 'key')}" for one, keys in rights.items())
    print_line(f"{name} may do to the outside what {manifest} declares: {said}")
    if silent:
        note(f"not known what these do, allow it by hand: {', '.join(silent)}")
    note(_APPLIES)


def print_names(folder: Path, *, json: bool) -> int:
    """Print all names.

    Returns:
        1 where something is wrong with one.

    Raises:
        SecurityError: there is no keystore.
    """
    found = Keystore(folder).listed()
    if json:
        print_text(document([{**one._asdict(), "days_left": round(one.days_left, 2)} for one in found]))
    elif not found:
        print_line("no names so far; `robo security add NAME --as ROLE` makes one")
    else:
        head = ("NAME", "ROLE", "DAYS LEFT", "DIALLED AS", "")
        rows = [
            (one.name, one.role, f"{max(one.days_left, 0):.0f}", ", ".join(one.hosts) or "-", _trouble(one.trouble))
            for one in found
        ]
        print_table([head, *rows])
    return 1 if any(one.trouble for one in found) else 0


def print_verdict(folder: Path, name: str, right: Right, key: str, *, json: bool) -> int:
    """Print whether a name may do something, and why.

    Returns:
        0 where it may, 1 where it may not.

    Raises:
        SecurityError: there is no such name, or the key is none.
    """
    key = _key(right, key)
    if fault := policy.fault_of_key(right, key):
        raise UsageError(fault)
    verdict = verdicts.explain(Keystore(folder).policy(), name, right, key)
    if json:
        print_text(document(msgspec.structs.asdict(verdict)))
    else:
        word = paint("yes", colours.GREEN) if verdict.allowed else paint("no", colours.RED)
        print_line(f"{word}: {verdict.reason}{f' ({verdict.place})' if verdict.place else ''}")
    return 0 if verdict.allowed else 1


def pack(folder: Path, name: str, out: str) -> None:
    """Write what goes to one machine.

    Raises:
        SecurityError: there is no such name, or the file cannot be written.
    """
    data = Keystore(folder).bundle(name)
    if out == "-":
        sys.stdout.buffer.write(data)
        sys.stdout.flush()
        return
    try:
        descriptor = os.open(out, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            os.fchmod(descriptor, 0o600)
            file.write(data)
    except OSError as error:
        raise SecurityError(f"{out} cannot be written: {error.strerror}") from None
    print_line(f"{out}: on its machine `tar -xf {Path(out).name}`, then --security {name}; it holds the key of {name}")


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """Something that was looked at."""

    fine: bool
    what: str
    text: str


def examine(folder: Path, connect: Sequence[str], *, json: bool) -> int:
    """Check a keystore, or the folder of one name, and a link.

    Returns:
        1 where something has to be mended.

    Raises:
        SecurityError: there is no such folder.
    """
    found = [*_examined(folder)]
    for endpoint in connect:
        found.append(_link(folder, endpoint))
    if json:
        print_text(document(found))
    else:
        for one in found:
            print_line(
                f"{paint('ok', colours.GREEN) if one.fine else paint('!!', colours.RED)}  {one.what}: {one.text}"
            )
    return 0 if all(one.fine for one in found) else 1


def _examined(folder: Path) -> "list[Finding]":
    if (folder / identity.CERTIFICATE).exists() or (folder / identity.KEY).exists():
        return _of_name(folder, Keystore(folder.absolute().parent.parent))
    store = Keystore(folder)
    known = store.policy()
    found = [Finding(fine=True, what=str(store.policy_file), text=f"{amount(len(known.names), 'name')}")]
    if store.ca_key.exists():
        wide = [*identity.too_open(store.ca_key.parent, folder=True), *identity.too_open(store.ca_key, folder=False)]
        found += [Finding(fine=False, what=str(one.file), text=one.text) for one in wide]
    for one in store.listed():
        if one.trouble:
            found.append(Finding(fine=False, what=one.name, text=one.trouble))
        else:
            found += _of_name(store.name_folder(one.name), store)
    for name in store.stale_rules(known):
        text = "its rules are not those of the policy; `robo security renew` writes them anew"
        found.append(Finding(fine=False, what=name, text=text))
    return found


def _of_name(folder: Path, store: Keystore) -> list[Finding]:
    wrong = identity.faults(folder)
    if wrong:
        return [Finding(fine=False, what=str(one.file), text=one.text) for one in wrong]
    about = identity.load(folder).about
    left = (about.not_after - time.time()) / 86_400
    if left <= 0:
        return [Finding(fine=False, what=about.name, text=f"expired on {_day(about.not_after)}; `robo security renew`")]
    found = [
        Finding(
            fine=left >= SOON, what=about.name, text=f"{_article(about.role)}, valid until {_day(about.not_after)}"
        ),
    ]
    try:
        certificate, ca = read_bytes(folder / identity.CERTIFICATE), read_bytes(folder / identity.CA)
        facts = certificates.facts(certificate)
    except (SecurityError, UnreadableFile) as error:
        return [*found, Finding(fine=False, what=about.name, text=str(error))]
    if facts.name != about.name:
        found.append(Finding(fine=False, what=about.name, text=f"its certificate is that of {facts.name}"))
    if not certificates.is_signed_by(certificate, ca):
        found.append(Finding(fine=False, what=about.name, text="its certificate is not signed by the CA beside it"))
    gone = {one.serial for one in store.issued() if one.did == "revoked"}
    if facts.serial in gone:
        found.append(Finding(fine=False, what=about.name, text="its certificate is revoked"))
    return found


def _link(folder: Path, endpoint: str) -> Finding:
    try:
        own = identity.load(identity.folder_of(str(folder))).folder
        identity.check_endpoints([endpoint])
        wrong = tls.refusal(endpoint, own, 3.0)
    except SecurityError as error:
        return Finding(fine=False, what=endpoint, text=str(error))
    except OSError as error:
        from robo.wire import tcp

        return Finding(fine=False, what=endpoint, text=tcp.reason(error))
    return Finding(fine=wrong is None, what=endpoint, text=wrong or f"{own.name} is let in")


def _article(role: str) -> str:
    return f"{'an' if role[0] in 'aeiou' else 'a'} {role}"


def _key(right: Right, key: str) -> str:
    return key.lstrip("/") if right in ("list", "command") else key_of(key).lstrip("/")


def _trouble(text: str) -> str:
    return paint(text, colours.YELLOW) if text else ""


def _day(seconds: int) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(seconds))
