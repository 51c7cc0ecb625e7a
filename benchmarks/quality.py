"""Quality of service: how soon a late reader has a latched message, and commands beside images on one link."""

import statistics
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import NamedTuple, Protocol

import msgspec

JOINS = 20
"""Joins of a block."""
LATE = 5000.0
"""From here on a join counts as never, ms."""
MIXED_MS = 2000
"""How long a block of mixed load lasts, ms."""
MIXED = ("raw", "raw, all alike", "robo", "robo, all alike")
ONE_LINK, ONE_ROUTER, TWO_ROUTERS = "one link", "through a router", "through two routers"


class Worker(Protocol):
    """A process of a measurement (see `benchmarks.quality_worker`)."""

    def ask(self, number: int) -> bytes: ...

    def __exit__(self, *_: object) -> None: ...


class Bench(Protocol):
    """What starts workers."""

    def endpoint(self) -> str: ...

    def port(self) -> str: ...

    def start(self, stack: ExitStack, module: str, *arguments: str) -> Worker: ...


class Join(NamedTuple):
    """How a latched reader begins."""

    milliseconds: float
    wrong: int
    """Messages that came twice, or after a newer one."""


class Way:
    """A network between two workers."""

    def __init__(self, bench: Bench, stack: ExitStack, name: str) -> None:
        self._bench, self._stack = bench, stack
        here, there, between = bench.endpoint(), bench.endpoint(), bench.port()
        self.ends = f"peer;{here};", f"peer;;{here}"
        """The networks of the one who speaks and the one who listens."""
        if name == ONE_ROUTER:
            self.ends = f"client;;{here}", f"client;;{here}"
        elif name == TWO_ROUTERS:
            self.ends = f"client;;{here}", f"client;;{there}"
        self._near = f"router;{here} {between};"
        if name != ONE_LINK:
            self._router = self.worker("router", "", self._near)
        if name == TWO_ROUTERS:
            self.worker("router", "", f"router;{there};{between}")

    def worker(self, role: str, variant: str, network: str) -> Worker:
        """A process on it."""
        return self._bench.start(self._stack, "quality_worker", role, variant, network)

    def restart(self) -> None:
        """Kill the router of the one who speaks, and start it again."""
        self._router.__exit__()
        self._router = self.worker("router", "", self._near)


def latched_table(bench: Bench, rounds: int) -> list[str]:
    """How soon a late reader has the last message."""
    found: dict[tuple[str, str], list[list[Join]]] = {}
    for index in range(rounds):
        for name in (ONE_LINK, ONE_ROUTER, TWO_ROUTERS):
            for variant in ("raw", "robo"):
                with ExitStack() as stack:
                    way = Way(bench, stack, name)
                    keeper = way.worker("keep", variant, way.ends[0])
                    reader = way.worker("join", variant, way.ends[1])
                    keeper.ask(1)
                    _settle(reader)
                    found.setdefault((name, variant), []).append(_joins(reader, JOINS))
                    if name == TWO_ROUTERS:
                        way.restart()
                        _settle(reader)
                        found.setdefault((f"{name}, the near one new", variant), []).append(_joins(reader, JOINS))
                    keeper.ask(0)
                    found.setdefault((f"{name}, beside 500 Hz", variant), []).append(_joins(reader, JOINS))
        print(f"  latched: round {index + 1} of {rounds}", file=sys.stderr)
    lines = [
        "### A late reader of a latched topic",
        "",
        f"From its declaration to the last message, {JOINS} times a round; `raw` is zenoh.ext alone. `wrong` is what",
        "came twice or after a newer one. `the near one new`: the publisher's router was killed and started again",
        "before; `beside 500 Hz`: it publishes all the while.",
        "",
        "| network | variant | median ms | longest ms | wrong |",
        "|---|---|---|---|---|",
    ]
    for (name, variant), blocks in sorted(found.items(), key=lambda item: item[0][0].partition(",")[0] != ONE_LINK):
        times = [[join.milliseconds for join in block] for block in blocks]
        wrong = sum(join.wrong for block in blocks for join in block)
        lines.append(
            f"| {name} | {variant} | {_spread([statistics.median(block) for block in times])}"
            f" | {max(map(max, times)):.1f} | {wrong} |"
        )
    return [*lines, ""]


def _joins(reader: Worker, count: int) -> list[Join]:
    return msgspec.json.decode(reader.ask(count), type=list[Join])


def _settle(reader: Worker) -> None:
    """Wait until the network is linked: then a reader gets what was said."""
    while _joins(reader, 1)[0].milliseconds >= LATE:
        print("  (a join came to nothing while the network was being linked)", file=sys.stderr)


def mixed_table(bench: Bench, rounds: int) -> list[str]:
    """Commands beside images, both from one process to another."""
    ages: dict[tuple[str, str], list[list[float]]] = {}
    lost: dict[tuple[str, str], int] = {}
    images: dict[tuple[str, str], list[float]] = {}
    for index in range(rounds):
        shift = index % len(MIXED)
        for name in (ONE_LINK, ONE_ROUTER):
            for variant in (*MIXED[shift:], *MIXED[:shift]):
                with ExitStack() as stack:
                    way = Way(bench, stack, name)
                    receiver = way.worker("receive", variant, way.ends[0])
                    sender = way.worker("send", variant, way.ends[1])
                    sender.ask(300)  # until both are linked
                    _received(receiver)
                    sent = msgspec.json.decode(sender.ask(MIXED_MS), type=int)
                    came, shown = _received(receiver)
                key = (name, variant)
                ages.setdefault(key, []).append(sorted(came))
                lost[key] = lost.get(key, 0) + sent - len(came)
                images.setdefault(key, []).append(shown / (MIXED_MS / 1e3 + 0.3))
        print(f"  mixed load: round {index + 1} of {rounds}", file=sys.stderr)
    lines = [
        "### Commands beside images",
        "",
        "A Twist 100 times a second and an image of 6 MB 30 times a second, from one process to another; from the",
        "call of `publish` to the callback. `robo` says `qos=QoS.COMMAND` and `QoS.BULK`, `raw` the same priorities;",
        "`all alike` says nothing of priorities.",
        "",
        "| network | variant | p50 ms | p99 ms | longest ms | lost | images/s |",
        "|---|---|---|---|---|---|---|",
    ]
    for (name, variant), blocks in sorted(ages.items(), key=lambda item: item[0][0] != ONE_LINK):
        key = (name, variant)
        lines.append(
            f"| {name} | {variant} | {_spread([_part(block, 0.5) for block in blocks])}"
            f" | {_spread([_part(block, 0.99) for block in blocks])} | {max(block[-1] for block in blocks):.1f}"
            f" | {lost[key]} | {statistics.median(images[key]):.0f} |"
        )
    return [*lines, ""]


def _received(receiver: Worker) -> tuple[list[float], int]:
    """The ages of commands and the number of images since the last time, once no more are on the way."""
    ages: list[float] = []
    images, quiet = 0, 0
    while quiet < 10:
        came, shown = msgspec.json.decode(receiver.ask(0), type=tuple[list[float], int])
        ages += came
        images += shown
        quiet = 0 if came or shown else quiet + 1
        time.sleep(0.02)
    return ages, images


def _part(ordered: Sequence[float], part: float) -> float:
    return ordered[min(int(len(ordered) * part), len(ordered) - 1)]


def _spread(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.2f} ({min(values):.2f}-{max(values):.2f})"
