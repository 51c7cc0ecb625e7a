"""Who is there, in both networks: what tokens tell, known at once by any thread, and told on in order by one."""

import queue
import threading
import time
from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from typing import Any

import zenoh

from robo.bridges.ros2 import tokens
from robo.bridges.ros2.gids import gid_of
from robo.bridges.ros2.scope import BRIDGES, NODE, who_of
from robo.wire import keys, liveliness
from robo.wire.keys import ALL_TOKENS, EndpointToken

MOST_TOKENS = 20_000
"""Of one network that are known."""

RoboToken = keys.NodeToken | EndpointToken
RosToken = tokens.NodeToken | tokens.EndToken


class Presence:
    """What is known of both networks by their tokens."""

    def __init__(
        self,
        robo: zenoh.Session,
        ros: zenoh.Session,
        domain: int,
        tell_robo: Callable[[RoboToken, bool], None],
        tell_ros: Callable[[RosToken, bool], None],
        tell_alone: Callable[[str, bool], None],
    ) -> None:
        """
        Args:
            robo, ros: the networks.
            domain: of ROS's graph.
            tell_robo: gets each token of a node or an end of robo's, and whether it is there; called by Zenoh's
                threads, and does not wait.
            tell_ros: the same of ROS's.
            tell_alone: the same of the full names of robo's nodes that speak in ROS for themselves.
        """
        self._tell_robo, self._tell_ros, self._tell_alone = tell_robo, tell_ros, tell_alone
        self._own = str(ros.info.zid())
        self._lock = threading.Lock()
        self._robo: dict[str, RoboToken] = {}
        self._ros: dict[str, RosToken] = {}
        self._bridges: set[str] = {self._own}
        self._alone: dict[str, str] = {}
        """By session, the full name of the node that speaks for itself there."""
        self._publishers: dict[str, EndpointToken] = {}
        self._brought: dict[str, str] = {}
        """By the ids of the publishers of bridges, their topics."""
        self._ends: dict[bytes, tokens.EndToken] = {}
        at_once: Any = zenoh.handlers.Callback
        watch = [
            (ros, BRIDGES, self._meet_bridge),
            (ros, f"{tokens.PREFIX}/{domain}/**", self._meet_ros),
            (robo, ALL_TOKENS, self._meet_robo),
        ]
        self._watching = [liveliness.hear(session, key, at_once(meet, indirect=False)) for session, key, meet in watch]

    def publisher(self, source: str) -> EndpointToken | None:
        """The token of a publisher of robo's, by its id."""
        return self._publishers.get(source)

    def end(self, gid: bytes) -> tokens.EndToken | None:
        """The token of an end of ROS's, by its id."""
        return self._ends.get(gid)

    def is_of_bridge(self, session: str) -> bool:
        """Whether a session in ROS's network is this bridge's or another one's."""
        return session in self._bridges

    def is_alone(self, full_name: str) -> bool:
        """Whether a node of robo's speaks in ROS for itself, by another session than this one."""
        return full_name in self._alone.values()

    def is_brought(self, topic: str) -> bool:
        """Whether a bridge brings a topic from ROS to robo."""
        return topic in self._brought.values()

    def robo_of(self, full_name: str) -> list[RoboToken]:
        """The tokens of a node of robo's: its ends, and the node itself."""
        with self._lock:
            return [one for one in self._robo.values() if one.full_name == full_name]

    def ros_ends(self) -> list[tokens.EndToken]:
        """All ends of ROS's own."""
        with self._lock:
            found = [one for one in self._ros.values() if isinstance(one, tokens.EndToken)]
        return [one for one in found if not self.is_of_bridge(one.node.session)]

    def robo_ends(self) -> list[EndpointToken]:
        """All ends of robo's."""
        with self._lock:
            return [one for one in self._robo.values() if isinstance(one, EndpointToken)]

    def close(self) -> None:
        """Look no more."""
        for one in self._watching:
            one.undeclare()

    def _meet_bridge(self, sample: zenoh.Sample) -> None:
        session, node = who_of(str(sample.key_expr))
        is_there = sample.kind == zenoh.SampleKind.PUT
        if is_there and len(self._bridges) < MOST_TOKENS:
            self._bridges.add(session)
            if node and session != self._own:
                self._alone[session] = node
                self._tell_alone(node, True)
        elif not is_there and self._alone.pop(session, None) is not None:
            self._tell_alone(node, False)

    def _meet_ros(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        token = tokens.parse(key)
        is_there = sample.kind == zenoh.SampleKind.PUT
        if token is None or not self._changes(self._ros, key, token, is_there):
            return
        if isinstance(token, tokens.EndToken) and token.kind in ("MP", "SC"):
            if is_there:
                self._ends[gid_of(key)] = token
            else:
                self._ends.pop(gid_of(key), None)
        self._tell_ros(token, is_there)

    def _meet_robo(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        token = keys.parse_token(key)
        is_there = sample.kind == zenoh.SampleKind.PUT
        if not isinstance(token, keys.NodeToken | EndpointToken) or not self._changes(self._robo, key, token, is_there):
            return
        if isinstance(token, EndpointToken) and token.kind == "pub" and token.id:
            self._meet_publisher(token, is_there)
        self._tell_robo(token, is_there)

    def _meet_publisher(self, token: EndpointToken, is_there: bool) -> None:
        if is_there:
            self._publishers[token.id] = token
        else:
            self._publishers.pop(token.id, None)
        if token.node == NODE:
            with self._lock:  # others read it as a whole
                brought = {**self._brought, token.id: token.topic}
                if not is_there:
                    del brought[token.id]
                self._brought = brought

    def _changes(self, known: dict[str, Any], key: str, token: object, is_there: bool) -> bool:
        with self._lock:
            if is_there:
                if key in known or len(known) >= MOST_TOKENS:
                    return False
                known[key] = token
                return True
            return known.pop(key, None) is not None


class Steward:
    """A thread that does one thing after the other, some of them later: what declares anything is done here."""

    def __init__(self, failed: Callable[[BaseException], None]) -> None:
        """`failed` is told what a piece of work has raised."""
        self._failed = failed
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._later: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()
        self._thread = threading.Thread(target=self._run, name="robo-ros2-steward", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def do(self, work: Callable[[], None]) -> None:
        """Have something done, in order."""
        self._work.put(work)

    def do_later(self, seconds: float, work: Callable[[], None]) -> None:
        """Have something done after some time. For work that runs here."""
        heappush(self._later, (time.monotonic() + seconds, next(self._order), work))

    def close(self) -> None:
        """Do nothing more."""
        self._work.put(None)
        self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            wait = max(0.0, self._later[0][0] - time.monotonic()) if self._later else None
            try:
                work = self._work.get(timeout=wait)
            except queue.Empty:
                work = heappop(self._later)[2]
            if work is None:
                return
            try:
                work()
            except Exception as error:  # what a stranger's token brings about ends no bridge
                self._failed(error)
