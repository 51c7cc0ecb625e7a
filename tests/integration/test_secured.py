"""A secured robot through a change of its certificates, its rules and its people, and with keys that do not fit."""

import json
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import zenoh

from robo.security.keystore import Keystore
from robo.wire import codec
from robo.wire.network import Network, zenoh_config
from tests import plain
from tests.conftest import free_port
from tests.extras import needs_cryptography
from tests.secured import Site, everything_of
from tests.support import PATIENCE, Running, eventually

pytestmark = [needs_cryptography, pytest.mark.timeout(240)]

SECONDS = 1 / 86_400
"""Of days."""
MOST_LOST = 100
"""Messages of 50 a second, where the machine is busy; `python -m benchmarks.security` measures the outage: 0.5 s."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    made = Site(tmp_path_factory.mktemp("site"))
    try:
        yield made
    finally:
        made.close()


@pytest.fixture(autouse=True)
def told(site: Site) -> Iterator[None]:
    """What its router and its robot have said by then stands beside what fails."""
    yield
    print("router:", site.router.output, "robot:", site.robot.output, sep="\n")


class Heard:
    """Which messages of a topic have come: 50 a second are published, each with the next number."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.numbers: list[int] = []
        self._subscriber = session.declare_subscriber(key, self._note)

    def _note(self, sample: zenoh.Sample) -> None:
        stamp = codec.unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
        assert stamp is not None
        self.numbers.append(stamp.sequence_number)

    def wait(self, count: int) -> None:
        """Wait for so many more."""
        end = len(self.numbers) + count
        eventually(lambda: len(self.numbers) >= end, f"{count} more messages")

    @property
    def lost(self) -> int:
        """How many have not come of those between the first one and the last one; one may come twice, by two ways."""
        return max(self.numbers) - min(self.numbers) + 1 - len(set(self.numbers))


def openings(site: Site) -> int:
    """How often the site's router has been opened anew."""
    return site.router.output.count("changed: opened anew")


def inside(site: Site) -> zenoh.Session:
    """A session within the robot: a client of the router at which its nodes meet."""
    (place,) = [
        one.laddr for process in psutil.Process(site.robot.process.pid).children(recursive=True)
        for one in process.net_connections("unix") if str(one.laddr).endswith("/router.sock")
    ][:1]  # fmt: skip
    network = Network(mode="client", connect=(f"unixsock-stream/{place}",), timeout=PATIENCE)
    return site.keep_open(zenoh.open(zenoh_config(network)))


def test_renewal_of_the_routers_while_the_robot_drives(site: Site) -> None:
    owner, within = Heard(site.session("ann"), "r1/odom"), Heard(inside(site), "r1/odom")
    owner.wait(10)
    within.wait(10)
    site.store.renew(["site"], 30)
    site.router.wait_for("its certificate changed: opened anew")
    owner.wait(20)
    site.store.renew(["r1"], 30)
    site.robot.wait_for("its certificate changed: opened anew")
    owner.wait(20)
    within.wait(20)
    assert within.lost == 0, "the inside of the robot is not touched"
    assert owner.lost <= MOST_LOST


def test_revocation_while_others_listen(site: Site) -> None:
    before = openings(site)
    site.store.add("mia", "viewer", (), 30)
    eventually(lambda: openings(site) > before, "the rules with her name")
    site.keep("mia")  # what is revoked is deleted where it was made
    kept = site.session(site.kept("mia"))
    others = Heard(site.session("ann"), "r1/odom")
    hers = Heard(kept, "r1/odom")
    hers.wait(10)
    others.wait(10)
    before = openings(site)
    site.store.revoke("mia")
    eventually(lambda: openings(site) > before, "new rules")
    others.wait(50)
    assert others.lost <= MOST_LOST
    last = hers.numbers[-1]
    others.wait(50)
    assert hers.numbers[-1] == last, "nothing comes to who was revoked"
    site.router.wait_for("mia, who is not in the policy, is linked and may do nothing")


def test_expiry_while_others_listen(site: Site) -> None:
    before = openings(site)
    site.store.add("ina", "viewer", (), 10 * SECONDS)
    eventually(lambda: openings(site) > before, "the rules with her name")
    others = Heard(site.session("ann"), "r1/odom")
    hers = Heard(site.session("ina"), "r1/odom")
    hers.wait(5)
    site.router.wait_for("somebody who was linked until his certificate expired")
    others.wait(50)
    last = hers.numbers[-1]
    others.wait(50)
    assert others.lost <= MOST_LOST
    assert hers.numbers[-1] == last


def test_a_tool_is_told_why_it_is_not_let_in(site: Site) -> None:
    for name, why in {
        "late": "the certificate used here has expired",
        "mallory": "the router there is not of this network",
    }.items():
        code, said = site.run("ps", security=name)
        assert code == 1
        assert f"{name} is not let in" in said
        assert why in said
        assert "Traceback" not in said


