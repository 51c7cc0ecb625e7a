"""Nodes of ROS 2 as rmw_zenoh puts them on the wire, by its description alone, and a bridge to them."""

import queue
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from typing import Any

import xxhash
import zenoh
from zenoh import ext

from robo import Node, subscribe
from robo.bridges.ros2.bridge import Bridge
from robo.bridges.ros2.claim import give_way
from robo.bridges.ros2.networks import join_ros
from robo.interfaces import cdr
from robo.interfaces.ros_names import full_name
from robo.interfaces.type_hash import type_hash
from robo.launch.plan import Ros2Plan
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import type_name
from tests.conftest import free_port
from tests.support import PATIENCE, eventually


def dds(ros: str) -> str:
    package, folder, name = ros.split("/")
    return f"{package}::{folder}::dds_::{name}_"


class RosNode:
    """A node, with a session of its own."""

    def __init__(self, endpoint: str, name: str = "talker", namespace: str = "", domain: int = 0) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("connect/endpoints", f'["{endpoint}"]')
        config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("timestamping/enabled", "true")
        dials = '{"peer": {"to_router": "always", "to_peer": "greater-zid"}}'
        config.insert_json5("scouting/gossip/autoconnect_strategy", dials)
        self.session = zenoh.open(config)
        self.name, self.domain = name, domain
        self.namespace = namespace.strip("/").replace("/", "%")
        self._stack = ExitStack()
        self._numbers = iter(range(1, 1_000_000))
        self.gids: dict[str, bytes] = {}
        self._clients: dict[tuple[str, float], Any] = {}
        self._making = threading.Lock()
        self.zid = str(self.session.info.zid())
        self._whose = f"@ros2_lv/{domain}/{self.zid}/0"
        # As ROS's nodes do. What is asked for once, Zenoh may tell nothing of under load.
        self._seen: dict[str, None] = {}
        graph = self.session.liveliness().declare_subscriber("@ros2_lv/**", self._see, history=True)
        self._stack.callback(graph.undeclare)
        self._token(f"{self._whose}/0/NN/%/%{self.namespace}/{name}")

    def _token(self, key: str) -> None:
        self._stack.callback(self.session.liveliness().declare_token(key).undeclare)

    def announce(self, kind: str, topic: str, type_: str, hash_: str, qos: str = "::,10:,:,:,,") -> bytes:
        number = next(self._numbers)
        mangled = topic.replace("/", "%")
        key = f"{self._whose}/{number}/{kind}/%/%{self.namespace}/{self.name}/{mangled}/{type_}/{hash_}/{qos}"
        self._token(key)
        return xxhash.xxh3_128_intdigest(key.encode()).to_bytes(16, "little")

    def key(self, topic: str, type_: str, hash_: str) -> str:
        return f"{self.domain}/{topic.strip('/')}/{type_}/{hash_}"

    def publisher(self, message_type: Any, topic: str, *, latched: int = 0, hash_: str | None = None) -> "RosPublisher":
        name = type_name(message_type)
        type_, hash_ = dds(full_name(name)), hash_ or type_hash(name)
        qos = f":1:,{latched}:,:,:,," if latched else "::,10:,:,:,,"
        return RosPublisher(self, message_type, topic, type_, hash_, qos, latched)

    def publisher_raw(self, message_type: Any, topic: str, type_: str, hash_: str) -> "RosPublisher":
        return RosPublisher(self, message_type, topic, type_, hash_, "::,10:,:,:,,", 0)

    def hear(self, message_type: Any, topic: str, *, latched: int = 0) -> "RosHeard":
        name = type_name(message_type)
        return self.hear_raw(message_type, topic, dds(full_name(name)), type_hash(name), latched=latched)

    def hear_raw(self, message_type: Any, topic: str, type_: str, hash_: str, *, latched: int = 0) -> "RosHeard":
        qos = f":1:,{latched}:,:,:,," if latched else "::,10:,:,:,,"
        heard = RosHeard(cdr.decoder(message_type))
        key = self.key(topic, type_, hash_)
        declared: Any
        if latched:
            declared = ext.declare_advanced_subscriber(
                self.session,
                key,
                heard.take,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=latched),
                subscriber_detection=True,
            )
        else:
            declared = self.session.declare_subscriber(key, heard.take)
        self._stack.callback(declared.undeclare)
        self.announce("MS", topic, type_, hash_, qos)
        return heard

    def serve(self, service: str, topic: str, request: Any, answer: Callable[[Any], Any]) -> None:
        form = dds(full_name(service, "service")), type_hash(service)
        self._serve(topic, *form, request, answer)

    def serve_raw(self, topic: str, form: Any, request: Any, answer: Callable[[Any], Any]) -> None:
        self._serve(topic, form.type, form.hash, request, answer)

    def _serve(self, topic: str, type_: str, hash_: str, request: Any, answer: Callable[[Any], Any]) -> None:
        def take(query: zenoh.Query) -> None:
            assert query.payload is not None
            assert query.attachment is not None
            number, _, _, gid = struct.unpack("<qqB16s", query.attachment.to_bytes())
            said = answer(cdr.decoder(request)(query.payload.to_bytes()))
            if said is None:
                return
            stamp = struct.pack("<qqB16s", number, time.time_ns(), 16, gid)
            query.reply(query.key_expr, cdr.encoder(type(said))(said), attachment=stamp)

        declared = self.session.declare_queryable(self.key(topic, type_, hash_), take, complete=True)
        self._stack.callback(declared.undeclare)
        self.announce("SS", topic, type_, hash_)

    def call(
        self, service: str, topic: str, request: Any, response: Any, *, hash_: str = "", type_: str = "",
        timeout: float = PATIENCE,
    ) -> Any:  # fmt: skip
        """The answer, or the text of the error in its place."""
        type_, hash_ = type_ or dds(full_name(service, "service")), hash_ or type_hash(service)
        gid = self.announce("SC", topic, type_, hash_)
        stamp = struct.pack("<qqB16s", 7, time.time_ns(), 16, gid)
        querier = self._client(self.key(topic, type_, hash_), timeout)
        for reply in querier.get(payload=cdr.encoder(type(request))(request), attachment=stamp):
            if reply.ok is None:
                assert reply.err is not None
                return reply.err.payload.to_bytes().decode()
            assert reply.ok.attachment is not None
            number, _, _, whose = struct.unpack("<qqB16s", reply.ok.attachment.to_bytes())
            assert (number, whose) == (7, gid)
            return cdr.decoder(response)(reply.ok.payload.to_bytes())
        return None

    def _client(self, key: str, timeout: float) -> Any:
        """What asks: one for all calls, as in ROS; Zenoh mixes up the key of several that come and go at once."""
        with self._making:
            if (key, timeout) not in self._clients:
                made = self._clients[key, timeout] = self.session.declare_querier(
                    key,
                    target=zenoh.QueryTarget.ALL_COMPLETE,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=timeout,
                )
                self._stack.callback(made.undeclare)
            return self._clients[key, timeout]

    def tokens(self, pattern: str = "**") -> list[str]:
        """All tokens of the graph that this node sees."""
        asked = zenoh.KeyExpr(f"@ros2_lv/{self.domain}/{pattern}")
        return [one for one in list(self._seen) if asked.intersects(zenoh.KeyExpr(one))]

    def _see(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._seen[str(sample.key_expr)] = None
        else:
            self._seen.pop(str(sample.key_expr), None)

    def close(self) -> None:
        self._stack.close()
        self.session.close()


class RosPublisher:
    def __init__(
        self, node: RosNode, message_type: Any, topic: str, type_: str, hash_: str, qos: str, latched: int
    ) -> None:
        self.key = node.key(topic, type_, hash_)
        self._encode = cdr.encoder(message_type)
        self._publisher: Any
        if latched:
            self._publisher = ext.declare_advanced_publisher(
                node.session, self.key, cache=ext.CacheConfig(max_samples=latched), publisher_detection=True
            )
        else:
            self._publisher = node.session.declare_publisher(self.key)
        self.gid = node.announce("MP", topic, type_, hash_, qos)
        self._number = 0

    def publish(self, message: Any, *, gid: bytes | None = None, attachment: bytes | None = None) -> None:
        self.put(self._encode(message), gid=gid, attachment=attachment)

    def put(self, data: bytes, *, gid: bytes | None = None, attachment: bytes | None = None) -> None:
        self._number += 1
        stamp = struct.pack("<qqB16s", self._number, time.time_ns(), 16, gid or self.gid)
        self._publisher.put(data, attachment=stamp if attachment is None else attachment)


class RosHeard:
    """What a subscription of ROS's has heard."""

    def __init__(self, decode: Callable[[bytes], Any]) -> None:
        self._decode = decode
        self.messages: list[Any] = []
        self.stamps: list[tuple[int, int, int, bytes]] = []
        self._changed = threading.Condition()
        self.queue: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def take(self, sample: zenoh.Sample) -> None:
        assert sample.attachment is not None, "ROS drops a message without an attachment"
        message = self._decode(sample.payload.to_bytes())
        with self._changed:
            self.stamps.append(struct.unpack("<qqB16s", sample.attachment.to_bytes()))
            self.messages.append(message)
            self._changed.notify_all()
        self.queue.put(message)

    def wait(self, count: int = 1, timeout: float = PATIENCE) -> list[Any]:
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.messages) >= count, timeout), (
                f"{len(self.messages)} of {count} messages within {timeout} s"
            )
            return list(self.messages)


