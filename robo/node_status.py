"""What a node tells of itself while it runs."""

import msgspec


class Refused(msgspec.Struct, frozen=True):
    """Messages that a node has left out because another source is the one."""

    sender: str
    """A node's full name, or `a plain Zenoh client`."""
    count: int
    age: float
    """How long ago the last one came, s."""


class NodeStatus(msgspec.Struct, frozen=True):
    """What a node has seen so far; also the reply to a query on its status key."""

    node: str
    """The full name."""
    published: dict[str, int]
    """Messages published, by topic."""
    received: dict[str, int]
    """Messages given to callbacks, by topic."""
    malformed: dict[str, int]
    """Payloads dropped because they were no message of the topic's type, by topic."""
    dropped: dict[str, int]
    """Messages dropped because the callback fell behind, by topic."""
    callback_errors: int
    """Exceptions that callbacks raised."""
    refused: dict[str, list[Refused]] = {}
    """Whose messages were left out because another source is the one, by topic."""
    missed: dict[str, int] = {}
    """Ticks that timers skipped because callbacks took too long, by the timer's callback."""
    served: dict[str, int] = {}
    """Calls answered, by service."""
    uptime: float = 0.0
    """How long the node has been running, s."""
    busy: float = 0.0
    """How long its callbacks have run, the one that runs and waiting for services included, s."""
    running: str = ""
    """The callback that runs just now; empty where none does."""
    running_for: float = 0.0
    """How long it has been running, s. One that does not return holds up all others of the node."""
    zid: str = ""
    """The id of its Zenoh session; only in the reply to a query."""
    links: list[str] = []
    """The ids of the Zenoh sessions to which it is linked; only in the reply to a query."""
    time: int = 0
    """The node's wall clock, ns since the epoch; only in the reply to a query."""
