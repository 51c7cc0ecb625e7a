"""A run on the network: that it shows itself, holds its names, and knows its own nodes from those of others."""

import asyncio
import os
import time
from collections.abc import Callable, Mapping
from functools import partial
from itertools import chain
from typing import Protocol

import zenoh

from robo.errors import NetworkError
from robo.launch.plan import ProcessPlan
from robo.supervisor.changes import Changes
from robo.text.brief import shown
from robo.wire import claims, discovery, keys, liveliness
from robo.wire.keys import ClaimToken, NodeToken, SupervisorToken, parse_supervisor_token
from robo.wire.network import OWN_ROUTER_WITHIN, Network
from robo.wire.session import close_session, open_session

_LONGEST_SHOWN = 120
"""How much is shown of a key that a stranger has made."""


class Process(Protocol):
    """What of a process shows on the network."""

    @property
    def plan(self) -> ProcessPlan:
        """How it is run."""

    def owns(self, pid: int) -> bool:
        """Whether a process is its child, or was started by it."""

    def leads(self, pid: int) -> bool:
        """Whether a process of this machine is its child, or in its process group."""

    def notice_token(self, pid: int) -> None:
        """The node's liveliness token shows."""

    def notice_token_gone(self, pid: int) -> None:
        """It shows no more."""


class Journal(Protocol):
    """Where trouble is told."""

    def warn(self, text: str) -> None:
        """Tell what went wrong."""


class Stopping(Protocol):
    """What ends the run."""

    def finish(self, exit_code: int | None) -> None:
        """End the run."""