class Both:
    """A robot's network and one of ROS's, each with its router, and what connects them."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self.robo_at, self.ros_at = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
        self._routers = [self._route(where) for where in (self.robo_at, self.ros_at)]
        self.robo = self.open(self.peer())
        self.told: list[str] = []
        self._bridges = 0
        self._nodes: list[RosNode] = []

    def _route(self, where: str) -> zenoh.Session:
        return self.open(Network(mode="router", listen=(where,)))

    def restart_routers(self) -> None:
        """Both are gone, and there again."""
        for router in self._routers:
            close_session(router)
        self._routers = [self._route(where) for where in (self.robo_at, self.ros_at)]

    def peer(self) -> Network:
        """As nodes join: they link directly."""
        return Network(mode="peer", connect=(self.robo_at,), listen=("tcp/127.0.0.1:0",))

    def open(self, network: Network) -> zenoh.Session:
        opened = open_session(network)
        self._stack.callback(close_session, opened)
        return opened

    def bridge(self, namespace: str = "r1", node: str = "", **plan: Any) -> Bridge:
        robo = self.open(self.peer())
        give_way(robo, node or f"/{namespace}/ros2_bridge")
        ros = join_ros(self.ros_at)
        self._stack.callback(close_session, ros)
        made = Bridge(robo, ros, Ros2Plan(**plan), namespace, self.told.append, node)
        self._stack.callback(made.close)
        self._bridges += 1
        eventually(lambda: self._sees_all(ros), "it sees the nodes of ROS's")
        return made

    def _sees_all(self, ros: zenoh.Session) -> bool:
        """Whether a session sees all nodes of ROS's, which link a moment after it has begun."""
        found = ros.liveliness().get("@ros2_lv/**", timeout=5.0)
        tokens = [str(one.ok.key_expr) for one in found if one.ok is not None]
        here = (node for node in self._nodes if not node.session.is_closed())
        return all(any(node.zid in token for token in tokens) for node in here)

    def ros(self, name: str = "talker", namespace: str = "") -> RosNode:
        made = RosNode(self.ros_at, name, namespace)
        self._stack.callback(made.close)
        self._nodes.append(made)
        # Nodes of ROS's, too, link a moment after they have begun.
        eventually(
            lambda: not self._bridges or any("ros2_bridge" in one for one in made.tokens()), "it sees the bridge"
        )
        return made

    @cached_property
    def watcher(self) -> RosNode:
        """A node of ROS's that looks."""
        return self.ros("watcher")

    @contextmanager
    def node(self, topics: dict[str, tuple[Any, str]]) -> Iterator[Callable[[str, Any], None]]:
        """While this goes on, a node with these topics, each a type and a name; what publishes on one, by its word."""

        class Base(Node):
            pass

        with Base(name="publisher", namespace="r1", session=self.robo) as node:
            made = {word: node.create_publisher(type_, topic) for word, (type_, topic) in topics.items()}
            yield lambda word, message: made[word].publish(message)

    def heard(self, key: str, type_: Any) -> "Heard":
        made = Heard(self.robo, key, type_)
        self._stack.callback(made.close)
        return made


class Heard:
    """What somebody in robo's network hears."""

    def __init__(self, session: zenoh.Session, key: str, type_: Any) -> None:
        class Ear(Node):
            @subscribe(key)
            def hear(ear, message: type_) -> None:  # noqa: N805
                with self.changed:
                    self.messages.append(message)
                    self.changed.notify_all()

        self.messages: list[Any] = []
        self.changed = threading.Condition()
        self.node = Ear(name="ear", session=session)
        self.node.start()

    def wait(self, count: int = 1, timeout: float = PATIENCE) -> list[Any]:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.messages) >= count, timeout), self.messages
            return list(self.messages)

    def close(self) -> None:
        self.node.close()
