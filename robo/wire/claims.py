"""Two nodes of one name would drive one robot: whoever starts nodes claims their names before, and gives way.

A claim is a liveliness token for each node. It is declared wherever the network is met already, before anything of
the run starts; then the names that others claim or use are looked up. Of two that declare at once, either sees the
other, and the run whose id is the smaller has the names. Where nobody is met yet, two on one machine would not see
each other: they take turns, by a lock for each endpoint at which they would meet.
"""

import fcntl
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Protocol

import zenoh

from robo.errors import NetworkError, ReadOnly
from robo.wire import doors, knocking, liveliness, meeting, names, tcp
from robo.wire.discovery import hostname
from robo.wire.keys import ClaimToken, NodeToken, parse_token
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

ANSWERS_WITHIN = 0.5
"""How long a start waits for a site that may know of another run, s."""
PATIENCE = 3.0
"""How long a program that holds a port of this process may take to answer as a Zenoh router, s: it may be held up."""
TURN = 3.0
"""How long to wait for one's turn, s."""
GIVES_WAY = 1.0
"""How long another that claims the same names at the same time may take to give them up, s."""
SEEN_WITHIN = 10.0
"""How long it may take until others see what this process declares in its own network, s."""

Name = ClaimToken | NodeToken


class PortTaken(NetworkError):
    """A port at which a router is to listen is held by a program that is no Zenoh router."""


class Claim:
    """The names of nodes, for the process that is going to run them."""

    def __init__(self, network: Network, robot: str, full_names: Iterable[str], run: str) -> None:
        """
        Args:
            network: how the router joins the network that these nodes will be part of.
            robot: what the run is called.
            full_names: of the nodes.
            run: the id of the run.
        """
        self._robot = robot
        self.run = run
        """The id of the run."""
        self.tokens = [self.token_of(name) for name in full_names]
        self.sessions: list[zenoh.Session] = []
        """With the routers that are there already."""
        self.unreached: dict[str, OSError] = {}
        """What is to be dialled and does not answer, and why."""
        self._security = network.security
        self._own = list(network.places)
        self._dialled = list(dict.fromkeys((*network.connect, *self._own)))
        self._turns: list[_Turn] = []
        self._over = threading.Event()

    def token_of(self, full_name: str) -> ClaimToken:
        """The claim of one name by this process."""
        return ClaimToken(*names.split(full_name), self._robot, os.getpid(), hostname(), self.run)

    def take(self) -> list[Name]:
        """Claim the names.

        Returns:
            Those that others have: then none of these nodes may start.

        Raises:
            PortTaken: no tool and no robot would reach these nodes.
            ReadOnly: what they were told to join is another user's, and for others to look at.
        """
        try:
            return self._take()
        except BaseException:
            self.close()
            raise

    def _take(self) -> list[Name]:
        self._wait_for_turn()
        tried = dict(knocking.tried(self._dialled, ANSWERS_WITHIN))
        for endpoint in self._dialled:
            if not knocking.can_be_tried(endpoint):
                continue
            wrong = tried.get(endpoint, TimeoutError())
            session = self._meet(endpoint) if wrong is None else None
            if session is not None:
                self.sessions.append(session)
            elif endpoint not in self._own:
                self.unreached[endpoint] = wrong or ConnectionError("what listens there does not speak Zenoh")
        self._tokens = [declared for session in self.sessions for declared in declare(session, self.tokens)]
        taken = self._taken()
        end = time.monotonic() + GIVES_WAY
        while taken and all(_gives_way(other, self.run) for other in taken) and time.monotonic() < end:
            time.sleep(0.02)
            taken = self._taken()
        if self.sessions:
            self._end_turn()  # the next one sees these claims
        return taken

    def hold(self, session: zenoh.Session) -> None:
        """Go on claiming with a router of this process's own, and let go of the others once it is linked to them."""
        self._held = declare(session, self.tokens)

        def linked(other: zenoh.Session) -> bool:
            return {*map(str, other.info.routers_zid())} <= {*map(str, session.info.routers_zid())}

        threading.Thread(target=self.settle, args=(linked,), name="robo-claim", daemon=True).start()

    def settle(self, seen: Callable[[zenoh.Session], bool]) -> None:
        """Hold the claims until others see what this process declares itself, by now, in its own network.

        Args:
            seen: whether it shows at a router that was there before.
        """
        end = time.monotonic() + SEEN_WITHIN
        with suppress(zenoh.ZError):  # it ends already, and its sessions are closed
            while time.monotonic() < end and not self._over.wait(0.02):
                if self.sessions:
                    shows = all(map(seen, [*self.sessions]))
                else:
                    shows = not self._own or next(knocking.answering(self._own, ANSWERS_WITHIN), None) is not None
                if shows:
                    break
        self.close()

    def close(self) -> None:
        """Give up what is held for the time of the start."""
        self._over.set()
        self._end_turn()
        with suppress(IndexError):  # another thread may close them at the same time
            while self.sessions:
                close_session(self.sessions.pop())

    def _meet(self, endpoint: str) -> zenoh.Session | None:
        """A session with the router at an endpoint; None where there is none any more, or none at a site."""
        if endpoint in self._own:
            return meet(endpoint, self._security)
        try:
            session = open_session(_client(endpoint, self._security))
        except NetworkError:
            return None
        try:
            for namespace in {token.namespace for token in self.tokens}:
                doors.check(session, namespace, ANSWERS_WITHIN, joins=True)
        except ReadOnly:
            close_session(session)
            raise
        return session

    def gathers_for(self) -> float:
        """How much longer it may take until all that meet where this run does are seen, s: they may be linking anew."""
        return meeting.gathers_for() if meeting.endpoint() in self._own else 0.0

    def others_with(self, session: zenoh.Session, full_name: str) -> list[Name]:
        """Who else has a name, or claims it, as far as a session sees."""
        found = dict.fromkeys(names_in_use(session, ANSWERS_WITHIN))
        return [token for token in found if token.full_name == full_name and token.run != self.run]

    def _taken(self) -> list[Name]:
        own = {token.full_name for token in self.tokens}
        found = [token for session in self.sessions for token in names_in_use(session, ANSWERS_WITHIN)]
        return [token for token in dict.fromkeys(found) if token.full_name in own and token.run != self.run]

    def _wait_for_turn(self) -> None:
        end = time.monotonic() + TURN
        for endpoint in sorted(self._dialled) if sys.platform == "linux" else ():
            own = meeting.path_of(endpoint) if endpoint in self._own else None
            turn = _NamedTurn(endpoint) if own is None else _TurnInFolder(own)
            self._turns.append(turn)
            while time.monotonic() < end and not turn.take():
                time.sleep(0.01)

    def _end_turn(self) -> None:
        with suppress(IndexError):
            while self._turns:
                self._turns.pop().close()


