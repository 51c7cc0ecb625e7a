"""What intruders try on a network: with security on each is refused, the owner is told, and the robot drives on.

With security off the same attempts show what is open by choice. What is protected, and what is not, is in
`docs/security.md`.
"""

import json
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import psutil
import pytest
import zenoh

from robo.wire.keys import NodeToken, control_key, parse_token
from tests import plain
from tests.conftest import free_port
from tests.extras import needs_cryptography
from tests.secured import Site, no_other_user, plain_config
from tests.support import eventually

pytestmark = [needs_cryptography, pytest.mark.timeout(300)]

QUIET = 0.6
"""How long nothing comes of what is refused, s: what is allowed takes some ms."""


class Watch:
    """The robot, as its owner sees it."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.owner = site.session("ann")
        self.odom = plain.hear(self.owner, "r1/odom")
        self.commands = plain.hear(self.owner, "r1/intruded")
        self.map_gone = plain.hear(self.owner, "r1/map")

    def drives(self) -> None:
        """See that the robot still tells where it is, all of its nodes run, and the site runs."""
        plain.so_far(self.odom)
        plain.samples(self.odom, 5)
        assert self.site.robot.process.poll() is None
        assert self.site.router.process.poll() is None

    def told(self, sentence: str) -> None:
        self.site.router.wait_for(f"security: {sentence}")


class Attempt(NamedTuple):
    """Something that an intruder tries."""

    number: str
    about: str
    tries: Callable[[Watch], bool]
    """Tries it; tells whether it has succeeded."""
    told: str = ""
    """What the owner of the router is told."""


ATTEMPTS: list[Attempt] = []


def attempt(number: str, about: str, told: str = "") -> Callable[[Callable[[Watch], bool]], Callable[[Watch], bool]]:
    def register(tries: Callable[[Watch], bool]) -> Callable[[Watch], bool]:
        ATTEMPTS.append(Attempt(number, about, tries, told))
        return tries

    return register


def gets_in(watch: Watch, name: str, **settings: object) -> bool:
    try:
        watch.site.intruder(name, **settings)
    except zenoh.ZError:
        return False
    return True


def comes(heard: Any) -> bool:
    """Whether anything comes to a subscriber."""
    end = time.monotonic() + QUIET
    while time.monotonic() < end:
        if heard.try_recv() is not None:
            return True
        time.sleep(0.01)
    return False


def answers(session: zenoh.Session, key: str, **asked: Any) -> list[zenoh.Reply]:
    return [reply for reply in session.get(key, timeout=2.0, **asked) if reply.ok is not None]


@attempt("1", "no certificate", "somebody without a certificate was refused")
def no_certificate(watch: Watch) -> bool:
    tls = {"root_ca_certificate": str(watch.site.store.folder / "ca.pem")} if watch.site.secured else {}
    return gets_in(watch, "", transport__link__tls=tls)


@attempt("2", "a certificate of another CA", "somebody whose certificate is of another CA was refused")
def foreign_ca(watch: Watch) -> bool:
    return gets_in(watch, "mallory" if watch.site.secured else "")


@attempt("3", "a certificate that has expired", "somebody whose certificate has expired was refused")
def expired(watch: Watch) -> bool:
    return gets_in(watch, "late" if watch.site.secured else "")


@attempt("4", "plain TCP at the port", "somebody who does not speak TLS was refused")
def plain_tcp(watch: Watch) -> bool:
    address = watch.site.endpoint.partition("/")[2]
    return gets_in(watch, "", connect__endpoints=[f"tcp/{address}"])


@attempt("5", "r2 publishes as r1", "r2 may not publish r1/intruded")
def another_robot_publishes(watch: Watch) -> bool:
    intruder = watch.site.intruder("r2")
    intruder.put("r1/intruded", b"x")
    return comes(watch.commands)


@attempt("5a", "r2 publishes as r1 by a declared publisher", "r2 may not publish r1/intruded")
def another_robot_declares(watch: Watch) -> bool:
    publisher = watch.site.intruder("r2").declare_publisher("r1/intruded")
    publisher.put(b"x")
    return comes(watch.commands)


@attempt("5b", "r2 publishes on a key with wildcards", "r2 may not publish */intruded")
def another_robot_publishes_wide(watch: Watch) -> bool:
    watch.site.intruder("r2").put("*/intruded", b"x")
    return comes(watch.commands)


@attempt("5c", "r2's machine publishes what its contracts do not say", "r2 may not publish fleet/intruded")
def robot_outside_its_policy(watch: Watch) -> bool:
    heard = plain.hear(watch.owner, "fleet/intruded")
    watch.site.intruder("r2").put("fleet/intruded", b"x")
    return comes(heard)


@attempt("6", "a viewer publishes", "eve may not publish r1/intruded")
def viewer_publishes(watch: Watch) -> bool:
    watch.site.intruder("eve").put("r1/intruded", b"x")
    return comes(watch.commands)


@attempt("6a", "a viewer deletes", "eve may not delete what is said on r1/map")
def viewer_deletes(watch: Watch) -> bool:
    watch.site.intruder("eve").delete("r1/map")
    return comes(watch.map_gone)


@attempt("7", "a viewer calls a service", "eve may not call r1/emergency_stop/reset_as_test")
def viewer_calls(watch: Watch) -> bool:
    key = "r1/emergency_stop/reset_as_test"
    ran = threading.Event()
    site = watch.site.session("r1")  # it is the robot's to serve

    def answer(query: zenoh.Query) -> None:
        ran.set()
        query.reply(key, b"done")

    site.declare_queryable(key, answer)
    eventually(lambda: bool(answers(watch.owner, key)), "the owner calls it")
    ran.clear()
    return bool(answers(watch.site.intruder("eve"), key)) or ran.is_set()


@attempt("8", "a viewer sets a parameter", "eve may not call r1/safety_monitor/parameters/set")
def viewer_sets(watch: Watch) -> bool:
    return bool(list(watch.site.intruder("eve").get("r1/safety_monitor/parameters/set", timeout=2.0)))


@attempt("8a", "a viewer asks all that may be asked of parameters", "eve may not call r1/safety_monitor/parameters/*")
def viewer_asks_wide(watch: Watch) -> bool:
    return bool(list(watch.site.intruder("eve").get("r1/safety_monitor/parameters/*", timeout=2.0)))


@attempt("9", "a viewer ends the robot", "eve may not down what runs of r1")
def viewer_ends(watch: Watch) -> bool:
    # On a wider key than the supervisor obeys: with security off the robot is to be there for the next attempt.
    key = control_key("r1", "down") if watch.site.secured else control_key("r1", "ps")
    return bool(list(watch.site.intruder("eve").get(key, timeout=2.0, payload=b"\x80")))


@attempt("9a", "another robot ends the robot", "r2 may not down what runs of r1")
def robot_ends_robot(watch: Watch) -> bool:
    key = control_key("r1", "down") if watch.site.secured else control_key("r1", "ps")
    return bool(list(watch.site.intruder("r2").get(key, timeout=2.0, payload=b"\x80")))


@attempt("10", "r2 hears all", "r2 may not subscribe to **")
def robot_hears_all(watch: Watch) -> bool:
    return comes(plain.hear(watch.site.intruder("r2"), "**"))


@attempt("10a", "r2 hears r1", "r2 may not subscribe to r1/**")
def robot_hears_robot(watch: Watch) -> bool:
    return comes(plain.hear(watch.site.intruder("r2"), "r1/**"))


@attempt("11", "r2 announces a node of r1", "r2 may not announce @robo/r1/node/evil/")
def robot_announces(watch: Watch) -> bool:
    token = NodeToken("r1", "evil", "a:B", 1, "host").key()
    held = watch.site.intruder("r2").liveliness().declare_token(token)
    time.sleep(QUIET)
    seen = [reply for reply in watch.owner.liveliness().get(NodeToken.ALL, timeout=2.0) if reply.ok is not None]
    del held
    found = [parse_token(str(reply.ok.key_expr)) for reply in seen if reply.ok is not None]
    return any(isinstance(one, NodeToken) and one.node == "evil" for one in found)


@attempt("12", "r2 answers for r1", "r2 may not serve r1/answered")
def robot_answers(watch: Watch) -> bool:
    intruder = watch.site.intruder("r2")
    intruder.declare_queryable("r1/answered", lambda query: query.reply("r1/answered", b"false"), complete=True)
    time.sleep(QUIET)
    return bool(answers(watch.owner, "r1/answered"))


@attempt("14", "a viewer reads what Zenoh says of itself", "eve may not ask what routers say of themselves")
def viewer_reads_admin(watch: Watch) -> bool:
    intruder = watch.site.intruder("eve")
    return any(str(one.ok.key_expr).startswith("@/") and str(intruder.zid()) not in str(one.ok.key_expr)
               for one in answers(intruder, "@/**") if one.ok is not None)  # fmt: skip


@attempt("15", "somebody changes the router's settings")
def changes_settings(watch: Watch) -> bool:
    key = f"@/{next(iter(watch.owner.info.routers_zid()))}/router/config/access_control/enabled"
    watch.owner.put(key, b"false")
    time.sleep(QUIET)
    intruder = watch.site.intruder("r2") if watch.site.secured else None
    if intruder is None:
        return False  # there is nothing to be turned off
    intruder.put("r1/intruded", b"x")
    return comes(watch.commands)


def _past_the_router(watch: Watch, endpoint: str) -> bool:
    peer = watch.site.intruder("eve", mode="peer", connect__endpoints=[endpoint], listen__endpoints=[])
    time.sleep(2 * QUIET)  # gossip comes within some ms
    linked = [str(link.dst) for link in peer.info.links()]
    peer.put("r1/intruded", b"x")
    return (
        bool(list(peer.info.peers_zid())) or any(one.startswith("unixsock") for one in linked) or comes(watch.commands)
    )


@attempt("16", "a peer is led past the site's router by gossip", "eve may not publish r1/intruded")
def gossip_at_the_site(watch: Watch) -> bool:
    return _past_the_router(watch, watch.site.endpoint)


@attempt("16a", "a peer on the robot's own machine is led past its router by gossip")
def gossip_at_the_robot(watch: Watch) -> bool:
    return _past_the_router(watch, watch.site.door)


@attempt("17", "somebody takes the id of the robot's router")
def takes_an_id(watch: Watch) -> bool:
    told = answers(watch.owner, "@/*/router")
    own = {str(zid) for zid in watch.owner.info.routers_zid()}
    ids = {str(one.ok.key_expr).split("/")[1] for one in told if one.ok is not None} - own
    linked = [*own, *ids][-1]
    gets_in(watch, "r2", id=linked)
    watch.drives()
    return False


@attempt("13", "r2 answers its own question with r1's key")
def answers_itself(watch: Watch) -> bool:
    intruder, wrong = watch.site.intruder("r2"), []

    def answer(query: zenoh.Query) -> None:
        try:
            query.reply("r1/intruded", b"x")
        except zenoh.ZError as error:
            wrong.append(error)

    intruder.declare_queryable("r2/asked", answer)
    return bool(answers(intruder, "r2/asked")) and not wrong


def _is_linked(watch: Watch, id_: str) -> bool:
    told = [reply.ok.payload.to_string() for reply in answers(watch.owner, "@/*/router") if reply.ok is not None]
    assert any(str(watch.owner.zid()) in one for one in told), "a router says who is linked to it"
    return any(id_ in one for one in told)


@attempt("18", "r2 takes the id that an operator has had", "r2 may not publish r1/intruded")
def takes_an_operators_id(watch: Watch) -> bool:
    operator = watch.site.session("ann")
    id_ = str(operator.zid())
    operator.close()
    eventually(lambda: not _is_linked(watch, id_), "the router has let the operator go")
    watch.site.intruder("r2", id=id_).put("r1/intruded", b"x")
    return comes(watch.commands)


@attempt("19", "r2 fills the router's memory with one message")
def fills_memory(watch: Watch) -> bool:
    heard = watch.site.session("ann").declare_subscriber("r2/big", zenoh.handlers.RingChannel(1))
    intruder = watch.site.intruder("r2")
    intruder.put("r2/big", bytes(160 << 20))
    router = psutil.Process(watch.site.router.process.pid)
    end = time.monotonic() + 2 * QUIET
    most = 0
    while time.monotonic() < end:
        most = max(most, router.memory_info().rss)
        time.sleep(0.02)
    return heard.try_recv() is not None or most > 160 << 20


def _owner_is_kept_out(watch: Watch) -> bool:
    try:
        watch.site.session("ann").close()
    except zenoh.ZError:
        return True
    return False


@attempt("22", "r2 opens many sessions")
def many_sessions(watch: Watch) -> bool:
    sessions = [watch.site.intruder("r2") for _ in range(40)]
    kept_out = _owner_is_kept_out(watch)
    for session in sessions:
        session.close()
    return kept_out


def _tried_by_another_user(watch: Watch, *words: str) -> Any:
    if no_other_user():
        pytest.skip(no_other_user())
    outsider = watch.site.outsider("drives", *words)
    assert outsider.wait() == 0, outsider.output
    return json.loads(outsider.output)


@attempt("23", "another user of the machine drives the robot", "somebody without a certificate was refused")
def another_user_drives(watch: Watch) -> bool:
    site, tls = watch.site, ""
    if site.secured:
        # He knows whom to trust: that is no secret.
        ca = Path(tempfile.mkdtemp(prefix="robo-ca-", dir="/tmp")) / "ca.pem"
        ca.parent.chmod(0o755)
        shutil.copy(site.store.folder / "ca.pem", ca)
        ca.chmod(0o644)
        tls = f"#root_ca_certificate_file={ca}"
    said = _tried_by_another_user(watch, str(site.folder), site.endpoint + tls, site.door + tls)
    if tls:
        shutil.rmtree(ca.parent)
    return any(said["let in"]) or comes(watch.commands)


@attempt("23a", "another user of the machine reads a key")
def another_user_reads(watch: Watch) -> bool:
    return bool(_tried_by_another_user(watch, str(watch.site.store.folder))["read"])


@attempt("24", "another user of the machine is first where a router is to be")
def is_first(watch: Watch) -> bool:
    if no_other_user():
        pytest.skip(no_other_user())
    address = f"127.0.0.1:{free_port()}"
    holder = watch.site.outsider("holds", f"tcp/{address}")
    holder.wait_for("there")
    place = f"{watch.site.protocol}/{address}"
    words = ("topic", "pub", "r1/secret", "std/String", "data: x", "--once")
    watch.site.run(*words, security="ann" if watch.site.secured else "", endpoint=place)
    holder.interrupt()
    assert holder.wait() == 0, holder.output
    return bool(json.loads(holder.output.splitlines()[-1])["heard"])


@attempt("26", "a router of the network that is of another host stands where the site is dialled")
def stands_in(watch: Watch) -> bool:
    site = watch.site
    place = f"{site.protocol}/127.0.0.1:{free_port()}"
    settings: dict[str, object] = {"mode": "router", "listen/endpoints": [place], "scouting/multicast/enabled": False}
    if site.secured:
        folder = site.of_another_host()
        settings["transport/link/tls"] = {
            "root_ca_certificate": str(site.store.folder / "ca.pem"),
            "listen_private_key": str(folder / "key.pem"), "listen_certificate": str(folder / "cert.pem"),
        }  # fmt: skip
    heard = plain.hear(site.keep_open(zenoh.open(plain_config(settings))), "**")
    words = ("topic", "pub", "r1/secret", "std/String", "data: x", "--once")
    site.run(*words, security="ann" if site.secured else "", endpoint=place)
    return comes(heard)


@attempt("25", "somebody who was revoked", "gone, who is not in the policy, is linked and may do nothing")
def revoked(watch: Watch) -> bool:
    if not watch.site.secured:
        return True
    return comes(plain.hear(watch.site.intruder("gone"), "r1/odom"))


# The last one: for each connection that breaks off in its handshake, Zenoh lets the next ones wait for 0.1 s.
@attempt("20", "400 connections that say nothing")
def says_nothing(watch: Watch) -> bool:
    host, _, port = watch.site.endpoint.partition("/")[2].rpartition(":")
    with ExitStack() as idle:
        for _ in range(400):
            idle.enter_context(socket.create_connection((host, int(port))))
        return _owner_is_kept_out(watch)


OPEN_BY_CHOICE = {attempt.number for attempt in ATTEMPTS} - {"13", "15", "17", "19", "20", "22", "23a"}
"""What works where security is off; Zenoh itself, or robo's limits, refuse the others then too."""


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watch]:
    site = Site(tmp_path_factory.mktemp("secured"))
    try:
        yield Watch(site)
    finally:
        site.close()


@pytest.fixture(scope="module")
def unsecured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watch]:
    site = Site(tmp_path_factory.mktemp("open"), secured=False)
    try:
        yield Watch(site)
    finally:
        site.close()


@pytest.mark.parametrize("tried", ATTEMPTS, ids=lambda one: f"{one.number}: {one.about}")
def test_an_intruder_is_refused_and_the_robot_drives_on(secured: Watch, tried: Attempt) -> None:
    assert not tried.tries(secured)
    if tried.told:
        secured.told(tried.told)
    secured.drives()


@pytest.mark.parametrize("tried", ATTEMPTS, ids=lambda one: f"{one.number}: {one.about}")
def test_without_security_this_is_open(unsecured: Watch, tried: Attempt) -> None:
    assert tried.tries(unsecured) is (tried.number in OPEN_BY_CHOICE)
    unsecured.drives()
