"""The same work as robo's users write it: nodes with publishers and callbacks."""

import threading
import time
from typing import Any

import zenoh

import robo
from benchmarks.raw import FLOOD, PING, PONG
from robo.node.topics import TopicPublisher
from robo.wire.qos import DEFAULT_DEPTH, KEEP_ALL
from robo_messages import Message

DEPTHS = {"robo": DEFAULT_DEPTH, "robo-keep-all": KEEP_ALL}


class Bench(robo.Node):
    """An empty node: endpoints are made while running, for a type that is chosen while running."""


def echo(session: zenoh.Session, variant: str, sample: Message) -> None:
    """Answer every ping with a pong, for ever; `robo-async` in an async callback."""
    with Bench(name="echo", session=session) as node:
        pong = node.create_publisher(type(sample), PONG)

        async def answer(message: Message) -> None:
            pong.publish(message)

        node.create_subscription(type(sample), PING, answer if variant == "robo-async" else pong.publish)
        node.wait()


class Pinger:
    """Measures round trips."""

    def __init__(self, session: zenoh.Session, _variant: str, sample: Message) -> None:
        self._sample = sample
        self._times: list[int] = []
        self._wanted = self._sent = 0
        self._done = threading.Event()
        node = Bench(name="ping", session=session)
        node.start()
        self._ping_topic = node.create_publisher(type(sample), PING)
        node.create_subscription(type(sample), PONG, self._on_pong)
        wait_for_match(self._ping_topic)

    def round_trips(self, count: int) -> list[int]:
        """The time of `count` round trips, ns."""
        self._times, self._wanted = [], count
        self._done.clear()
        self._ping()
        self._done.wait()
        return self._times

    def _ping(self) -> None:
        self._sent = time.perf_counter_ns()
        self._ping_topic.publish(self._sample)

    def _on_pong(self, _: Message) -> None:
        self._times.append(time.perf_counter_ns() - self._sent)
        if len(self._times) == self._wanted:
            self._done.set()
        else:
            self._ping()


class Sink:
    """Counts what arrives."""

    def __init__(self, session: zenoh.Session, variant: str, sample: Message) -> None:
        self.count = 0
        self._node = Bench(name="sink", session=session)
        self._node.start()
        self._node.create_subscription(type(sample), FLOOD, self._on_message, depth=DEPTHS[variant])

    def _on_message(self, _: Message) -> None:
        self.count += 1


class Source:
    """Sends as fast as possible."""

    def __init__(self, session: zenoh.Session, variant: str, sample: Message) -> None:
        self._sample = sample
        node = Bench(name="source", session=session)
        node.start()
        self._publisher = node.create_publisher(type(sample), FLOOD, depth=DEPTHS[variant])
        wait_for_match(self._publisher)

    def flood(self, seconds: float) -> int:
        """Returns how many were sent."""
        publish, sample = self._publisher.publish, self._sample
        end, sent = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            for _ in range(100):
                publish(sample)
            sent += 100
        return sent


def wait_for_match(publisher: TopicPublisher[Any]) -> None:
    """Wait until the other end is seen."""
    while not publisher.has_subscribers:
        time.sleep(0.001)
