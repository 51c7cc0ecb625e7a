"""The same work as robo's users write it: nodes with publishers and callbacks."""

import threading
import time

import zenoh

import robo
from benchmarks.raw import FLOOD, PING, PONG, wait_for_match
from robo.qos import DEFAULT_DEPTH, KEEP_ALL
from robo_messages import Message

DEPTHS = {"robo": DEFAULT_DEPTH, "robo-keep-all": KEEP_ALL}


class Bench(robo.Node):
    """An empty node: endpoints are made while running, for a type that is chosen while running."""


def echo(session: zenoh.Session, sample: Message) -> None:
    """Answer every ping with a pong, for ever."""
    with Bench(name="echo", session=session) as node:
        pong = node.create_publisher(type(sample), PONG)
        node.create_subscription(type(sample), PING, pong.publish)
        node.wait()


def round_trips(session: zenoh.Session, sample: Message, count: int) -> list[int]:
    """The time of `count` round trips, ns."""
    times: list[int] = []
    done = threading.Event()
    now, sent = time.perf_counter_ns, 0
    with Bench(name="ping", session=session) as node:
        ping = node.create_publisher(type(sample), PING)

        def on_pong(_: Message) -> None:
            nonlocal sent
            times.append(now() - sent)
            if len(times) == count:
                done.set()
                return
            sent = now()
            ping.publish(sample)

        node.create_subscription(type(sample), PONG, on_pong)
        wait_for_match(ping.zenoh_publisher)
        sent = now()
        ping.publish(sample)
        done.wait()
    return times


class Sink:
    """Counts what arrives."""

    def __init__(self, session: zenoh.Session, variant: str, sample: Message) -> None:
        self.count = 0
        self._node = Bench(name="sink", session=session)
        self._node.start()
        self._node.create_subscription(type(sample), FLOOD, self._on_message, depth=DEPTHS[variant])

    def _on_message(self, _: Message) -> None:
        self.count += 1


def flood(session: zenoh.Session, variant: str, sample: Message, seconds: float) -> int:
    """Send as fast as possible; returns how many were sent."""
    with Bench(name="source", session=session) as node:
        publisher = node.create_publisher(type(sample), FLOOD, depth=DEPTHS[variant])
        wait_for_match(publisher.zenoh_publisher)
        publish = publisher.publish
        end, sent = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            for _ in range(100):
                publish(sample)
            sent += 100
        return sent