class Presence:
    """One run as others see it, and the nodes of others as it sees them."""

    def __init__(
        self,
        robot: str,
        host: str,
        claim: claims.Claim,
        processes: Mapping[str, Process],
        changes: Changes,
        journal: Journal,
        stopping: Stopping,
    ) -> None:
        """
        Args:
            robot: what the run is called.
            host: whose part of the manifest it runs; empty for all of it.
            claim: of the names of its nodes.
            processes: of the run, by full name.
            changes: is notified when a node of others comes.
            journal: is told of who is in the way.
            stopping: ends the run where it has to give way.
        """
        self.session: zenoh.Session | None = None
        """A client of the robot's router, once the run has joined the network."""
        self.elsewhere: dict[str, set[NodeToken]] = {}
        """The tokens of nodes that others run, by full name, as long as they are ready."""
        self._robot = robot
        self._host = host
        self._claim = claim
        self._processes = processes
        self._changes = changes
        self._journal = journal
        self._stopping = stopping
        self._claimed: dict[str, zenoh.LivelinessToken] = {}
        """By full name, what keeps others from running a node of that name."""
        self._settled = False
        """Whether others see these."""
        self._gathers_until = 0.0
        """When robots that were linking anew as this run began have been seen, by the monotonic clock, s."""
        self._given_way = False
        self._unreadable = 0
        """Tokens that spell nothing."""
        self._token = ""
        self._shown: zenoh.LivelinessToken | None = None

    # -- before the start ------------------------------------------------------------------------

    async def may_start(self) -> bool:
        """Claim the names. Where others have them, that is told, and the run ends."""
        refusal = await asyncio.to_thread(self.refusal)
        if refusal is None:
            return True
        for line in refusal.splitlines():
            self._journal.warn(line)
        self._stopping.finish(1)
        return False

    def refusal(self) -> str | None:
        """Why this run may not start, where others have its names or its port, in words; else they are its own.

        It takes a while: not for the loop.
        """
        try:
            taken = self._claim.take()
        except NetworkError as error:
            return str(error)
        key = keys.supervisors_key(self._robot)
        found = chain.from_iterable(
            liveliness.ask(session, key, claims.ANSWERS_WITHIN) for session in self._claim.sessions
        )
        same = [token for token in map(parse_supervisor_token, found) if token is not None and self._is_same(token)]
        if same:
            runs = f"{self._robot} runs already (process {same[0].pid} on {same[0].machine})"
        elif taken:
            runs = claims.told(taken)
        else:
            return None
        return _advised(runs)

    def _is_same(self, other: SupervisorToken) -> bool:
        """Whether it runs the same: another host's part of the robot may run beside this one."""
        return not (other.part and self._host and other.part != self._host)

    # -- joining and leaving ---------------------------------------------------------------------

    async def join(self, endpoint: str) -> zenoh.Session:
        """Claim the names in the robot's own network, and learn from tokens who is there.

        Args:
            endpoint: of the robot's router.

        Raises:
            NetworkError: it cannot be reached.
        """
        loop = asyncio.get_running_loop()
        network = Network(mode="client", connect=(endpoint,), timeout=OWN_ROUTER_WITHIN)
        session = self.session = await asyncio.to_thread(open_session, network)

        def notice(sample: zenoh.Sample) -> None:
            work = self.reaction(str(sample.key_expr), there=sample.kind == zenoh.SampleKind.PUT)
            if work is not None:
                loop.call_soon_threadsafe(work)

        self._claimed = dict(zip(self._processes, claims.declare(session, self._claim.tokens), strict=True))
        liveliness.hear(session, keys.ALL_TOKENS, notice)
        return session

    def show(self) -> None:
        """Let others see that the run is there, and can be asked."""
        assert self.session is not None
        host, user = discovery.hostname(), discovery.user()
        token = SupervisorToken(self._robot, os.getpid(), host, self._host, str(self.session.zid()), user)
        self._token = token.key()
        self._shown = self.session.liveliness().declare_token(self._token)

    async def settle(self) -> None:
        """Hold the names until others see the tokens of this run's own session."""
        await asyncio.to_thread(self._claim.settle, self._is_seen)
        self._gathers_until = time.monotonic() + self._claim.gathers_for()
        self._settled = True

    def _is_seen(self, session: zenoh.Session) -> bool:
        return next(liveliness.ask(session, self._token, claims.ANSWERS_WITHIN), None) is not None

    async def leave(self) -> None:
        """Leave the network."""
        if self.session is not None:
            await asyncio.to_thread(close_session, self.session)

    # -- names that come and go with the manifest ------------------------------------------------

    async def claim(self, name: str) -> str | None:
        """Claim a name that the run has not had so far.

        Returns:
            Who has it, in words, where somebody does: then the run does not have it.
        """
        if self.session is None:
            return None
        (self._claimed[name],) = claims.declare(self.session, [self._claim.token_of(name)])
        taken = await asyncio.to_thread(self._claim.others_with, self.session, name)
        if not taken:
            return None
        self.release(name)
        return claims.told(taken)

    def release(self, name: str) -> None:
        """Others may have a name from now on."""
        if name in self._claimed:
            self._claimed.pop(name).undeclare()

    # -- who is there ----------------------------------------------------------------------------

    def reaction(self, key: str, *, there: bool) -> Callable[[], None] | None:
        """What is to be done in the loop where a liveliness token has come, or has gone; None for nothing."""
        token = keys.parse_token(key)
        if isinstance(token, NodeToken):
            return partial(self._on_node if there else self._on_node_gone, token)
        if isinstance(token, ClaimToken) and there:
            return partial(self._on_claim, token)
        if token is None and there and parse_supervisor_token(key) is None:
            return partial(self._on_unreadable, key)
        return None

    def _on_node(self, token: NodeToken) -> None:
        process = self._processes.get(token.full_name)
        if process is None:
            self.elsewhere.setdefault(token.full_name, set()).add(token)
            self._changes.notify()
        elif self._is_of(process, token):
            process.notice_token(token.pid)
        elif not self._yields(token):
            self._journal.warn(f"another {token.full_name} has come up (process {token.pid} on {token.host})")

    def _on_node_gone(self, token: NodeToken) -> None:
        process = self._processes.get(token.full_name)
        if process is not None and self._is_of(process, token):
            process.notice_token_gone(token.pid)
        same = self.elsewhere.get(token.full_name, set())
        same.discard(token)
        if not same:  # strangers make up names without end
            self.elsewhere.pop(token.full_name, None)

    def _on_claim(self, token: ClaimToken) -> None:
        if token.full_name in self._processes and token.run != self._claim.run:
            self._yields(token)

    def _yields(self, token: NodeToken | ClaimToken) -> bool:
        """Give way to another that has a node's name and began earlier, where this run could not see it at its start.

        That is while both begin at once, and while robots link anew. One that began later has seen the claims of this
        run, and gives way itself.
        """
        is_late = self._settled and not (token.run and time.monotonic() < self._gathers_until)
        if is_late or token.run > self._claim.run:
            return False
        if not self._given_way:
            self._given_way = True
            self._journal.warn(_advised(claims.told([token])))
            self._stopping.finish(1)
        return True

    def _is_of(self, process: Process, token: NodeToken) -> bool:
        """Whether a token is that of a process of the run, which may not even be known to have started."""
        here = token.host == discovery.hostname()
        if token.run == self._claim.run:
            shared = process.plan.process
            others = (
                other
                for other in self._processes.values()
                if other is not process and (shared is None or other.plan.process != shared)
            )
            return not (here and any(other.leads(token.pid) for other in others))
        # What empties its environment, as sudo does, has lost the run's id.
        return not token.run and here and process.owns(token.pid)

    def _on_unreadable(self, key: str) -> None:
        self._unreadable += 1
        if self._unreadable == 1:
            what = shown(key, _LONGEST_SHOWN)
            self._journal.warn(f"ignoring a liveliness token that means nothing here, and others like it: {what}")


def _advised(runs: str) -> str:
    return f"{runs}; stop it with `robo down` or choose another --robot-name"
