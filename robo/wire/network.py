"""How a process joins the network, as Zenoh's settings."""

import os
import re
from collections.abc import Mapping, Sequence
from typing import Literal, cast, get_args

import msgspec
import zenoh

from robo.environment import CONNECT_VARIABLE, LISTEN_VARIABLE, SECURITY_VARIABLE, SHARED_MEMORY_VARIABLE
from robo.errors import NetworkError
from robo.text.paths import unnested
from robo.wire import access, meeting, shared_memory

Mode = Literal["peer", "client", "router"]
MODES: tuple[Mode, ...] = get_args(Mode)

PORT = 7447
"""Of routers, unless they are told another one: Zenoh's own."""

RENDEZVOUS = f"tcp/127.0.0.1:{PORT}"
"""Where others find the robots of a machine, to look at: the first router listens there, and nobody of robo's who was
not told to dials it. Anybody may have taken it."""

SECURED_RENDEZVOUS = f"tls/127.0.0.1:{PORT}"
"""And with security on: by TLS, each with the rights of his name."""

FOR_YOURS = "for your own tools"
"""Who finds a router that others do not find."""

_SOURCE = re.compile(r" at \S+\.rs:\d+\.?")

_RETRY = {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 1.5}

_RETRY_OF_A_ROUTER = {**_RETRY, "period_init_ms": 300}
"""Of a router that has lost another one: after its first try, which is at once and mostly in vain, it links to none for
a while. Zenoh 1.10.2 looks every 100 ms at who has gone and who has come, and takes who came for who went where it sees
both at a time, since it knows them by numbers that it gives anew: then it does not tell the new one what is subscribed
and served here, for as long as the link lasts."""

OWN_ROUTER_WITHIN = 40.0
"""How long a run and its nodes wait for the run's own router, s: it may be late on a busy machine, and one that hangs
as it starts is started again after 10 s, or 15 s."""


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
    guarded: bool = False
    """Whether who comes to a router by another way than a unix socket only looks."""
    shared: tuple[str, ...] = ()
    """The robots, by namespace, with which who comes to a guarded router may do all."""
    shared_memory: bool = True
    """Whether large messages may come and go through shared memory."""
    more: dict[str, object] = {}
    """What else is said of it in Zenoh's own terms: maps within maps, as in Zenoh's configuration."""
    security: str = ""
    """The folder of the name that it has on a secured network; empty where security is off."""

    @classmethod
    def from_environment(
        cls, mode: Mode, connect: Sequence[str] = (), listen: Sequence[str] = (), *, meeting_point: bool = False
    ) -> "Network":
        """Options first, then ROBO_CONNECT and ROBO_LISTEN (endpoints joined by commas), then where this user's are.

        A router that is told nothing listens where its user's robots meet and also dials it: whoever holds the place is
        the meeting point, and when it leaves the next one takes it over. For others it listens at the rendezvous, where
        they look and no more. One that dials a network link has no such door: the rules for who comes by it
        would be those of the link as well. What an endpoint says is as open as it is.

        With ROBO_SECURITY the door for others is one of TLS, with rules for each name, so it is there in any case.

        A node that is told where to dial joins that network and no other; a robot is met by its user's others
        in any case. A client, as tools are, listens nowhere.

        Args:
            mode: how it joins.
            connect: what options say is dialled.
            listen: and where they say that it listens.
            meeting_point: whether a router is where its user's robots meet also if it is told to dial another place.

        Raises:
            NetworkError: the folder in which this user's robots meet is not to be trusted, or cannot be made.
        """
        dial = tuple(connect) or _endpoints(CONNECT_VARIABLE)
        serve = tuple(listen) or (() if mode == "client" else _endpoints(LISTEN_VARIABLE))
        security = os.environ.get(SECURITY_VARIABLE, "")
        if mode == "router":
            if serve or (dial and not meeting_point):
                own = tuple(e for e in serve if "127.0.0.1:" in e)
                return cls(mode=mode, connect=dial + own, listen=serve, security=security)
            meeting.prepare()
            place = meeting.endpoint()
            if security:
                return cls(mode=mode, connect=(*dial, place), listen=(place, SECURED_RENDEZVOUS), security=security)
            if all(endpoint.startswith(meeting.UNIX) for endpoint in dial):
                return cls(mode=mode, connect=(*dial, place), listen=(place, RENDEZVOUS), guarded=True)
            return cls(mode=mode, connect=(*dial, place), listen=(place,))
        if not dial:
            meeting.check()
        return cls(mode=mode, connect=dial or (meeting.endpoint(),), listen=serve, security=security)

    @property
    def doors(self) -> tuple[str, ...]:
        """Where a router that meets its user's others at their socket lets others in.

        Nobody of robo's who was not told to dials them: anybody may have the port.
        """
        if not (self.guarded or (self.security and meeting.endpoint() in self.listen)):
            return ()
        return tuple(endpoint for endpoint in self.listen if not endpoint.startswith(meeting.UNIX))

    @property
    def reached(self) -> str:
        """Where others find a router, and what they may do, for people: `at tcp/0.0.0.0:7447`."""
        network = ", ".join(endpoint for endpoint in self.listen if not endpoint.startswith(meeting.UNIX))
        if not network:
            return FOR_YOURS
        if self.security and self.doors:
            return f"{FOR_YOURS}, and for whom the policy names at {network}"
        if not self.guarded:
            return f"at {network}"
        return f"{'shared with' if self.shared else 'read-only for'} others at {network}"

    @property
    def places(self) -> tuple[str, ...]:
        """Where another router may be that is there before this one, as this machine dials them.

        A door for others is none of them: whoever is there is not to be believed.
        """
        from robo.wire import tcp  # with sockets, which a node that is linked to its robot alone does without

        own = [endpoint for endpoint in self.listen if endpoint.startswith(meeting.UNIX)]
        return (*own, *(() if self.doors else filter(None, map(tcp.nearby, self.listen))))


