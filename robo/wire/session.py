"""Opening Zenoh sessions with robo's defaults: loopback only, no multicast, quick to start and to heal.

Three kinds of process take part. A robot's **nodes** are peers that meet at their robot's router and
then link directly. **Routers** join robots to each other and serve tools; a node that is run alone is
its own router. **Tools** are clients of a router.
"""

import atexit
import logging
import os
import re
import threading
from contextlib import suppress

import zenoh

from robo.errors import NetworkError
from robo.wire import shared_memory, zenoh_threads
from robo.wire.ids import new_id
from robo.wire.network import Network, on_this_machine, without_source, zenoh_config

os.environ.setdefault(zenoh_threads.VARIABLE, zenoh_threads.OF_A_NODE)

_UNREACHED = re.compile(r"Unable to connect to any of \[.*\]\. Timeout!")
"""How Zenoh says that nobody answers."""

_logger = logging.getLogger("robo.wire.session")


def open_session(network: Network, *, plain: bool = False) -> zenoh.Session:
    """Open a session; it is closed at exit if nobody closes it before.

    Args:
        network: how.
        plain: whether it is one of those that are not robo's: what it publishes is listed though no node announces it.

    Raises:
        NetworkError: nobody answers at the endpoints to dial within `network.timeout`.
    """
    if network.mode == "router":
        zenoh_threads.use_those_of_a_router()
    config = zenoh_config(network)
    if not plain and "id" not in network.more:
        config.insert_json5("id", f'"{new_id()}"')
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        reason = _UNREACHED.sub("nobody answers", without_source(str(error)))
        where = ", ".join(network.connect) or ", ".join(network.listen)
        raise NetworkError(
            f"no connection at {where}: {reason}\n"
            "  Is a robot running there? `robo up` starts one; --connect names another place."
        ) from None
    _open.append(session)
    _networks[str(session.zid())] = network
    shared_memory.use(session, directly=network.mode != "client" and network.shared_memory)
    if not on_this_machine(network):
        import robo.wire.tcp  # noqa: F401 - for _on_link; a node that is linked to its robot alone needs no sockets

        # Called on a thread of Zenoh's, once for each link: no thread more for it.
        at_once = zenoh.handlers.Callback(_on_link, indirect=False)
        session.info.declare_link_events_listener(at_once, history=True)
    return session


def _on_link(event: zenoh.LinkEvent) -> None:
    if event.kind == zenoh.SampleKind.PUT and event.link.src.startswith(_OVER_TCP):
        from robo.wire import tcp  # imported before: nothing is to be loaded on a thread of Zenoh's

        tcp.end_without_waiting(event.link.src, event.link.dst)


_OVER_TCP = ("tcp/", "tls/", "ws/")


_open: list[zenoh.Session] = []
_networks: dict[str, Network] = {}
"""By the ids of these sessions, how each has joined."""
_beside: dict[str, zenoh.Session] = {}
"""By the id of a session, a second one of its own."""
_beside_lock = threading.Lock()


def beside(session: zenoh.Session, timeout: float) -> zenoh.Session | None:
    """A second session, of a client, where a session of a client or a peer has joined; it is closed with that one.

    Args:
        session: one that was opened here.
        timeout: how long to wait for the router, s.

    Returns:
        None for one that is a router itself, or that was not opened here, and where nobody answers.
    """
    zid = str(session.zid())
    network = _networks.get(zid)
    if network is None or network.mode == "router":
        return None
    with _beside_lock:
        if zid not in _beside:
            with suppress(NetworkError):
                _beside[zid] = open_session(
                    Network(mode="client", connect=network.connect, timeout=timeout, security=network.security)
                )
        return _beside.get(zid)


def is_client(session: zenoh.Session) -> bool:
    """Whether a session was opened here as a client's: it has one link, and sees nothing without it."""
    network = _networks.get(str(session.zid()))
    return network is not None and network.mode == "client"


def opened() -> list[zenoh.Session]:
    """The sessions that were opened here and are not closed yet."""
    return list(_open)


CLOSE_TIMEOUT = 0.6
"""How long to wait for a session to close, s. Zenoh itself waits 10 s for links that do not answer,
and a link that is just being dialled does not."""


def close_session(session: zenoh.Session) -> bool:
    """Leave the network; safe to call twice.

    What was published has left before. A link that keeps Zenoh from closing in time ends with the
    process, so this is logged and no error.

    Returns:
        Whether it closed in time. Where it did not, a process had better end with `os._exit`:
        Python would wait for Zenoh at exit.
    """
    if session not in _open:
        return True
    _open.remove(session)
    zid = str(session.zid())
    _networks.pop(zid, None)
    if (second := _beside.pop(zid, None)) is not None:
        close_session(second)
    closing = threading.Thread(target=_close, args=(session,), name="robo-close", daemon=True)
    try:
        closing.start()
    except RuntimeError:  # Python 3.12 begins no thread once it is about to end
        _close(session)
        return True
    closing.join(CLOSE_TIMEOUT)
    if closing.is_alive():
        _logger.info("the session did not close within %g s", CLOSE_TIMEOUT)
        return False
    return True


def _close(session: zenoh.Session) -> None:
    try:
        session.close()
    except zenoh.ZError as error:
        _logger.info("the session did not close cleanly: %s", error)


@atexit.register
def _close_all() -> None:
    """A session that nobody closed would keep the process from exiting."""
    while _open:
        close_session(_open[-1])
