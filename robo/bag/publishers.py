"""Who said what while a recording was made, by the graph that stands in it."""

from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from robo.errors import BagError
from robo.text.readable import readable

if TYPE_CHECKING:
    from robo.bag.read.reader import Bag

GRAPH: Final = "graph.json"
"""The attachment that says which nodes ran and what they were connected with, as `robo graph --json` does."""


class Publishers(NamedTuple):
    """Who said what while it was recorded."""

    nodes: set[str]
    """Full names of all that ran."""
    of: dict[str, set[str]]
    """By topic, full names of those that published it."""


def publishers_of(recording: "Bag") -> Publishers:
    """Who said what, by all that was seen while it was recorded; nobody where it has no such attachment.

    Raises:
        BagError: the attachment cannot be read, or has mistakes.
    """
    found = Publishers(set(), {})
    for file in recording.all_attachments(GRAPH):
        if not file.data:
            continue  # nobody was there to be seen
        try:
            graph = msgspec.json.decode(file.data, type=readable(_Graph))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise BagError(f"its attachment {GRAPH} cannot be read: {error}", recording.path) from None
        found.nodes.update(node.name for node in graph.nodes)
        for topic in graph.topics:
            found.of.setdefault(topic.key, set()).update(topic.publishers)
    return found


class _Node(msgspec.Struct):
    name: str


class _Topic(msgspec.Struct):
    key: str
    publishers: list[str]


class _Graph(msgspec.Struct):
    nodes: list[_Node] = []
    topics: list[_Topic] = []