def _endpoints(variable: str) -> tuple[str, ...]:
    return tuple(e.strip() for e in os.environ.get(variable, "").split(",") if e.strip())


def zenoh_config(network: Network) -> zenoh.Config:
    """The Zenoh configuration of a session.

    Raises:
        NetworkError: an endpoint is no Zenoh endpoint.
        SecurityError: with security on: a key, a certificate or rules are missing or too open, or an endpoint is in
            the clear.
    """
    config = zenoh.Config()
    for key, value in settings_of(network).items():
        try:
            config.insert_json5(key, msgspec.json.encode(value).decode())
        except zenoh.ZError as error:
            shown = ", ".join(value) if isinstance(value, tuple) else msgspec.json.encode(value).decode()
            hint = "; an endpoint looks like tcp/127.0.0.1:7447" if key.endswith("endpoints") else ""
            raise NetworkError(f"{key}: {shown} is not accepted{hint} ({_plain(error)})") from None
    return config


def settings_by_path(tree: Mapping[str, object]) -> dict[str, object]:
    """Settings by their paths. A map of modes is one setting: Zenoh takes it as a whole."""
    return dict(unnested(tree, "/", _holds_settings))


def _holds_settings(path: str, inner: Mapping[str, object]) -> bool:
    return bool(inner) and not inner.keys() <= set(MODES) and path != "metadata"


def settings_of(network: Network) -> dict[str, object]:
    """What differs from Zenoh's defaults, by the path of each setting in Zenoh's configuration."""
    settings = _own_settings(network)
    more = settings_by_path(network.more)
    for whole in access.WHOLE:
        if any(path.partition("/")[0] == whole for path in more):
            settings.pop(whole, None)  # the owner's own rules stand alone
    rules = more.get(_RULES)
    if isinstance(rules, list):  # one after the other: a rule of the user's may also take ours back for a key
        more[_RULES] = [*cast("list[object]", settings.get(_RULES, [])), *rules]
    return settings | more | _secured(network)  # which nothing else undoes


def _secured(network: Network) -> dict[str, object]:
    if not network.security:
        return {}
    from robo.wire import identity  # which most processes do without

    identity.check_endpoints((*network.connect, *network.listen))
    return identity.settings(identity.load(identity.folder_of(network.security)), router=network.mode == "router")


_RULES = "qos/network"


def _rule(name: str, *, where: dict[str, object], express: bool, overwrite: dict[str, object]) -> dict[str, object]:
    """What becomes, on the way out, of messages whose sender waits for a full receiver."""
    return {
        "id": name,
        "flows": ["egress"],
        **where,
        "messages": ["put", "delete"],
        "qos": {"congestion_control": "block", "express": express},
        "overwrite": overwrite,
    }


