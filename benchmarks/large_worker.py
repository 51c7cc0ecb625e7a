"""One end of a measurement of `benchmarks.large`, in a process of its own: as `benchmarks.worker`.

What is robo's is imported by robo's variants alone: it has settings for Zenoh's threads, which raw ones do without.
"""

import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import zenoh

from benchmarks import raw
from benchmarks.worker import answer, say
from robo_messages import Image, LaserScan, Message
from robo_messages.scans import LaserScanArray

TOPIC, BACK = "bench/large", "bench/back"
POOL = 128 * 2**20
"""Shared memory of the raw variants that ask for it themselves, bytes: as much as robo takes at most."""
RAYS = 2000
ZENOHS_OWN: dict[str, object] = {"transport": {"shared_memory": {"transport_optimization": {"enabled": True}}}}


def main() -> None:
    role, variant, kind, listen, connect = sys.argv[1:6]
    if variant.startswith("raw"):
        session = raw.open_plain(listen, connect)
    else:
        session = open_robos(listen, connect, without="without" in variant)
    if kind == "scan":
        make: Any = RawScans if variant.startswith("raw") else Scans
        scans = make(session, variant, role)
        answer(scans.round_trips)
    elif role == "sink":
        sink = (raw_sink if variant.startswith("raw") else robo_sink)(session, depth_of(variant))
        answer(lambda _: sink[0])
    else:
        answer(source(session, variant, int(kind)))
    os._exit(0)


def open_robos(listen: str, connect: str, *, without: bool) -> zenoh.Session:
    """A session with robo's settings; `without` its own shared memory, but with Zenoh's implicit one."""
    from robo.wire import shared_memory
    from robo.wire.network import Network
    from robo.wire.session import open_session

    session = open_session(
        Network(
            mode="peer",
            listen=tuple(filter(None, [listen])),
            connect=tuple(filter(None, [connect])),
            more=ZENOHS_OWN if without else {},
        )
    )
    if without:
        module: Any = shared_memory
        module.of_session = lambda _: None
    return session


def depth_of(variant: str) -> int:
    """As robo writes it: 0 keeps all."""
    return 0 if variant.endswith("keep all") else 10


def raw_sink(session: zenoh.Session, depth: int) -> list[int]:
    channel: Any = zenoh.handlers.RingChannel(depth) if depth else zenoh.handlers.FifoChannel(16)
    subscriber = session.declare_subscriber(TOPIC, channel)
    decode = msgspec.msgpack.Decoder(Image).decode
    count = [0]

    def loop() -> None:
        while True:
            decode(subscriber.handler.recv().payload.to_bytes())
            count[0] += 1

    threading.Thread(target=loop, daemon=True).start()
    return count


def robo_sink(session: zenoh.Session, depth: int) -> list[int]:
    from benchmarks import with_robo

    node = with_robo.Bench(name="sink", session=session)
    node.start()
    count = [0]

    def on_image(_: Image) -> None:
        count[0] += 1

    node.create_subscription(Image, TOPIC, on_image, depth=depth)
    return count


