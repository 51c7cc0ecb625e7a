"""`python -m benchmarks.ros2_bridge`: a Twist through the bridge to ROS 2, beside a direct hop in the same run.

All are processes of their own on loopback, linked directly as nodes are; both networks have a router at which they
meet. The direct hop is raw zenoh-python in robo's network, the fastest of its ways (`recv` on a channel), with what
robo sends along. Through the bridge a Twist is CDR on ROS's side and MessagePack on robo's: two hops, a thread more and
a conversion each way. `a node` is one of robo's whose callback sends each message back, in robo's network; with
`--ros2` it hears and is heard in ROS's by itself. What is measured is the way there and back. Needs the extra `ros2`.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import psutil
import zenoh

from benchmarks.__main__ import machine
from robo import Node, Publisher, subscribe
from robo.bridges.ros2 import stamps
from robo.bridges.ros2.alone import in_ros
from robo.bridges.ros2.bridge import Bridge
from robo.bridges.ros2.forms import form_of
from robo.bridges.ros2.networks import join_ros
from robo.launch.plan import CrossingPlan, Ros2Plan
from robo.wire import codec, sources
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Twist, Vector3, encode

RESULTS = Path(__file__).parent / "ROS2_BRIDGE.md"
TWIST = form_of("geometry/Twist")
GID = bytes(range(16))
MESSAGE = encode(Twist(Vector3(0.5), Vector3(z=0.1)))
RATE = 500.0
"""Of round trips, Hz."""
TURN = 4.0
"""How long one of both has it to itself, s."""
FLOOD = 10_000
"""Messages a second on one core."""
WITHIN = 20.0
"""For what is waited, s."""
RULES = {
    "ping": CrossingPlan(ros="/ping", direction="from_ros", type="geometry/Twist"),
    "pong": CrossingPlan(ros="/pong", type="geometry/Twist"),
}


def ros_key(topic: str) -> str:
    return f"0/{topic}/{TWIST.type}/{TWIST.hash}"


def joined(at: str) -> zenoh.Session:
    return open_session(Network(mode="peer", connect=(at,), listen=("tcp/127.0.0.1:0",)))


# -- processes ---------------------------------------------------------------------------------------------------------


def route(robo_at: str, ros_at: str) -> None:
    """Routers in both networks are processes of their own: this is one of them."""
    open_session(Network(mode="router", listen=(ros_at or robo_at,)))


def bridge(robo_at: str, ros_at: str) -> Bridge:
    return Bridge(
        joined(robo_at), join_ros(ros_at), Ros2Plan(topics=RULES, parameters="none", rosout=False), "r1", print
    )


def echo(robo_at: str, _ros_at: str) -> None:
    """A plain client in robo's network: what comes on `ping` goes back on `pong`, with all that robo sends along."""
    session = joined(robo_at)
    for ping, pong in (("r1/ping", "r1/pong"), ("direct/ping", "direct/pong")):
        publisher = session.declare_publisher(pong, encoding=TWIST.encoding)
        channel = session.declare_subscriber(ping, zenoh.handlers.RingChannel(FLOOD))
        threading.Thread(target=_echo, args=(channel, publisher), daemon=True).start()


HELD = ExitStack()
"""What a process has until it ends."""


class Mirror(Node):
    pong = Publisher(Twist, "pong", depth=FLOOD)

    @subscribe("ping", depth=FLOOD)
    def on_ping(self, message: Twist) -> None:
        self.pong.publish(message)


def mirror(robo_at: str, ros_at: str) -> None:
    """A node of robo's, and one that is in ROS by itself."""
    HELD.enter_context(Mirror(name="mirror", namespace="node", session=joined(robo_at)))
    alone: Mirror = HELD.enter_context(Mirror(name="alone", namespace="alone", session=joined(robo_at)))
    HELD.enter_context(in_ros(alone, ros_at, 0))


def _echo(channel: Any, publisher: zenoh.Publisher) -> None:
    source = sources.counted(publisher.id)
    for number in range(1, 2**40):
        sample = channel.handler.recv()
        stamp = codec.pack_attachment(number, time.time_ns())
        publisher.put(sample.payload.to_bytes(), attachment=stamp, source_info=source())


def serve(role: str, robo_at: str, ros_at: str) -> None:
    made = {"router": route, "bridge": bridge, "echo": echo, "mirror": mirror}[role](robo_at, ros_at)
    print("ready", flush=True)
    for _ in sys.stdin:
        print(
            json.dumps([[one.key, one.crossed, one.dropped] for one in made.status().topics] if made else []),
            flush=True,
        )


