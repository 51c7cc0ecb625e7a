"""One process of `benchmarks.quality`: `python -m benchmarks.quality_worker ROLE VARIANT NETWORK`.

NETWORK is `mode;endpoints to listen at;endpoints to dial`. It says `ready`, answers each line, a number, with one of
JSON, and ends with its input. `robo` is what robo's users write, `raw` the same with Zenoh alone; sessions are alike.
"""

import os
import sys
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any, cast

import msgspec
import zenoh
from zenoh import ext

import robo
from benchmarks.worker import answer
from robo import QoS
from robo.wire.network import Mode, Network
from robo.wire.session import open_session
from robo_messages import Image, String, Twist, Vector3

STATE, COMMAND, IMAGE = "bench/state", "bench/command", "bench/image"
JOIN_LIMIT = 5.0
"""How long a reader waits for the last message before it counts as never, s."""
BUSY = 0.002
"""The time between two messages of a busy latched topic, s."""
WATCHED = 0.06
"""For how long a reader of a busy topic stays, s."""
COMMANDS, IMAGES = 100, 30
"""Hz."""
IMAGE_SIZE = 6_000_000
"""Bytes."""
WARM_UP = 0.3
"""What is sent before that does not count, s."""

PRIORITIES = {
    "robo": ({"qos": QoS.COMMAND}, {"qos": QoS.BULK}),
    "robo, all alike": ({"depth": 1}, {"depth": 1}),
    "raw": ({"priority": zenoh.Priority.INTERACTIVE_HIGH}, {"priority": zenoh.Priority.BACKGROUND}),
    "raw, all alike": ({}, {}),
}
"""What is said of commands and of images."""


class Bench(robo.Node):
    """An empty node: its ends are made while it runs."""