_LOOPBACK: dict[str, object] = {"interfaces": ["lo", "lo0"]}
_NETWORK: dict[str, object] = {"link_protocols": ["tcp", "udp", "tls", "quic", "ws"]}

_NEVER_WAIT = [
    _rule("of_this_machine", where=_LOOPBACK, express=False, overwrite={"express": True}),
    _rule("never_wait_for_the_network", where=_NETWORK, express=False, overwrite={"congestion_control": "drop"}),
    _rule("of_this_machine_again", where=_LOOPBACK, express=True, overwrite={"express": False}),
]
"""What a router sends to other hosts waits for nobody: while one message waits for a reader that has
stopped, or whose cable is cut, all that comes from its sender waits too, for everybody. A rule cannot say
"all interfaces but one", so what goes to this machine bears a mark, `express`, while the rule in the middle
is applied. There `depth=KEEP_ALL` still makes a sender wait."""


_LIMITS: dict[str, object] = {
    # In bytes. Zenoh would take 1 GiB into the router's memory; what is larger is dropped, and the link lives on.
    "transport/link/rx/max_message_size": 128 << 20,
    "transport/unicast/max_sessions": 1_000,
    # Connections that say nothing: with Zenoh's 100, each for 10 s, 150 of them let nobody in any more.
    "transport/unicast/accept_pending": 500,
    "transport/unicast/accept_timeout": 3_000,  # ms
}
"""What strangers may do to a router at most; `--network-config` may say other numbers."""


def _own_settings(network: Network) -> dict[str, object]:
    router = network.mode == "router"
    settings: dict[str, object] = {
        "mode": network.mode,
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "listen/endpoints": network.listen,
        "connect/endpoints": network.connect,
        "connect/retry": _RETRY_OF_A_ROUTER if router else _RETRY,
        "connect/timeout_ms": -1 if router else round(network.timeout * 1000),
        "connect/exit_on_failure": not router,
        # A process that hangs or whose cable is cut is given up after this long.
        "transport/link/tx/lease": 2000,
    }
    if not network.shared_memory or os.environ.get(SHARED_MEMORY_VARIABLE) == "off" or shared_memory.hindrance():
        settings["transport/shared_memory/enabled"] = False
    else:
        # Publishers put large messages into shared memory themselves. Zenoh's own way copies them once more, and where
        # there is not enough it fills up what there is, or ends its threads.
        settings["transport/shared_memory/transport_optimization/enabled"] = False
    if router:
        settings |= {"listen/retry": _RETRY, "listen/timeout_ms": -1, "listen/exit_on_failure": False}
        # Tools ask routers who is connected, and what is declared by those that are no nodes of robo's.
        metadata: dict[str, object] = {"name": network.name}
        settings |= {"adminspace/enabled": True, "metadata": metadata}
        # A router tells another at once all that it knows, on the thread that receives. Two that each wait for the
        # other to take it stand still until their link is given up: so there is room for what some robots declare.
        settings["transport/link/tx/queue/size/control"] = 16
        settings[_RULES] = _NEVER_WAIT
        settings |= _LIMITS
        if network.guarded:
            settings |= access.settings(network.shared)
            metadata |= access.told(meeting.user_name(os.geteuid()), network.shared)
    if on_this_machine(network):
        # Between processes of one machine a longer queue keeps both ends busy; over a slow link it would
        # hold old messages. Leave `transport/unicast/qos` on: without it a publisher that drops a
        # message once on a full queue now and then drops all of them from then on (zenoh 1.10).
        settings["transport/link/tx/queue/size/data"] = settings["transport/link/tx/queue/size/background"] = 16
    return settings


def on_this_machine(network: Network) -> bool:
    """Whether all of its links are unix sockets."""
    return all(endpoint.startswith(meeting.UNIX) for endpoint in network.connect + network.listen)


def _plain(error: zenoh.ZError) -> str:
    """What Zenoh says is wrong, without where in its source."""
    message = re.search(r'msg: "(.*?)"', str(error))
    return without_source(message[1] if message is not None else str(error))


def without_source(text: str) -> str:
    """What Zenoh says, without the place in its own source where it says so: no help to users."""
    return _SOURCE.sub("", text)
