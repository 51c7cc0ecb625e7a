"""A keystore: what is written with which mode, what is refused, what goes to a machine, what is kept of the past."""

import builtins
import io
import os
import tarfile
import time
from pathlib import Path
from typing import Any

import pytest

from robo.errors import PolicyError, SecurityError
from robo.security import certificates
from robo.security.keystore import Keystore
from robo.wire import identity
from robo.wire.network import Network, settings_of, zenoh_config
from tests.extras import needs_cryptography

pytestmark = needs_cryptography


@pytest.fixture
def store(tmp_path: Path) -> Keystore:
    made = Keystore(tmp_path / "security")
    made.init("test")
    made.add("site", "router", ("site.example", "10.0.0.1"), 30)
    made.add("r1", "robot", (), 30)
    made.add("ann", "operator", (), 30)
    return made


def test_all_is_its_owner_s_alone(store: Keystore) -> None:
    for path in [store.folder, *store.folder.rglob("*")]:
        mode = path.stat().st_mode & 0o777
        assert mode == (0o700 if path.is_dir() else 0o600), path


def test_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        made = Keystore(tmp_path / "security")
        made.init("test")
        made.add("ann", "operator", (), 1)
    finally:
        os.umask(before)
    assert identity.faults(made.name_folder("ann")) == []


def test_certificates_say_name_hosts_and_time(store: Keystore) -> None:
    facts = certificates.facts((store.name_folder("site") / "cert.pem").read_bytes())
    assert facts.name == "site"
    assert set(facts.hosts) == {"site.example", "10.0.0.1", "localhost", "127.0.0.1", "::1"}
    assert 29 < (facts.not_after - time.time()) / 86_400 <= 30
    assert certificates.facts((store.name_folder("ann") / "cert.pem").read_bytes()).hosts == ()
    ca = (store.folder / "ca.pem").read_bytes()
    assert certificates.is_signed_by((store.name_folder("ann") / "cert.pem").read_bytes(), ca)
    assert not certificates.is_signed_by(certificates.make_ca("other").certificate, ca)


def test_renewal_keeps_the_key_and_the_hosts(store: Keystore) -> None:
    folder = store.name_folder("site")
    key, before = (folder / "key.pem").read_bytes(), identity.load(folder).about
    (after,) = store.renew(["site"], 60)
    assert (folder / "key.pem").read_bytes() == key
    assert (after.serial != before.serial, set(after.hosts)) == (True, set(before.hosts))
    assert identity.faults(folder) == []
    assert [one.serial for one in store.issued() if one.name == "site"] == [before.serial, after.serial]


def test_renewal_without_a_change_wakes_no_router(store: Keystore) -> None:
    rules = store.name_folder("site") / "access.json"
    before = rules.stat().st_mtime_ns
    store.renew(["ann"], 30)
    assert rules.stat().st_mtime_ns == before


def test_who_is_revoked_is_in_no_rules_and_stays_known(store: Keystore) -> None:
    serial = identity.load(store.name_folder("ann")).about.serial
    assert store.revoke("ann") == 1
    assert "ann" not in store.policy().names
    assert "ann" not in identity.named(identity.load(store.name_folder("site")))
    assert not store.name_folder("ann").exists()
    assert [one.serial for one in store.issued() if one.did == "revoked"] == [serial]


def test_what_goes_to_a_machine_is_its_own_and_no_more(store: Keystore, tmp_path: Path) -> None:
    with tarfile.open(fileobj=io.BytesIO(store.bundle("r1"))) as tar:
        files = {member.name: member for member in tar.getmembers()}
        assert sorted(files) == [
            "r1", "r1/about.json", "r1/access.json", "r1/ca.pem", "r1/cert.pem", "r1/key.pem",
        ]  # fmt: skip
        assert {member.mode for name, member in files.items() if name != "r1"} == {0o600}
        tar.extractall(tmp_path / "there", filter="data")
        packed = b"".join(tar.extractfile(one).read() for one in tar.getmembers() if one.isfile())  # type: ignore[union-attr]
    (tmp_path / "there" / "r1").chmod(0o700)
    assert identity.load(tmp_path / "there" / "r1").about.name == "r1"
    for secret in store.ca_key, store.name_folder("ann") / "key.pem":
        assert secret.read_bytes().splitlines()[1] not in packed


def test_rules_that_a_hand_has_made_old_are_seen(store: Keystore) -> None:
    assert store.stale_rules(store.policy()) == []
    text = store.policy_file.read_text().replace("ann:\n    role: operator", "ann:\n    role: viewer")
    store.policy_file.write_text(text)
    assert store.stale_rules(store.policy()) == ["r1", "site"]
    assert [one.trouble for one in store.listed() if one.name == "ann"] == [
        "the policy calls it a viewer; `robo security renew ann` makes it one"
    ]
    store.renew(["ann"], 30)
    assert store.stale_rules(store.policy()) == []


def test_what_is_there_already_is_not_made_again(store: Keystore) -> None:
    with pytest.raises(SecurityError, match="is a keystore already"):
        store.init("test")
    with pytest.raises(SecurityError, match="ann is there already"):
        store.add("ann", "viewer", (), 1)
    with pytest.raises(PolicyError, match="the policy has no name 'nobody'"):
        store.revoke("nobody")
    with pytest.raises(SecurityError, match="nobody dials a viewer"):
        store.add("eve", "viewer", ("host",), 1)
    assert not store.name_folder("eve").exists()