def test_a_tool_is_told_what_was_refused(site: Site) -> None:
    code, said = site.run("stop", "safety_monitor", "--robot-name", "r1", security="eve")
    assert code == 1
    assert said.strip() == "error: refused: eve may not stop what runs of r1 (says router site)"
    heard = plain.hear(site.session("ann"), "r1/told")
    _, said = site.run("topic", "pub", "r1/told", "std/String", "data: x", "--once", security="eve")
    assert "refused: eve may not publish r1/told (says router site)" in said
    assert plain.so_far(heard) == []
    _, said = site.run("net", "--json", security="ann")
    counted = {one["sentence"]: one["count"] for told in json.loads(said)["refused"] for one in told["counts"]}
    assert counted["eve may not publish r1/told"] == 1
    assert counted["eve may not stop what runs of r1"] >= 1


def test_plain_endpoints_are_refused_by_a_secured_process(site: Site) -> None:
    code, said = site.run("ps", security="ann", endpoint="tcp/192.0.2.1:7447")
    assert (code, "tcp/192.0.2.1:7447 is in the clear, and security is on: write tls/" in said) == (1, True), said
    running = site.start("router", "--listen", "tcp/0.0.0.0:7447", security="site")
    assert running.wait() == 1
    assert "tcp/0.0.0.0:7447 is in the clear" in running.output


def test_who_holds_the_meeting_port_with_another_ca_gets_no_robot(site: Site) -> None:
    place = f"tls/127.0.0.1:{free_port()}"
    holder = site.start("router", "--listen", place, security="false")
    holder.wait_for("router at")
    eventually(lambda: is_listened_at(place), "it listens")
    robot = site.start("up", "simulation.yaml", "--robot-name", "r2", "--listen", place, security="r2")
    assert robot.wait() == 1
    assert f"the router at {place} is not joined: the router there is not of this network" in robot.output


def test_where_nobody_can_listen_nothing_is_started(site: Site) -> None:
    place = "tls/192.0.2.1:7447"
    for words, name in ((("router",), "site"), (("up", "simulation.yaml", "--robot-name", "r2"), "r2")):
        running = site.start(*words, "--listen", place, security=name)
        assert running.wait() == 1
        assert f"cannot listen at {place}, port 7447 on 192.0.2.1: " in running.output
        assert "site at" not in running.output
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        port = held.getsockname()[1]
        running = site.start("router", "--listen", f"tls/127.0.0.1:{port}", security="site")
        assert running.wait(PATIENCE) == 1
        assert f"port {port} on 127.0.0.1: Address already in use" in running.output


def is_listened_at(place: str) -> bool:
    from robo.wire import tcp

    return next(tcp.answering([place], 1.0), None) is not None


def secrets_of(folder: Path) -> list[str]:
    """What must be nowhere else: each line of each private key."""
    found = []
    for key in (*folder.rglob("key.pem"), *folder.rglob("ca.key"), *folder.rglob("*.key")):
        found += [line for line in key.read_text().splitlines() if not line.startswith("-----")]
    return found


def test_keys_never_leave_their_folder(site: Site, tmp_path: Path) -> None:
    secrets = secrets_of(site.folder)
    assert len(secrets) > 20
    owner = site.session("ann")
    said = [site.router.output, site.robot.output]
    said += [
        reply.ok.payload.to_bytes().decode(errors="replace")
        for reply in owner.get("@/**", timeout=3.0)
        if reply.ok is not None
    ]
    said.append(str(zenoh_config(Network(mode="router", listen=(site.endpoint,), security=str(site.name("site"))))))
    for parent in site.router.process.pid, site.robot.process.pid:
        family = [psutil.Process(parent), *psutil.Process(parent).children(recursive=True)]
        said += [everything_of(process.pid) for process in family]
    for file in (site.folder / "state").rglob("*"):
        if file.is_file():
            said.append(file.read_text(errors="replace"))
    # With a wrong key, which Zenoh itself would print.
    site.keep("ann")
    wrong = site.kept("ann")
    os.replace(wrong / "key.pem", tmp_path / "away")
    (wrong / "key.pem").write_bytes(site.name("r2").joinpath("key.pem").read_bytes())
    (wrong / "key.pem").chmod(0o600)
    for words in ("ps", "--connect", site.endpoint), ("router", "--listen", f"tls/127.0.0.1:{free_port()}"):
        running = site.start(*words, "--security", str(wrong))
        assert running.wait() == 1
        assert "it is not the key of the certificate beside it" in running.output
        said.append(running.output)
    for text in said:
        assert "PRIVATE KEY" not in text
        assert [secret for secret in secrets if secret in text] == []


def test_a_key_that_others_may_read_is_refused(tmp_path: Path) -> None:
    store = Keystore(tmp_path / "security")
    store.init("test")
    store.add("ann", "operator", (), 1)
    key = store.name_folder("ann") / "key.pem"
    key.chmod(0o640)
    running = Running(
        [sys.executable, "-m", "robo", "ps", "--security", str(key.parent)],
        env={**os.environ, "NO_COLOR": "1"},
    )
    assert running.wait() == 1
    assert f"the key is open to others (mode 0640): chmod 600 {key}" in running.output
    running.close()
