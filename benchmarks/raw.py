"""The same work with zenoh-python and msgspec alone, in each of the ways one might write it."""

import struct
import threading
import time
from typing import Any

import msgspec
import zenoh

from robo_messages import Message

PING, PONG, FLOOD = "bench/ping", "bench/pong", "bench/flood"

HANDLERS: dict[str, Any] = {
    "fifo": lambda: zenoh.handlers.FifoChannel(256),
    "ring": lambda: zenoh.handlers.RingChannel(10),
}


def open_plain(listen: str, connect: str) -> zenoh.Session:
    """A session with the settings that zenoh-python comes with, on the same link."""
    config = zenoh.Config()
    for key, value in (
        ("mode", "peer"),
        ("listen/endpoints", [listen] if listen else []),
        ("connect/endpoints", [connect] if connect else []),
        ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(key, msgspec.json.encode(value).decode())
    return zenoh.open(config)


def echo(session: zenoh.Session, variant: str, sample: Message) -> None:
    """Answer every ping with a pong, for ever."""
    encode, decode = msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder(type(sample)).decode
    publisher = session.declare_publisher(PONG)
    put = publisher.put
    if variant == "callback":
        session.declare_subscriber(PING, lambda s: put(encode(decode(s.payload.to_bytes()))))
        threading.Event().wait()
    subscriber = session.declare_subscriber(PING, HANDLERS[variant]())  # undeclared when nobody holds it
    receive = subscriber.handler.recv
    while True:
        put(encode(decode(receive().payload.to_bytes())))


def round_trips(session: zenoh.Session, variant: str, sample: Message, count: int) -> list[int]:
    """The time of `count` round trips, ns."""
    encode, decode = msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder(type(sample)).decode
    publisher = session.declare_publisher(PING)
    put, now = publisher.put, time.perf_counter_ns
    times: list[int] = []
    if variant == "callback":
        done = threading.Event()
        sent = 0

        def on_pong(pong: zenoh.Sample) -> None:
            nonlocal sent
            decode(pong.payload.to_bytes())
            times.append(now() - sent)
            if len(times) == count:
                done.set()
                return
            sent = now()
            put(encode(sample))

        session.declare_subscriber(PONG, on_pong)
        wait_for_match(publisher)
        sent = now()
        put(encode(sample))
        done.wait()
        return times
    subscriber = session.declare_subscriber(PONG, HANDLERS[variant]())
    receive = subscriber.handler.recv
    wait_for_match(publisher)
    for _ in range(count):
        sent = now()
        put(encode(sample))
        decode(receive().payload.to_bytes())
        times.append(now() - sent)
    return times


class Sink:
    """Counts what arrives."""

    def __init__(self, session: zenoh.Session, variant: str, sample: Message) -> None:
        self.count = 0
        decode = msgspec.msgpack.Decoder(type(sample)).decode
        way, _, _ = variant.partition("-")
        if way == "callback":

            def on_message(s: zenoh.Sample) -> None:
                decode(s.payload.to_bytes())
                self.count += 1

            session.declare_subscriber(FLOOD, on_message)
            return
        self._subscriber = session.declare_subscriber(FLOOD, HANDLERS[way]())
        receive = self._subscriber.handler.recv

        def loop() -> None:
            while True:
                decode(receive().payload.to_bytes())
                self.count += 1

        threading.Thread(target=loop, daemon=True).start()


def flood(session: zenoh.Session, variant: str, sample: Message, seconds: float) -> int:
    """Send as fast as possible; returns how many were sent.

    `…-stamped` sends what robo sends: sequence number and time as an attachment, and the encoding.
    """
    if variant.endswith("-stamped"):
        return _flood_stamped(session, sample, seconds)
    control = zenoh.CongestionControl.BLOCK if variant.endswith("-block") else zenoh.CongestionControl.DROP
    publisher = session.declare_publisher(FLOOD, congestion_control=control)
    wait_for_match(publisher)
    put, encode = publisher.put, msgspec.msgpack.Encoder().encode
    end, sent = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        for _ in range(100):
            put(encode(sample))
        sent += 100
    return sent


def _flood_stamped(session: zenoh.Session, sample: Message, seconds: float) -> int:
    publisher = session.declare_publisher(
        FLOOD, congestion_control=zenoh.CongestionControl.BLOCK, encoding="application/msgpack;geometry/Twist"
    )
    wait_for_match(publisher)
    put, encode, pack, now = publisher.put, msgspec.msgpack.Encoder().encode, struct.Struct("<qq").pack, time.time_ns
    end, sent = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        for _ in range(100):
            sent += 1
            put(encode(sample), attachment=pack(sent, now()))
    return sent


def wait_for_match(publisher: zenoh.Publisher) -> None:
    """Wait until the other end is seen."""
    matched = threading.Event()
    listener = publisher.declare_matching_listener(lambda status: matched.set() if status.matching else None)
    status: Any = publisher.matching_status
    if not status.matching:
        matched.wait(10)
    listener.undeclare()
