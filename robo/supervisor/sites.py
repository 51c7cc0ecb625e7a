"""The sites that a robot was told to dial: whether its router is linked to each, and why not."""

import asyncio
import ipaddress
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Protocol

import msgspec
import zenoh

from robo.wire import admin, tcp
from robo.wire.admin import RouterSession
from robo.wire.reports import Site

_PERIOD = 1.0
"""How often the router is asked for its links, s."""
_PATIENCE = 3.0
"""How long a link may take where somebody answers, s."""
_ANSWERS_WITHIN = 1.0


class Journal(Protocol):
    """Where changes are told."""

    def say(self, text: str) -> None:
        """Tell what people may want to know."""

    def warn(self, text: str) -> None:
        """Tell what went wrong."""


class Sites:
    """Watches over the links of one robot's router to its sites."""

    def __init__(self, robot: str, endpoints: Sequence[str], journal: Journal, security: str = "") -> None:
        """
        Args:
            robot: what the run is called.
            endpoints: of the sites.
            journal: is told of what changes.
            security: the folder of the name that the robot has there; empty where security is off.
        """
        self.all = {endpoint: Site(robot, endpoint, reached=False, since=time.time_ns()) for endpoint in endpoints}
        """By endpoint."""
        self._journal = journal
        self._security = security
        self._begin = time.monotonic()

    def note(self, unreached: Mapping[str, OSError]) -> None:
        """Somebody has tried to reach them already."""
        for endpoint in self.all.keys() & unreached.keys():
            self._change(endpoint, reached=False, reason=tcp.reason(unreached[endpoint]))

    async def watch(self, session: zenoh.Session) -> None:
        """Ask the router again and again, for as long as the run lasts.

        Args:
            session: a client of the robot's router.
        """
        while self.all:
            linked = await asyncio.to_thread(admin.linked_to, session, _ANSWERS_WITHIN)
            for endpoint in self.all if linked is not None else ():
                await self._look_at(endpoint, linked or [])
            await asyncio.sleep(_PERIOD)

    async def _look_at(self, endpoint: str, linked: Sequence[RouterSession]) -> None:
        before = self.all[endpoint]
        if await asyncio.to_thread(is_among, endpoint, linked):
            self._change(endpoint, reached=True, reason="")
        elif before.reached or before.reason or time.monotonic() - self._begin > _PATIENCE:
            tried = await asyncio.to_thread(lambda: dict(tcp.tried([endpoint], _ANSWERS_WITHIN)))
            wrong = tried.get(endpoint, TimeoutError())
            if wrong is not None:
                self._change(endpoint, reached=False, reason=tcp.reason(wrong))
            elif not before.reached:  # else it is just linking again
                self._change(endpoint, reached=False, reason=await asyncio.to_thread(self._refusal, endpoint))

    def _refusal(self, endpoint: str) -> str:
        """Why a site at which somebody listens is not linked."""
        said = ""
        if self._security:
            from robo.wire import tls  # which most processes do without

            said = tls.refused(endpoint, self._security, _ANSWERS_WITHIN)
        return said or "what listens there does not speak Zenoh, or refuses"

    def _change(self, endpoint: str, *, reached: bool, reason: str) -> None:
        before = self.all[endpoint]
        self.all[endpoint] = msgspec.structs.replace(
            before, reached=reached, reason=reason, since=before.since if reached == before.reached else time.time_ns()
        )
        goes_on = "the robot runs without it, and links to it when it answers"
        if reached and not before.reached:
            self._journal.say(f"{endpoint} is reached")
        elif before.reached and not reached:
            self._journal.warn(f"{endpoint} is lost: {reason}; {goes_on}")
        elif not reached and not before.reason:
            self._journal.warn(f"{endpoint} is not reached: {reason}; {goes_on}")


def is_among(endpoint: str, linked: Sequence[RouterSession]) -> bool:
    """Whether an endpoint is the far end of one of some links: the same address, or a router of the same host.

    The latter where the site has dialled this robot too: then there is one link, and either end may have made it.
    """
    protocol, _, rest = endpoint.partition("/")
    host, _, port = rest.partition("?")[0].partition("#")[0].rpartition(":")
    try:
        hosts = {str(found[4][0]).partition("%")[0] for found in socket.getaddrinfo(host.strip("[]"), None)}
    except (OSError, UnicodeError):
        return False
    for other in linked:
        for link in other.links:
            there, _, other_port = link.dst.partition("/")[2].rpartition(":")
            there = there.strip("[]").partition("%")[0]
            if there in hosts and link.dst.startswith(f"{protocol}/"):
                same_host = other.whatami == "router" and not ipaddress.ip_address(there).is_loopback
                if other_port == port or same_host:
                    return True
    return False
