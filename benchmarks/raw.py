"""The same work with zenoh-python and msgspec alone, in each of the ways one might write it."""

import itertools
import struct
import threading
import time
from collections.abc import Callable
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


def _sender(session: zenoh.Session, key: str, *, stamped: bool) -> tuple[zenoh.Publisher, Callable[[bytes], None]]:
    """A publisher, and what sends by it; `stamped` with what robo sends along at such a pace.

    That is the type's name, a sequence number and a time, and whose the message is.
    """
    publisher = session.declare_publisher(key, encoding="application/msgpack;geometry/Twist" if stamped else None)
    put: Callable[..., None] = publisher.put
    if not stamped:
        return publisher, put
    pack, now, numbers, own = struct.Struct("<qq").pack, time.time_ns, itertools.count(1), publisher.id

    def put_stamped(payload: bytes) -> None:
        number = next(numbers)
        put(payload, attachment=pack(number, now()), source_info=zenoh.SourceInfo(own, number))

    return publisher, put_stamped


def echo(session: zenoh.Session, variant: str, sample: Message) -> None:
    """Answer every ping with a pong, for ever."""
    encode, decode = msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder(type(sample)).decode
    way, _, stamped = variant.partition("-")
    _publisher, put = _sender(session, PONG, stamped=bool(stamped))  # undeclared when nobody holds it
    if way == "callback":
        session.declare_subscriber(PING, lambda s: put(encode(decode(s.payload.to_bytes()))))
        threading.Event().wait()
    subscriber = session.declare_subscriber(PING, HANDLERS[way]())  # as the publisher
    receive = subscriber.handler.recv
    while True:
        put(encode(decode(receive().payload.to_bytes())))


class Pinger:
    """Measures round trips."""

    def __init__(self, session: zenoh.Session, variant: str, sample: Message) -> None:
        self._encode, self._decode = msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder(type(sample)).decode
        self._sample = sample
        way, _, stamped = variant.partition("-")
        self._publisher, self._put = _sender(session, PING, stamped=bool(stamped))
        self._times: list[int] = []
        self._wanted = self._sent = 0
        self._done = threading.Event()
        if way == "callback":
            session.declare_subscriber(PONG, self._on_pong)
            self.round_trips = self._by_callback
        else:
            self._subscriber = session.declare_subscriber(PONG, HANDLERS[way]())
            self.round_trips = self._by_loop
        wait_for_match(self._publisher)

    def _by_loop(self, count: int) -> list[int]:
        """The time of `count` round trips, ns."""
        encode, decode, receive = self._encode, self._decode, self._subscriber.handler.recv
        put, now, sample = self._put, time.perf_counter_ns, self._sample
        times: list[int] = []
        for _ in range(count):
            sent = now()
            put(encode(sample))
            decode(receive().payload.to_bytes())
            times.append(now() - sent)
        return times

    def _by_callback(self, count: int) -> list[int]:
        self._times, self._wanted = [], count
        self._done.clear()
        self._ping()
        self._done.wait()
        return self._times

    def _ping(self) -> None:
        self._sent = time.perf_counter_ns()
        self._put(self._encode(self._sample))

    def _on_pong(self, pong: zenoh.Sample) -> None:
        self._decode(pong.payload.to_bytes())
        self._times.append(time.perf_counter_ns() - self._sent)
        if len(self._times) == self._wanted:
            self._done.set()
        else:
            self._ping()


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


class Source:
    """Sends as fast as possible.

    `…-stamped` sends what robo sends: sequence number and time as an attachment, and the encoding.
    """

    def __init__(self, session: zenoh.Session, variant: str, sample: Message) -> None:
        self._sample = sample
        self._stamped = variant.endswith("-stamped")
        drop = variant.endswith("-drop")
        self._publisher = session.declare_publisher(
            FLOOD,
            congestion_control=zenoh.CongestionControl.DROP if drop else zenoh.CongestionControl.BLOCK,
            encoding="application/msgpack;geometry/Twist" if self._stamped else None,
        )
        wait_for_match(self._publisher)

    def flood(self, seconds: float) -> int:
        """Returns how many were sent."""
        put, encode, sample = self._publisher.put, msgspec.msgpack.Encoder().encode, self._sample
        pack, now = struct.Struct("<qq").pack, time.time_ns
        end, sent = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            if self._stamped:
                for _ in range(100):
                    sent += 1
                    put(encode(sample), attachment=pack(sent, now()))
                continue
            for _ in range(100):
                put(encode(sample))
            sent += 100
        return sent


def wait_for_match(publisher: zenoh.Publisher) -> None:
    """Wait until the other end is seen."""
    matched = threading.Event()
    listener = publisher.declare_matching_listener(lambda status: matched.set() if status.matching else None)
    status: Any = publisher.matching_status
    if not status.matching:
        matched.wait(10)
    listener.undeclare()