def test_the_key_of_the_ca_may_live_elsewhere(store: Keystore, tmp_path: Path) -> None:
    (tmp_path / "stick").mkdir(mode=0o700)
    os.replace(store.ca_key, tmp_path / "stick" / "ca.key")
    with pytest.raises(SecurityError, match="--ca-key FILE says where it is kept"):
        store.renew(["ann"], 1)
    Keystore(store.folder, tmp_path / "stick" / "ca.key").renew(["ann"], 1)
    assert Keystore(store.folder).revoke("ann") == 2, "to revoke takes no key"


# -- what is refused ---------------------------------------------------------------------------------------------------


def link(path: Path) -> None:
    os.replace(path, path.with_name("elsewhere"))
    path.symlink_to("elsewhere")


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (lambda folder: (folder / "key.pem").chmod(0o640), "the key is open to others (mode 0640): chmod 600"),
        (lambda folder: folder.chmod(0o755), "the folder is open to others (mode 0755): chmod 700"),
        (lambda folder: link(folder / "key.pem"), "the key is a link"),
        (lambda folder: (folder / "key.pem").unlink(), "the key cannot be used"),
        (lambda folder: (folder / "cert.pem").unlink(), "it is missing"),
        (lambda folder: (folder / "access.json").unlink(), "the rules of this router are missing"),
        (lambda folder: (folder / "ca.pem").write_text("x"), "it holds no certificate"),
        (
            lambda folder: (folder / "key.pem").write_bytes(certificates.make_key()),
            "it is not the key of the certificate",
        ),
        (lambda folder: (folder / "key.pem").write_text("secret"), "key or certificate cannot be read"),
        (lambda folder: (folder / "about.json").write_text("{}"), "it cannot be read"),
    ],
)
def test_a_folder_with_a_fault_is_nobody(store: Keystore, spoil: Any, fault: str) -> None:
    folder = store.name_folder("site")
    spoil(folder)
    with pytest.raises(SecurityError) as raised:
        settings_of(Network(mode="router", listen=("tls/127.0.0.1:7447",), security=str(folder)))
    assert fault in str(raised.value)
    assert "secret" not in str(raised.value).replace(str(folder), "")
    assert "PRIVATE" not in str(raised.value)


def test_the_key_of_another_user(store: Keystore, monkeypatch: pytest.MonkeyPatch) -> None:
    other = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: other)
    assert "belongs to user" in identity.faults(store.name_folder("ann"))[0].text


@pytest.mark.parametrize("rules", ["{}", '{"enabled": false, "default_permission": "deny"}', "x", "[]",
                                   '{"enabled": true, "default_permission": "allow"}'])  # fmt: skip
def test_rules_that_let_everybody_in_are_none(store: Keystore, rules: str) -> None:
    (store.name_folder("site") / "access.json").write_text(rules)
    with pytest.raises(SecurityError, match="robo security renew"):
        settings_of(Network(mode="router", security=str(store.name_folder("site"))))


def test_settings_of_a_secured_process(store: Keystore) -> None:
    folder = str(store.name_folder("site"))
    more: dict[str, object] = {"transport": {"link": {"protocols": ["tcp"]}}, "access_control": {"enabled": False}}
    for mode in ("router", "client"):
        network = Network(mode=mode, connect=("tls/site:7447",), security=folder, more=more if mode == "router" else {})
        found = settings_of(network)
        assert found["transport/link/protocols"] == ("tls", "unixsock-stream")
        assert found["transport/link/tls"]["enable_mtls"] is True  # type: ignore[index]
        zenoh_config(network)
    router: Any = settings_of(Network(mode="router", security=folder, more=more))
    assert router["scouting/gossip/enabled"] is False
    assert (router["access_control"]["enabled"], router["access_control"]["default_permission"]) == (True, "deny")


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:7447", "udp/a:1", "quic/a:1", "ws/a:1", "tls/a:1#verify_name=x"])
def test_endpoints_that_are_not_secured(store: Keystore, endpoint: str) -> None:
    with pytest.raises(SecurityError, match="security"):
        zenoh_config(Network(mode="client", connect=(endpoint,), security=str(store.name_folder("ann"))))


def test_which_folder_is_meant(store: Keystore, tmp_path: Path) -> None:
    own = store.name_folder("r1")
    assert identity.folder_of(str(own)) == own
    assert identity.folder_of(str(store.folder), "r1") == own
    with pytest.raises(SecurityError, match="it has no name r9; say --security"):
        identity.folder_of(str(store.folder), "r9")
    with pytest.raises(SecurityError, match="several names"):
        identity.folder_of(str(store.folder))
    with pytest.raises(SecurityError, match="it is not there"):
        identity.folder_of(str(tmp_path / "nowhere"))


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *words: Any, **more: Any) -> Any:
        if name.startswith("cryptography"):
            raise ImportError(name)
        return real(name, *words, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(SecurityError, match=r"pip install 'robo-zenoh\[security\]'"):
        Keystore(tmp_path / "security").init("test")
    assert not (tmp_path / "security").exists()
