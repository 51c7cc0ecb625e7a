"""What the bridge announces in ROS's graph: nodes and ends, on behalf of those in robo, each once."""

import itertools
import threading
from typing import Any

import zenoh

from robo.bridges.ros2.gids import gid_of
from robo.bridges.ros2.quality import RosQoS
from robo.bridges.ros2.scope import Scope
from robo.bridges.ros2.tokens import EndToken, Kind, NodeToken
from robo.wire import names


class Announced:
    """All that is announced. Any thread may use it."""

    def __init__(self, session: zenoh.Session, domain: int, scope: Scope) -> None:
        """
        Args:
            session: ROS's network.
            domain: of the graph.
            scope: on whose behalf.

        Raises:
            RunError: the library that makes ids is missing.
        """
        self.domain = domain
        self.session_id = str(session.info.zid())
        self._liveliness = session.liveliness()
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._nodes: dict[str, tuple[NodeToken, Any]] = {}
        self._ends: dict[tuple[str, Kind, str, str], tuple[EndToken, bytes, Any]] = {}
        self.gids: set[bytes] = set()
        """The ids of its ends: what bears one has come from here."""
        gid_of("")
        self._own = self._liveliness.declare_token(scope.key(self.session_id))

    def node(self, full_name: str) -> NodeToken:
        """Announce a node, once."""
        with self._lock:
            return self._node(full_name)

    def end(self, node: str, kind: Kind, topic: str, type_: str, hash_: str, quality: RosQoS) -> bytes:
        """Announce an end, once, and its node.

        Args:
            node: the full name of its node.
            kind: what it is.
            topic: the full name of the topic or service, without its leading slash.
            type_: as DDS has it.
            hash_: of the type.
            quality: that it promises or wants.

        Returns:
            Its id.
        """
        which = (node, kind, topic, type_)
        with self._lock:
            found = self._ends.get(which)
            if found is None:
                token = EndToken(self._node(node), next(self._numbers), kind, topic, type_, hash_, quality)
                gid = gid_of(token.key())
                self.gids.add(gid)
                found = self._ends[which] = token, gid, self._liveliness.declare_token(token.key())
            return found[1]

    def withdraw_end(self, node: str, kind: Kind, topic: str, type_: str) -> None:
        """Announce an end no more. Its id stays known: what it has said may still be on its way."""
        with self._lock:
            found = self._ends.pop((node, kind, topic, type_), None)
            if found is not None:
                found[2].undeclare()

    def withdraw_node(self, full_name: str) -> None:
        """Announce a node no more, nor its ends."""
        with self._lock:
            for which in [one for one in self._ends if one[0] == full_name]:
                self._ends.pop(which)[2].undeclare()
            found = self._nodes.pop(full_name, None)
            if found is not None:
                found[1].undeclare()

    def counts(self) -> tuple[int, int]:
        """How many nodes, and how many ends."""
        with self._lock:
            return len(self._nodes), len(self._ends)

    def close(self) -> None:
        """Withdraw all."""
        with self._lock:
            for *_, end in self._ends.values():
                end.undeclare()
            for _, node in self._nodes.values():
                node.undeclare()
            self._ends.clear()
            self._nodes.clear()
            self._own.undeclare()

    def _node(self, full_name: str) -> NodeToken:
        found = self._nodes.get(full_name)
        if found is None:
            namespace, name = names.split(full_name)
            token = NodeToken(self.domain, self.session_id, next(self._numbers), namespace, name)
            found = self._nodes[full_name] = token, self._liveliness.declare_token(token.key())
        return found[0]
