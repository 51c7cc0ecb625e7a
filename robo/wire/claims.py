"""Two nodes of one name would drive one robot: whoever starts nodes claims their names before, and gives way.

A claim is a liveliness token for each node. It is declared wherever the network is met already, before anything of
the run starts; then the names that others claim or use are looked up. Of two that declare at once, either sees the
other, and the run whose id is the smaller has the names. Where nobody is met yet, two on one machine would not see
each other: they take turns, by a lock for each endpoint at which they would meet.
"""

import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress

import zenoh

from robo.errors import NetworkError
from robo.wire import names, tcp
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
        self._own = [place for endpoint in network.listen if (place := tcp.nearby(endpoint)) is not None]
        self._dialled = list(dict.fromkeys((*network.connect, *self._own)))
        self._turns: list[socket.socket] = []
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
        """
        try:
            return self._take()
        except BaseException:
            self.close()
            raise

    def _take(self) -> list[Name]:
        self._wait_for_turn()
        tried = dict(tcp.tried(self._dialled, ANSWERS_WITHIN))
        for endpoint in self._dialled:
            if tcp.address_of(endpoint) is None:
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
                    shows = not self._own or next(tcp.answering(self._own, ANSWERS_WITHIN), None) is not None
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
            return meet(endpoint)
        try:
            return open_session(Network(mode="client", connect=(endpoint,), timeout=ANSWERS_WITHIN))
        except NetworkError:
            return None

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
            turn = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._turns.append(turn)
            while time.monotonic() < end:
                with suppress(OSError):
                    turn.bind(f"\0robo-claim/{endpoint}"[:100])  # it is nobody else's until it is closed
                    break
                time.sleep(0.01)

    def _end_turn(self) -> None:
        with suppress(IndexError):
            while self._turns:
                self._turns.pop().close()


def meet(endpoint: str) -> zenoh.Session | None:
    """A session with the router that holds a port of this machine; None where it has just left.

    Raises:
        PortTaken: it is a program that is no Zenoh router.
    """
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return open_session(Network(mode="client", connect=(endpoint,), timeout=ANSWERS_WITHIN))
        except NetworkError:
            if next(tcp.answering([endpoint], ANSWERS_WITHIN), None) is None:
                return None
            if time.monotonic() > end:
                raise PortTaken(port_taken(endpoint)) from None


def declare(session: zenoh.Session, tokens: Sequence[ClaimToken]) -> list[zenoh.LivelinessToken]:
    """Declare claims; they hold as long as what is returned, and the session."""
    return [session.liveliness().declare_token(token.key()) for token in tokens]


def names_in_use(session: zenoh.Session, timeout: float) -> Iterator[Name]:
    """The nodes that run, and those that somebody is going to run, as far as a session sees."""
    for key in (ClaimToken.ALL, NodeToken.ALL):
        for reply in session.liveliness().get(key, timeout=timeout):
            token = parse_token(str(reply.ok.key_expr)) if reply.ok is not None else None
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
    host, number = tcp.address_of(endpoint) or ("", 0)
    return (
        f"port {number} on {host} is taken{tcp.listener(number)} and no Zenoh answers there\n"
        "  stop that program, or choose another port: --listen tcp/127.0.0.1:7448"
    )


def _gives_way(other: Name, run: str) -> bool:
    """Whether another that has a name would give it up: one that claims at the same time, and began later."""
    return isinstance(other, ClaimToken) and other.run > run
