"""Who is there: liveliness tokens that name nodes, publishers and subscriptions.

A token is a key that vanishes with its session, however that ends. Its last five chunks are fixed, so
that it can be read whatever the namespace's length; `/` within a chunk is written `%`:

    @robo/<namespace>/node/<node>/<class>/<pid>/<host>%<run>
    @robo/<namespace>/claim/<node>/<robot>/<pid>/<host>%<run>
    @robo/<namespace>/pub/<node>/<type>/<depth>%<id>/<topic key>
    @robo/<namespace>/sub/<node>/<type>/<depth>/<topic key>
    @robo/<namespace>/srv/<node>/<type>/0/<service key>
    @robo/<namespace>/cli/<node>/<type>/0/<service key>

`@` keeps tokens out of `**`. A node declares its node token last: who sees that token knows
everything else about the node, so it says "ready" as well. `<run>` is the id of the run that the node
is part of, by which a supervisor knows its own; a node that is run alone has none. `<id>` is Zenoh's id of
the publisher, which its messages carry: by it a receiver knows whose they are.

Anybody may declare any key: what does not spell a token to the letter is none.
"""

import os
import pwd
import threading
from collections.abc import Iterable
from typing import ClassVar, Literal, get_args

import msgspec
import zenoh

from robo import names

PREFIX = "@robo"
ALL_TOKENS = f"{PREFIX}/**"

EndpointKind = Literal["pub", "sub", "srv", "cli"]
ENDPOINT_KINDS: tuple[EndpointKind, ...] = get_args(EndpointKind)

_MOST_DIGITS = 9
"""Of a number in a key: no process id is longer, and no depth of a topic makes sense beyond."""


class _OfNode(msgspec.Struct, frozen=True):
    namespace: str
    node: str

    @property
    def full_name(self) -> str:
        """The node's, for example `/r1/position_tracker`."""
        return "/" + names.join(self.namespace, self.node)


class NodeToken(_OfNode, frozen=True):
    """A node that is ready."""

    ALL: ClassVar[str] = f"{PREFIX}/**/node/*/*/*/*"

    class_name: str
    pid: int
    host: str
    run: str = ""
    """The id of its run; empty for a node that is run alone."""

    def key(self) -> str:
        """The token's key expression."""
        parts = (self.class_name, str(self.pid), names.join(self.host, self.run))
        return names.join(PREFIX, self.namespace, "node", self.node, *map(_mangle, parts))


class ClaimToken(_OfNode, frozen=True):
    """A node that a process is going to run, or runs: nobody else may."""

    ALL: ClassVar[str] = f"{PREFIX}/**/claim/*/*/*/*"

    robot: str
    """What the run is called; empty for a node that is run alone."""
    pid: int
    """Of the process that starts the node."""
    host: str
    run: str

    def key(self) -> str:
        """The token's key expression."""
        parts = (self.robot, str(self.pid), names.join(self.host, self.run))
        return names.join(PREFIX, self.namespace, "claim", self.node, *map(_mangle, parts))


class EndpointToken(_OfNode, frozen=True):
    """A publisher, a subscription, a service or a client of one."""

    kind: EndpointKind
    type_name: str
    depth: int
    topic: str
    """The key expression."""
    id: str = ""
    """Of a publisher: Zenoh's id of it, as `source_id` makes it."""

    def key(self) -> str:
        """The token's key expression."""
        parts = (self.type_name, names.join(str(self.depth), self.id), self.topic)
        return names.join(PREFIX, self.namespace, self.kind, self.node, *map(_mangle, parts))


Token = NodeToken | ClaimToken | EndpointToken


