"""Why a router has refused somebody: a sentence for its owner, from a line of Zenoh's log. Pure.

Zenoh (1.10) tells nobody but its log whom it refuses: certificates at WARN, and what the rules refuse at TRACE, beside
two lines for each message that passes. Of the latter only those are meant that say what was really refused: whenever a
key is declared, Zenoh also writes down all that *would* be refused on it.
"""

import re
from collections import deque
from typing import NamedTuple

import msgspec

from robo.wire.keys import ACTS, PREFIX
from robo.wire.names import shown_key

LOG_FILTER = "error,zenoh_link_commons=warn,zenoh_link_tls=debug,zenoh::net::routing::interceptor::access_control=trace"
"""What Zenoh has to write down for that."""

INTERESTING = (b"unauthorized", b"caching", b"zenoh_link", b"did not match")
"""A piece of the log without any of these words needs no look: nearly all of it, on a busy router."""

_LINE = re.compile(r"^\S+\s+(?P<level>[A-Z]+)\s+(?P<thread>.*?ThreadId\(\d+\))\s+(?P<target>[\w:]+): (?P<text>.*)$")
_DENIED = re.compile(
    r"(?P<cached>Using cached result: )?(?P<zid>[0-9a-f]+)(?P<who> on \S+)? is unauthorized to "
    r"(?P<what>.+?) \((?P<flow>ingress|egress)\) on (?P<key>\S+)$"
)
_NAME = re.compile(r"CertCommonName\((.*?)\)")
_ACCEPTED = re.compile(r"Accepted TLS connection.*Common Name: (\w+)")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")

_ACTIONS = {
    "Put": "publish",
    "Delete": "delete what is said on",
    "Query": "call",
    "Reply": "answer on",
    "Declare Subscriber": "subscribe to",
    "Declare Queryable": "serve",
    "Liveliness Token": "announce",
    "Declare Liveliness Token": "announce",
}
"""What people call what Zenoh refuses. That somebody may not see who is there, is no attempt at anything."""

_CERTIFICATES = (
    ("peer sent no certificates", "certificate", "somebody without a certificate"),
    ("UnknownIssuer", "certificate", "somebody whose certificate is of another CA"),
    ("certificate expired", "certificate", "somebody whose certificate has expired"),
    ("not valid yet", "certificate", "somebody whose certificate is not valid yet: does a clock go wrong?"),
    ("extended key usage", "certificate", "somebody whose certificate is not one for dialling"),
    ("invalid peer certificate", "certificate", "somebody whose certificate is not accepted"),
    ("alert: UnknownCA", "name", "somebody who takes this router for one of another network"),
    ("alert: BadCertificate", "name", "somebody who dials this router by a name that its certificate does not have"),
    ("alert: CertificateExpired", "certificate", "somebody for whom this router's own certificate has expired"),
    ("alert: CertificateUnknown", "name", "somebody who does not accept this router's certificate"),
    ("corrupt message", "certificate", "somebody who does not speak TLS"),
    ("certificate chain expired", "certificate", "somebody who was linked until his certificate expired"),
)


_LAST = "Declare Liveliness Subscriber"
"""What Zenoh writes down last of all that would be refused on a key, in one direction."""


class Refusal(NamedTuple):
    """Something that was refused."""

    kind: str
    """`certificate`, `name` or `rights`."""
    who: str
    """Of whom the certificate is; empty where there is none."""
    sentence: str