class _Turn(Protocol):
    """A turn to start: one process has it, until it closes it or ends."""

    def take(self) -> bool:
        """Take it. Returns whether it is free, or this process's already."""

    def close(self) -> None:
        """Let the next one have it."""


class _NamedTurn:
    """A turn of all who would meet at an endpoint, whoever they are."""

    def __init__(self, endpoint: str) -> None:
        self._name = f"\0robo-claim/{endpoint}"[:100]
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)

    def take(self) -> bool:
        """Take it. Returns whether it was free."""
        try:
            self._socket.bind(self._name)  # it is nobody else's until it is closed
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Let the next one have it."""
        self._socket.close()


class _TurnInFolder:
    """A turn of those who may write into the folder of a socket: no stranger can keep it from them."""

    def __init__(self, path: str) -> None:
        self._file: int | None = None
        with suppress(OSError):  # a socket of somebody else's, where nobody takes turns
            self._file = os.open(f"{path}.turn", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)

    def take(self) -> bool:
        """Take it. Returns whether it was free."""
        try:
            if self._file is not None:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Let the next one have it."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def _client(endpoint: str, security: str) -> Network:
    return Network(mode="client", connect=(endpoint,), timeout=ANSWERS_WITHIN, security=security)


def meet(endpoint: str, security: str = "") -> zenoh.Session | None:
    """A session with the router that holds a port of this machine; None where it has just left.

    Args:
        endpoint: where it listens.
        security: the folder of this process's name; empty where security is off.

    Raises:
        PortTaken: it is a program that is no Zenoh router, or a router of another network.
    """
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return open_session(_client(endpoint, security))
        except NetworkError:
            if next(knocking.answering([endpoint], ANSWERS_WITHIN), None) is None:
                return None
            if time.monotonic() > end:
                raise PortTaken(_not_met(endpoint, security)) from None


def _not_met(endpoint: str, security: str) -> str:
    if security:
        from robo.wire import tls  # which most processes do without

        wrong = tls.refused(endpoint, security, ANSWERS_WITHIN)
        if wrong:
            return f"the router at {endpoint} is not joined: {wrong}"
    return port_taken(endpoint)


def declare(session: zenoh.Session, tokens: Sequence[ClaimToken]) -> list[zenoh.LivelinessToken]:
    """Declare claims; they hold as long as what is returned, and the session."""
    return [session.liveliness().declare_token(token.key()) for token in tokens]


def names_in_use(session: zenoh.Session, timeout: float) -> Iterator[Name]:
    """The nodes that run, and those that somebody is going to run, as far as a session sees."""
    for key in (ClaimToken.ALL, NodeToken.ALL):
        for token in map(parse_token, liveliness.ask(session, key, timeout)):
            if isinstance(token, ClaimToken | NodeToken):
                yield token


def told(taken: Sequence[Name]) -> str:
    """Who runs nodes already, in a sentence: `/r1/base runs already (process 17 on host, robot fleet)`."""
    nodes = sorted({token.full_name for token in taken})
    whose = {(t.robot, t.pid, t.host) for t in taken if isinstance(t, ClaimToken)} or {
        ("", t.pid, t.host) for t in taken
    }
    shown = ", ".join(nodes[:3]) + (f" and {len(nodes) - 3} more" if len(nodes) > 3 else "")
    by = "; ".join(
        f"process {pid} on {host}{f', robot {robot}' if robot else ''}" for robot, pid, host in sorted(whose)
    )
    return f"{shown} {'runs' if len(nodes) == 1 else 'run'} already ({by})"


def port_taken(endpoint: str) -> str:
    """That a port is held by a program that is no Zenoh router, and what to do."""
    path = meeting.path_of(endpoint)
    if path is not None:
        return f"the socket {path} is held by a program of yours and no Zenoh answers there\n  stop that program"
    host, number = tcp.address_of(endpoint) or ("", 0)
    return (
        f"port {number} on {host} is taken{tcp.listener(number)} and no Zenoh answers there\n"
        "  stop that program, or choose another port: --listen tcp/127.0.0.1:7448"
    )


def _gives_way(other: Name, run: str) -> bool:
    """Whether another that has a name would give it up: one that claims at the same time, and began later."""
    return isinstance(other, ClaimToken) and other.run > run
