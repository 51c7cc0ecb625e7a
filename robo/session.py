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
from collections.abc import Mapping, Sequence
from typing import Literal, get_args

import msgspec

os.environ.setdefault(
    # One receiving thread, and what else Zenoh does on its network threads: two threads fewer in each
    # process and less latency than its default. Sending stays apart from receiving: on one runtime a
    # receiver that is held up also holds up what it must send, and messages were lost and torn.
    "ZENOH_RUNTIME",
    "(rx:(worker_threads:1),acc:(handover:net),tx:(handover:net))",
)

import zenoh

from robo.errors import NetworkError

Mode = Literal["peer", "client", "router"]
MODES: tuple[Mode, ...] = get_args(Mode)

RENDEZVOUS = "tcp/127.0.0.1:7447"
"""Where robots on one machine meet: the first router listens there, the others link to it."""

_SOURCE = re.compile(r" at \S+\.rs:\d+\.?")
"""Where in Zenoh's own source an error was raised: no help to users."""

_logger = logging.getLogger("robo.session")

_RETRY = {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 1.5}


class Network(msgspec.Struct, frozen=True, kw_only=True):
    """How a process joins the network."""

    mode: Mode = "router"
    connect: tuple[str, ...] = ()
    """Zenoh endpoints to dial, for example `tcp/192.168.1.20:7447`; retried until they answer."""
    listen: tuple[str, ...] = ()
    """Zenoh endpoints to listen on; a router takes one that is in use over once it is free."""
    name: str = ""
    """What a router calls itself where one asks who is there."""
    timeout: float = 10.0
    """How long a peer or client waits for its first connection, s."""
    more: dict[str, object] = {}
    """What else is said of it in Zenoh's own terms: maps within maps, as in Zenoh's configuration."""

    @classmethod
    def from_environment(cls, mode: Mode, connect: Sequence[str] = (), listen: Sequence[str] = ()) -> "Network":
        """Options first, then ROBO_CONNECT and ROBO_LISTEN (endpoints joined by commas), then loopback.

        A router listens at the rendezvous and also dials it: whoever holds the port is the meeting
        point, and when it leaves the next one takes the port over.
        """
        dial = tuple(connect) or _endpoints("ROBO_CONNECT")
        serve = tuple(listen) or _endpoints("ROBO_LISTEN")
        if mode == "router":
            serve = serve or (RENDEZVOUS,)
            return cls(mode=mode, connect=dial + tuple(e for e in serve if "127.0.0.1:" in e), listen=serve)
        return cls(mode=mode, connect=dial or (RENDEZVOUS,), listen=serve)


def _endpoints(variable: str) -> tuple[str, ...]:
    return tuple(e.strip() for e in os.environ.get(variable, "").split(",") if e.strip())


def zenoh_config(network: Network) -> zenoh.Config:
    """The Zenoh configuration of a session.

    Raises:
        NetworkError: an endpoint is no Zenoh endpoint.
    """
    config = zenoh.Config()
    for key, value in {**settings_of(network), **settings_by_path(network.more)}.items():
        try:
            config.insert_json5(key, msgspec.json.encode(value).decode())
        except zenoh.ZError as error:
            shown = ", ".join(value) if isinstance(value, tuple) else msgspec.json.encode(value).decode()
            hint = "; an endpoint looks like tcp/127.0.0.1:7447" if key.endswith("endpoints") else ""
            raise NetworkError(f"{key}: {shown} is not accepted{hint} ({_plain(error)})") from None
    return config


_MODES = {"router", "peer", "client"}


def settings_by_path(tree: Mapping[str, object], path: str = "") -> dict[str, object]:
    """Settings by their paths. A map of modes is one setting: Zenoh takes it as a whole."""
    found: dict[str, object] = {}
    for key, value in tree.items():
        place = f"{path}/{key}" if path else key
        if isinstance(value, dict) and value and not value.keys() <= _MODES and place != "metadata":
            found |= settings_by_path(value, place)
        else:
            found[place] = value
    return found


def settings_of(network: Network) -> dict[str, object]:
    """What differs from Zenoh's defaults, by the path of each setting in Zenoh's configuration."""
    router = network.mode == "router"
    settings: dict[str, object] = {
        "mode": network.mode,
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "listen/endpoints": network.listen,
        "connect/endpoints": network.connect,
        "connect/retry": _RETRY,
        "connect/timeout_ms": -1 if router else round(network.timeout * 1000),
        "connect/exit_on_failure": not router,
        # A process that hangs or whose cable is cut is given up after this long.
        "transport/link/tx/lease": 2000,
        # Zenoh sends what is larger than this through shared memory, and each process that takes part
        # holds 20 MB of it. By default (3 kB) laser scans would, and gain nothing.
        "transport/shared_memory/transport_optimization/message_size_threshold": 65_536,
    }
    if os.environ.get("ROBO_SHM") == "off":
        settings["transport/shared_memory/enabled"] = False
    if router:
        settings |= {"listen/retry": _RETRY, "listen/timeout_ms": -1, "listen/exit_on_failure": False}
        # Tools ask routers who is connected, and what those declare who are no nodes of robo's.
        settings |= {"adminspace/enabled": True, "metadata": {"name": network.name}}
    if all(endpoint.startswith("unixsock-stream/") for endpoint in network.connect + network.listen):
        # Between processes of one machine a longer queue keeps both ends busy; over a slow link it would
        # hold old messages. Leave `transport/unicast/qos` on: without it a publisher that drops a
        # message once on a full queue now and then drops all of them from then on (zenoh 1.10).
        settings["transport/link/tx/queue/size/data"] = 16
    return settings


def open_session(network: Network) -> zenoh.Session:
    """Open a session; it is closed at exit if nobody closes it before.

    Raises:
        NetworkError: nobody answers at the endpoints to dial within `network.timeout`.
    """
    try:
        session = zenoh.open(zenoh_config(network))
    except zenoh.ZError as error:
        where = ", ".join(network.connect) or ", ".join(network.listen)
        raise NetworkError(
            f"no connection at {where}: {_SOURCE.sub('', str(error))}\n"
            "  Is a robot running there? `robo up` starts one; --connect names another place."
        ) from None
    _open.append(session)
    return session


def _plain(error: zenoh.ZError) -> str:
    """What Zenoh says is wrong, without where in its source."""
    message = re.search(r'msg: "(.*?)"', str(error))
    return _SOURCE.sub("", message[1] if message is not None else str(error))


_open: list[zenoh.Session] = []

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
    closing = threading.Thread(target=_close, args=(session,), name="robo-close", daemon=True)
    closing.start()
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