@contextmanager
def process(role: str, robo_at: str, ros_at: str) -> Iterator["subprocess.Popen[str]"]:
    words = [sys.executable, "-m", "benchmarks.ros2_bridge", "--role", role, "--at", robo_at, ros_at]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as found:
        try:
            assert found.stdout is not None
            assert found.stdout.readline() == "ready\n"
            yield found
        finally:
            found.kill()


# -- measuring ---------------------------------------------------------------------------------------------------------


class Trips:
    """Goes there and back on one pair of topics."""

    def __init__(self, session: zenoh.Session, ping: str, pong: str, *, ros: bool) -> None:
        self._publisher = session.declare_publisher(ping, encoding="application/cdr" if ros else TWIST.encoding)
        self._channel: Any = session.declare_subscriber(pong, zenoh.handlers.RingChannel(FLOOD))
        self._data = TWIST.to_cdr(MESSAGE) if ros else MESSAGE
        self._source = sources.counted(self._publisher.id)
        self._ros, self._number = ros, 0

    def put(self) -> None:
        self._number += 1
        if self._ros:
            self._publisher.put(self._data, attachment=stamps.pack(self._number, time.time_ns(), GID))
        else:
            stamp = codec.pack_attachment(self._number, time.time_ns())
            self._publisher.put(self._data, attachment=stamp, source_info=self._source())

    def trip(self) -> int:
        """Ns."""
        begin = time.perf_counter_ns()
        self.put()
        self._channel.handler.recv()
        return time.perf_counter_ns() - begin

    def settle(self) -> float:
        """Say something until it comes back; how long that took, s."""
        begin = time.monotonic()
        while time.monotonic() < begin + WITHIN:
            self.put()
            time.sleep(0.01)
            if self._channel.handler.try_recv() is not None:
                took = time.monotonic() - begin
                time.sleep(0.3)
                while self._channel.handler.try_recv() is not None:
                    pass
                return took
        raise TimeoutError(f"nothing came back within {WITHIN} s")

    def paced(self, seconds: float) -> list[int]:
        found = []
        due = time.monotonic()
        for _ in range(round(seconds * RATE)):
            found.append(self.trip())
            due = max(due + 1 / RATE, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
        return found

    def flood(self, rate: float, seconds: float) -> int:
        """Say so many a second; how many were said."""
        due, said = time.monotonic(), 0
        end = due + seconds
        while time.monotonic() < end:
            for _ in range(20):
                self.put()
            said += 20
            due += 20 / rate
            time.sleep(max(0.0, due - time.monotonic()))
        return said

    def close(self) -> None:
        self._channel.undeclare()
        self._publisher.undeclare()


def round_trips(robo: zenoh.Session, ros: zenoh.Session, turns: int) -> dict[str, list[int]]:
    ways = {
        "direct": Trips(robo, "direct/ping", "direct/pong", ros=False),
        "through the bridge": Trips(ros, ros_key("ping"), ros_key("pong"), ros=True),
        "a node": Trips(robo, "node/ping", "node/pong", ros=False),
        "a node with --ros2": Trips(ros, ros_key("alone/ping"), ros_key("alone/pong"), ros=True),
    }
    found: dict[str, list[int]] = {name: [] for name in ways}
    order = random.Random(0)
    for way in ways.values():
        way.settle()
    for _ in range(turns):
        names = list(ways)
        order.shuffle(names)
        for name in names:
            ways[name].paced(0.3)
            found[name] += ways[name].paced(TURN)
    for way in ways.values():
        way.close()
    return found


def crossed(worker: "subprocess.Popen[str]", key: str) -> tuple[int, int]:
    """How many have crossed, and how many were lost on the way."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write("\n")
    worker.stdin.flush()
    found = {one: (count, lost) for one, count, lost in json.loads(worker.stdout.readline())}
    return found[key]


def rate(ros: zenoh.Session, worker: "subprocess.Popen[str]", per_second: float, seconds: float) -> list[str]:
    way = Trips(ros, ros_key("ping"), ros_key("nothing"), ros=True)
    time.sleep(1.0)
    before, _ = crossed(worker, "r1/ping")
    about = psutil.Process(worker.pid)
    used = sum(about.cpu_times()[:2])
    said = way.flood(per_second, seconds)
    took = sum(about.cpu_times()[:2]) - used
    time.sleep(1.0)
    after, _ = crossed(worker, "r1/ping")
    way.close()
    return [
        f"{said / seconds:,.0f}",
        f"{after - before:,}",
        f"{said - (after - before):,}",
        f"{100 * took / seconds:.0f} %",
    ]


def heal(make: Callable[[ExitStack], Trips], times: int) -> float:
    """The longest of some times from a new process's first word until it has come back, s."""
    found = []
    for _ in range(times):
        with ExitStack() as stack:
            found.append(make(stack).settle())
    return max(found)


def measure(turns: int, minutes: float) -> list[str]:
    from tests.conftest import free_port

    robo_at, ros_at = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with ExitStack() as stack:
        stack.enter_context(process("router", robo_at, ""))
        stack.enter_context(process("router", "", ros_at))
        worker = stack.enter_context(process("bridge", robo_at, ros_at))
        with process("echo", robo_at, ros_at), process("mirror", robo_at, ros_at):
            robo, ros = joined(robo_at), join_ros(ros_at)
            stack.callback(close_session, robo)
            stack.callback(close_session, ros)
            times = round_trips(robo, ros, turns)
            flood = rate(ros, worker, FLOOD, 10.0)
            calm = rate(ros, worker, 100.0, 60.0 * minutes)

            def new_in_ros(inner: ExitStack) -> Trips:
                session = join_ros(ros_at)
                inner.callback(close_session, session)
                return Trips(session, ros_key("ping"), ros_key("pong"), ros=True)

            in_ros = heal(new_in_ros, 5)

        def new_in_robo(inner: ExitStack) -> Trips:
            inner.enter_context(process("echo", robo_at, ros_at))
            return Trips(ros, ros_key("ping"), ros_key("pong"), ros=True)

        in_robo = heal(new_in_robo, 5)
    return _lines(times, flood, calm, in_ros, in_robo)


def _lines(times: dict[str, list[int]], flood: list[str], calm: list[str], in_ros: float, in_robo: float) -> list[str]:
    tenth, half = {}, {}
    lines = ["| way there and back | p10 µs | p50 µs | p90 µs | p99 µs | n |", "|---|---|---|---|---|---|"]
    for name, found in times.items():
        ordered = sorted(found)
        found_at = [ordered[len(ordered) * part // 1000] / 1e3 for part in (100, 500, 900, 990)]
        tenth[name], half[name], *_ = found_at
        lines.append(f"| {name} | {' | '.join(f'{one:.0f}' for one in found_at)} | {len(ordered):,} |")
    ratios = [one["through the bridge"] / one["direct"] for one in (half, tenth)]
    return [
        *lines,
        "",
        f"Through the bridge a Twist takes {ratios[0]:.2f} times a direct hop (p50); at p10, where other programs",
        f"of the machine are least in the way, {ratios[1]:.2f} times. A node with `--ros2` takes "
        f"{half['a node with --ros2'] / half['a node']:.2f} times one in robo's",
        "network.",
        "",
        "| from ROS, messages/s | crossed | lost | the bridge's processor, of a core |",
        "|---|---|---|---|",
        f"| {' | '.join(flood)} |",
        f"| {' | '.join(calm)} |",
        "",
        f"A node of ROS's that is started anew is answered {in_ros * 1e3:.0f} ms after its first word, one of robo's",
        f"answers {in_robo * 1e3:.0f} ms after it runs (the longest of five each).",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.ros2_bridge", description="Measure, print, write ROS2_BRIDGE.md."
    )
    parser.add_argument("--turns", type=int, default=8, help="turns of four seconds of each way (default 8)")
    parser.add_argument("--minutes", type=float, default=1.0, help="of a hundred messages a second (default 1)")
    parser.add_argument("--role", choices=["router", "bridge", "echo", "mirror"], help=argparse.SUPPRESS)
    parser.add_argument("--at", nargs=2, default=("", ""), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.role:
        serve(given.role, *given.at)
        return
    load = os.getloadavg()[0]
    found = measure(given.turns, given.minutes)
    lines = [
        "# A Twist through the bridge to ROS 2",
        "",
        "Written by `python -m benchmarks.ros2_bridge`.",
        "",
        *machine(),
        *(__doc__ or "").split("\n\n", 1)[1].splitlines(),
        "",
        f"The load of the machine was {load:.1f} before and {os.getloadavg()[0]:.1f} after it: on a busy one each hop",
        "waits for its turn, and what is measured is that.",
        "",
        *found,
        "",
    ]
    text = "\n".join(lines)
    print(text)
    RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