def source(session: zenoh.Session, variant: str, size: int) -> Callable[[int], int]:
    """What sends images of `size` bytes for so many ms, and returns how many."""
    depth = depth_of(variant)
    pixels = np.random.default_rng(0).integers(0, 256, size, np.uint8).reshape(1000, -1)
    data = pixels.tobytes()
    if variant.startswith("robo"):
        from benchmarks import with_robo

        node = with_robo.Bench(name="source", session=session)
        node.start()
        publisher = node.create_publisher(Image, TOPIC, depth=depth)
        with_robo.wait_for_match(publisher)

        def send() -> None:
            if "array" in variant:
                publisher.publish(Image.from_array(pixels, "mono8"))
            else:
                publisher.publish(Image(height=1000, width=size // 1000, encoding="mono8", data=memoryview(data)))
    else:
        send = raw_send(session, variant, depth, data)

    def flood(milliseconds: int) -> int:
        end, sent = time.monotonic() + milliseconds / 1e3, 0
        while time.monotonic() < end:
            send()
            sent += 1
        return sent

    return flood


def raw_send(session: zenoh.Session, variant: str, depth: int, data: bytes) -> Callable[[], None]:
    control = zenoh.CongestionControl.DROP if depth else zenoh.CongestionControl.BLOCK
    publisher = session.declare_publisher(TOPIC, congestion_control=control)
    raw.wait_for_match(publisher)
    put, encode = publisher.put, msgspec.msgpack.Encoder().encode
    image = Image(height=1000, width=len(data) // 1000, encoding="mono8", data=memoryview(data))
    if "implicit" in variant:
        return lambda: put(encode(image))
    shm: Any = zenoh.shm
    memory = shm.ShmProvider.default_backend(POOL)
    policy = shm.BlockOn(shm.Defragment(shm.GarbageCollect()))

    def as_documented() -> None:
        payload = encode(image)
        buffer = memory.alloc(len(payload), policy)
        buffer[:] = payload
        put(buffer)

    head = encode(Image(height=1000, width=len(data) // 1000, encoding="mono8"))[:-2] + b"\xc6"
    head += len(data).to_bytes(4, "big")

    def in_place() -> None:
        memory.garbage_collect()
        buffer = memory.alloc(len(head) + len(data), policy)
        buffer[: len(head)] = head
        buffer[len(head) :] = data
        put(buffer)

    return in_place if "in place" in variant else as_documented


class Scans:
    """Round trips of a scan whose ranges are computed with at both ends."""

    def __init__(self, session: zenoh.Session, variant: str, role: str) -> None:
        from benchmarks import with_robo

        self._type: type[Message] = LaserScan if "list" in variant else LaserScanArray
        self._ranges: Any = np.linspace(0.1, 10.0, RAYS, dtype=np.float32)
        if self._type is LaserScan:
            self._ranges = self._ranges.tolist()
        self._back, self._times, self._sent = role == "echo", list[int](), 0
        self._done = threading.Event()
        node = with_robo.Bench(name=role, session=session)
        node.start()
        here, there = (TOPIC, BACK) if self._back else (BACK, TOPIC)
        self._publisher: Any = node.create_publisher(self._type, there)
        node.create_subscription(self._type, here, self._on_scan)
        if not self._back:
            with_robo.wait_for_match(self._publisher)

    def round_trips(self, count: int) -> list[int]:
        """The time of `count` round trips, ns."""
        self._times, self._wanted = [], count
        self._done.clear()
        self._send(self._ranges)
        self._done.wait()
        return self._times

    def _send(self, ranges: Any) -> None:
        self._sent = time.perf_counter_ns()
        scan: Any = self._type()
        scan.ranges = ranges
        self._publisher.publish(scan)

    def _on_scan(self, scan: Any) -> None:
        ranges = scan.ranges
        if self._back:
            self._send(ranges)
            return
        self._times.append(time.perf_counter_ns() - self._sent)
        if len(self._times) == self._wanted:
            self._done.set()
        else:
            self._send(self._ranges)


class RawScans:
    """The same with the bare bytes of the ranges, float32."""

    def __init__(self, session: zenoh.Session, _variant: str, role: str) -> None:
        self._ranges = np.linspace(0.1, 10.0, RAYS, dtype=np.float32)
        here, there = (TOPIC, BACK) if role == "echo" else (BACK, TOPIC)
        self._publisher = session.declare_publisher(there)
        self._subscriber: Any = session.declare_subscriber(here, zenoh.handlers.RingChannel(10))
        if role == "echo":
            say("ready")
            while True:
                self._publisher.put(self._receive().tobytes())
        raw.wait_for_match(self._publisher)

    def _receive(self) -> Any:
        return np.frombuffer(self._subscriber.handler.recv().payload.to_bytes(), np.float32)

    def round_trips(self, count: int) -> list[int]:
        """The time of `count` round trips, ns."""
        times = []
        for _ in range(count):
            sent = time.perf_counter_ns()
            self._publisher.put(self._ranges.tobytes())
            self._receive()
            times.append(time.perf_counter_ns() - sent)
        return times


if __name__ == "__main__":
    main()