def keep(session: zenoh.Session, variant: str) -> Callable[[int], object]:
    """A latched publisher: says a number; or one after the other without end, after 0."""
    put: Callable[[int], None]
    if variant == "robo":
        node = Bench(name=f"keep_{os.getpid()}", session=session)
        node.start()
        state = node.create_publisher(String, STATE, latched=True)
        put = lambda number: state.publish(String(str(number)))  # noqa: E731
    else:
        publisher = ext.declare_advanced_publisher(
            session,
            STATE,
            cache=ext.CacheConfig(max_samples=1),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        put = lambda number: publisher.put(msgspec.msgpack.encode(String(str(number))))  # noqa: E731

    def speak() -> None:
        number = 0
        while True:
            number += 1
            put(number)
            time.sleep(BUSY)

    def work(number: int) -> object:
        if number:
            put(number)
        else:
            threading.Thread(target=speak, daemon=True).start()
        return number

    return work


class Joins:
    """Joins a latched topic, again and again."""

    def __init__(self, session: zenoh.Session, variant: str) -> None:
        self._session = session
        self._node = Bench(name=f"join_{os.getpid()}", session=session) if variant == "robo" else None
        if self._node is not None:
            self._node.start()

    def __call__(self, count: int) -> object:
        """The time from the declaration to the last message, ms; of a busy topic, what comes out of order as well."""
        return [self._join() for _ in range(count)]

    def _join(self) -> tuple[float, int]:
        seen: list[int] = []
        came = threading.Event()
        first = 0.0

        def take(message: String) -> None:
            nonlocal first
            first = first or time.perf_counter()
            seen.append(int(message.data))
            came.set()

        begin = time.perf_counter()
        leave = self._declare(take)
        came.wait(JOIN_LIMIT)
        time.sleep(WATCHED)
        leave()
        wrong = sum(later <= before for before, later in pairwise(seen))
        return (first - begin) * 1e3 if seen else JOIN_LIMIT * 1e3, wrong

    def _declare(self, take: Callable[[String], None]) -> Callable[[], object]:
        if self._node is not None:
            subscription = self._node.create_subscription(String, STATE, take, latched=True)
            return lambda: subscription.stop(1.0)
        decode = msgspec.msgpack.Decoder(String).decode
        subscriber = ext.declare_advanced_subscriber(
            self._session,
            STATE,
            lambda sample: take(decode(sample.payload.to_bytes())),
            history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
        )
        return cast(Callable[[], object], subscriber.undeclare)


def send(session: zenoh.Session, variant: str) -> Callable[[int], object]:
    """Sends commands and images at their rates for so many ms; returns how many commands count."""
    of_commands, of_images = cast(Any, PRIORITIES[variant])
    put_command: Callable[[Twist], Any]
    put_image: Callable[[Image], Any]
    if variant.startswith("robo"):
        node = Bench(name="send", session=session)
        node.start()
        put_command = node.create_publisher(Twist, COMMAND, **of_commands).publish
        put_image = node.create_publisher(Image, IMAGE, **of_images).publish
    else:
        encode = msgspec.msgpack.Encoder().encode
        commands, images = (session.declare_publisher(k, **m) for k, m in ((COMMAND, of_commands), (IMAGE, of_images)))
        put_command = lambda message: commands.put(encode(message))  # noqa: E731
        put_image = lambda message: images.put(encode(message))  # noqa: E731
    image = Image(data=memoryview(bytes(IMAGE_SIZE)))

    def work(milliseconds: int) -> object:
        end = time.monotonic() + WARM_UP + milliseconds / 1e3
        showing = threading.Thread(target=paced, args=(IMAGES, end, lambda _: put_image(image)))
        showing.start()
        from_now = time.monotonic() + WARM_UP
        counted = paced(COMMANDS, end, lambda now: put_command(Twist(Vector3(x=now, y=float(now >= from_now)))))
        showing.join()
        return sum(now >= from_now for now in counted)

    return work


def paced(rate: int, end: float, once: Callable[[float], object]) -> list[float]:
    """Do something at a rate until a time. Returns when it was done, by the monotonic clock, s."""
    due, done = time.monotonic(), []
    while due < end:
        time.sleep(max(0.0, due - time.monotonic()))
        done.append(now := time.monotonic())
        once(now)
        due += 1.0 / rate
    return done


def receive(session: zenoh.Session, variant: str) -> Callable[[int], object]:
    """Receives both; returns the ages of the commands that count, ms, and how many images came, since the last time."""
    ages: list[float] = []
    images = 0

    def on_command(twist: Twist) -> None:
        if twist.linear.y:
            ages.append((time.monotonic() - twist.linear.x) * 1e3)

    def on_image(_image: Image) -> None:
        nonlocal images
        images += 1

    if variant.startswith("robo"):
        of_commands, of_images = cast(Any, PRIORITIES[variant])
        node = Bench(name="receive", session=session)
        node.start()
        node.create_subscription(Twist, COMMAND, on_command, **of_commands)
        node.create_subscription(Image, IMAGE, on_image, **of_images)
    else:
        for key, kind, take in ((COMMAND, Twist, on_command), (IMAGE, Image, on_image)):
            threading.Thread(target=drain, args=(session, key, kind, take), daemon=True).start()

    def work(_number: int) -> object:
        nonlocal images
        found = ages[:], images
        ages.clear()
        images = 0
        return found

    return work


def drain(session: zenoh.Session, key: str, kind: type[Any], take: Callable[[Any], None]) -> None:
    """Receive a key in a loop, as quick raw users do."""
    decode = msgspec.msgpack.Decoder(kind).decode
    subscriber = session.declare_subscriber(key, zenoh.handlers.RingChannel(1 if kind is Image else 100))
    receive = subscriber.handler.recv
    while True:
        take(decode(receive().payload.to_bytes()))


def main() -> None:
    role, variant, network = sys.argv[1:4]
    mode, listen, connect = network.split(";")
    ends = tuple(listen.split()), tuple(connect.split())
    session = open_session(Network(mode=cast(Mode, mode), listen=ends[0], connect=ends[1]))
    roles: dict[str, Callable[[zenoh.Session, str], Callable[[int], object]]] = {
        "keep": keep,
        "join": Joins,
        "send": send,
        "receive": receive,
        "router": lambda _session, _variant: lambda number: number,
    }
    answer(roles[role](session, variant))
    os._exit(0)  # raw callbacks that still run would keep the process from exiting


if __name__ == "__main__":
    main()