def parse_token(key: str) -> Token | None:
    """The token that a key spells; None for a key that is no token of robo's."""
    chunks = key.split("/")
    if len(chunks) < 6 or chunks[0] != PREFIX or not all(map(names.is_word, (*chunks[1:-5], chunks[-4]))):
        return None
    namespace = "/".join(chunks[1:-5])
    kind, node = chunks[-5], chunks[-4]
    a, b, c = map(_unmangle, chunks[-3:])
    numeral, _, id_ = b.partition("/")
    number = parse_number(numeral)
    if number is None or not (a + b + c).isprintable():
        return None
    found: Token | None = None
    if kind in ("node", "claim"):
        host, _, run = c.partition("/")
        found = (NodeToken if kind == "node" else ClaimToken)(namespace, node, a, number, host, run)
    for end in ENDPOINT_KINDS:
        if kind == end:
            found = EndpointToken(namespace, node, end, a, number, c, id_)
    return found if found is not None and found.key() == key else None


def parse_number(text: str) -> int | None:
    """A number as robo writes it into a key; None for anything else, `³` and a number without end included."""
    return int(text) if len(text) <= _MOST_DIGITS and text.isascii() and text.isdigit() else None


def source_id(entity: zenoh.EntityGlobalId) -> str:
    """Zenoh's id of a publisher as a word: `<session>:<entity>`."""
    return f"{entity.zid}:{entity.eid}"


def tokens_of_publishers(topic: str) -> str:
    """The key expression of the tokens of all who publish on a topic."""
    return names.join(PREFIX, "**/pub/*/*/*", _mangle(topic))


def tokens(session: zenoh.Session, timeout: float) -> list[NodeToken | EndpointToken]:
    """Every node and every end of a topic or service that this session can see.

    Args:
        session: who asks.
        timeout: how long to wait for routers that do not answer, s.
    """
    replies = session.liveliness().get(ALL_TOKENS, timeout=timeout)
    found = [parse_token(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None]
    return [token for token in found if isinstance(token, NodeToken | EndpointToken)]


def publishers_of(session: zenoh.Session, topic: str, timeout: float) -> list[EndpointToken]:
    """The publishers of a topic that nodes have announced.

    Args:
        session: who asks.
        topic: the key expression.
        timeout: how long to wait for routers that do not answer, s.
    """
    replies = session.liveliness().get(tokens_of_publishers(topic), timeout=timeout)
    found = [parse_token(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None]
    return [token for token in found if isinstance(token, EndpointToken)]


def status_key(namespace: str, node: str) -> str:
    """Where a node answers queries about its counters; `*` asks all nodes of a namespace."""
    return names.join(PREFIX, namespace, "status", node)


def hostname() -> str:
    """This machine's name, as a chunk of a key may hold it."""
    return _as_chunk(os.uname().nodename)


def user() -> str:
    """The name of the user whose process this is, as a chunk of a key may hold it."""
    try:
        return _as_chunk(pwd.getpwuid(os.geteuid()).pw_name)
    except KeyError:  # a number that has no name, as containers have them
        return str(os.geteuid())


def _as_chunk(text: str) -> str:
    return "".join(c if c.isalnum() or c in "._-" else "_" for c in text) or "_"


def wait_for_nodes(session: zenoh.Session, full_names: Iterable[str], timeout: float) -> set[str]:
    """Wait until this session sees each of these nodes ready, and return those it does not see.

    Peers of one robot see a token only over their direct link, where declarations travel in order:
    whoever sees a node's token already knows its subscriptions, and loses no message to it.

    Args:
        session: the session that wants to see them.
        full_names: for example `/r1/position_tracker`.
        timeout: in s.
    """
    wanted = frozenset(full_names)
    if not wanted:
        return set()
    changed = threading.Condition()
    seen: set[str] = set()

    def notice(sample: zenoh.Sample) -> None:
        token = parse_token(str(sample.key_expr))
        if sample.kind == zenoh.SampleKind.PUT and isinstance(token, NodeToken) and token.full_name in wanted:
            with changed:
                seen.add(token.full_name)
                changed.notify()

    subscriber = session.liveliness().declare_subscriber(ALL_TOKENS, notice, history=True)
    with changed:
        changed.wait_for(lambda: seen == wanted, timeout)
        missing = wanted - seen
    subscriber.undeclare()
    return set(missing)


def _mangle(chunk: str) -> str:
    return chunk.replace("/", "%") or "%"


def _unmangle(chunk: str) -> str:
    return "" if chunk == "%" else chunk.replace("%", "/")