class Reader:
    """Reads the log of one router, line by line."""

    def __init__(self) -> None:
        self.known: frozenset[str] = frozenset()
        """The names that the rules know."""
        self._names: dict[str, str] = {}
        self._would_be: dict[str, str] = {}
        """By thread, the key of which it is just written down what would be refused."""
        self._accepted: deque[str] = deque(maxlen=20)
        """Whose certificates were accepted last: that somebody has no place in the rules is told without a name."""

    def read(self, line: str) -> Refusal | None:
        """What a line says was refused; None for any other."""
        found = _LINE.match(_COLOUR.sub("", line.strip()))
        if found is None:
            return None
        text, thread = found["text"], found["thread"]
        if found["target"].startswith("zenoh_link"):
            accepted = _ACCEPTED.search(text)
            if accepted is not None:
                self._accepted.append(accepted[1])
            return _of_certificate(text) if found["level"] in ("WARN", "ERROR") else None
        if "caching permissions" in text:
            self._would_be[thread] = text.partition("`")[2].partition("`")[0]
            return None
        if "did not match any" in text:
            who = next((name for name in reversed(self._accepted) if name not in self.known), "")
            self._names[text.partition(" ")[0]] = who
            whose = f"{who}, who is not in the policy" if who else "somebody who is not in the policy"
            return Refusal("rights", who, f"{whose}, is linked and may do nothing" if who else f"{whose} is linked")
        denied = _DENIED.match(text)
        return self._of_rights(denied, thread) if denied is not None else None

    def _of_rights(self, denied: re.Match[str], thread: str) -> Refusal | None:
        if denied["who"] is not None and (name := _NAME.search(denied["who"])) is not None:
            self._names[denied["zid"]] = name[1]
        if denied["cached"] is None and self._would_be.get(thread) == denied["key"]:
            if denied["what"] == _LAST:
                del self._would_be[thread]
            return None
        action = _ACTIONS.get(denied["what"])
        if action is None or denied["flow"] == "egress" or _is_of_routers(denied["what"], denied["key"]):
            return None
        who = self._names.get(denied["zid"], "")
        return Refusal("rights", who, f"{who or 'somebody'} may not {_done(action, denied['key'])}")


def _done(action: str, key: str) -> str:
    """What was to be done, for people."""
    command = _COMMAND.fullmatch(key)
    if command is not None and action == "call" and command["verb"] in ACTS:
        return f"{command['verb']} what runs of {command['robot']}"
    if key.startswith("@/") and action == "call":
        return "ask what routers say of themselves"
    return f"{action} {shown_key(key)}"


_COMMAND = re.compile(rf"{PREFIX}/(?P<robot>.+)/supervisor/(?P<verb>\w+)")


def _is_of_routers(what: str, key: str) -> bool:
    """Whether it is what each router says of itself to all others, without being asked to."""
    return key.startswith("@/") and what.startswith("Declare")


def _of_certificate(text: str) -> Refusal | None:
    for word, kind, whom in _CERTIFICATES:
        if word in text:
            return Refusal(kind, "", f"{whom} was refused")
    return None


class Count(msgspec.Struct):
    """How often something was refused."""

    kind: str
    who: str
    sentence: str
    count: int
    last: int
    """ns since the epoch."""


class Tally:
    """Counts refusals, and says when one is worth telling: the first time, and then once in a while."""

    AGAIN = 60.0
    """After how long one that goes on is told again, s."""
    MOST = 500
    """How many different ones are kept: who makes up keys must not fill the memory."""
    BURST = 100
    """How many different ones are told within `AGAIN`."""

    def __init__(self) -> None:
        self.counts: dict[Refusal, Count] = {}
        self.others = 0
        """Those that are not kept one by one."""
        self._told: dict[Refusal, tuple[float, int]] = {}
        self._burst: list[float] = []

    def add(self, refusal: Refusal, now: float, wall: int) -> str | None:
        """One was refused.

        Args:
            refusal: what.
            now: a clock that is never set, s.
            wall: the time of day, ns since the epoch.

        Returns:
            What the owner is to be told, if anything.
        """
        count = self.counts.get(refusal)
        if count is None:
            if len(self.counts) >= self.MOST:
                self.others += 1
                return None
            count = self.counts[refusal] = Count(refusal.kind, refusal.who, refusal.sentence, 0, wall)
        count.count += 1
        count.last = wall
        told, before = self._told.get(refusal, (-self.AGAIN, 0))
        self._burst = [at for at in self._burst if now - at < self.AGAIN]
        if now - told < self.AGAIN or len(self._burst) >= self.BURST:
            return None
        self._told[refusal] = (now, count.count)
        self._burst.append(now)
        more = count.count - before - 1
        return f"{refusal.sentence}{f' ({more} times more since)' if before and more else ''}"

    def listed(self) -> list[Count]:
        """All of them, the most frequent first."""
        found = sorted(self.counts.values(), key=lambda one: (-one.count, one.sentence))
        return [*found, Count("rights", "", "others", self.others, 0)] if self.others else found
