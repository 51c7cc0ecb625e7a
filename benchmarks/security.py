"""`python -m benchmarks.security`: what TLS and rules cost, and how long a change of them is felt; writes SECURITY.md.

Two processes, 64 bytes there and back, through one router in a process of its own (`robo router`): in the clear and
without rules, and with mutual TLS and the rules of 200 robots, in turn, while refusals are read from Zenoh's log.
`door` is the way into a robot: through its door and the router behind; in the clear that is one router. `rules` is the
time from a policy of so many robots to a router that listens. `outage` is the longest pause in a topic at 100 Hz,
through a router whose certificate is renewed.
"""

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from benchmarks.__main__ import Spread, _free_port, machine
from robo import Network, open_session
from robo.environment import NETWORK_VARIABLE
from robo.security import policy
from robo.security.keystore import Keystore
from robo.security.policy import Entry, Policy
from robo.supervisor.early import base_environment
from robo.wire import tcp
from robo.wire.session import close_session

RESULTS = Path(__file__).parent / "SECURITY.md"
LIMIT = 1.2
"""With TLS and rules a round trip takes at most so many times as long."""
ROBOTS = 200
MOST_FOR_RULES = 1.0
"""s."""
MOST_OUTAGE = 0.5
"""s."""
_SIZE = 64


def keystore(folder: Path, robots: int) -> Keystore:
    """A keystore of some who talk, and so many robots in its policy."""
    store = Keystore(folder / "security")
    store.init("bench")
    for name in ("site", "other"):
        store.add(name, "router", (), 1)
    store.add("r1", "robot", (), 1)
    for name in ("ann", "ben"):
        store.add(name, "operator", (), 1)
    known = store.policy()
    many = {f"m{number}": Entry(role="robot") for number in range(robots)}
    grown = Policy(names={**known.names, **many}, roles=known.roles)
    store.policy_file.write_text(policy.text_of(grown))
    store.write_rules(grown)
    return store


@contextmanager
def router(endpoint: str, *options: str) -> Iterator[None]:
    """While this goes on, a router that listens at an endpoint."""
    command = [sys.executable, "-m", "robo", "router", "--listen", endpoint, *options]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            while next(tcp.answering([endpoint], 1.0), None) is None:
                time.sleep(0.002)
            yield
        finally:
            process.terminate()


@contextmanager
def echo(endpoint: str, security: str, ping: str = "bench/ping", pong: str = "bench/pong") -> Iterator[None]:
    """While this goes on, a process that says again what it hears."""
    command = [sys.executable, "-m", "benchmarks.security", "--echo", endpoint, security, ping, pong]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        try:
            yield
        finally:
            process.kill()


def serve(endpoint: str, security: str, ping: str, pong: str) -> None:
    session = open_session(Network(mode="client", connect=(endpoint,), security=security))
    publisher = session.declare_publisher(pong, congestion_control=zenoh.CongestionControl.BLOCK, express=True)
    at_once: Any = zenoh.handlers.Callback(lambda sample: publisher.put(sample.payload), indirect=False)
    session.declare_subscriber(ping, at_once)
    print("ready", flush=True)
    sys.stdin.read()


def round_trips(
    endpoint: str, security: str, count: int, ping: str = "bench/ping", pong: str = "bench/pong"
) -> list[float]:
    """How long each of some messages takes there and back, µs."""
    session = open_session(Network(mode="client", connect=(endpoint,), security=security))
    came = threading.Event()
    at_once: Any = zenoh.handlers.Callback(lambda _: came.set(), indirect=False)
    heard = session.declare_subscriber(pong, at_once)
    publisher = session.declare_publisher(ping, congestion_control=zenoh.CongestionControl.BLOCK, express=True)
    found = []
    try:
        while not came.is_set():  # until both ends know of each other
            publisher.put(b"x" * _SIZE)
            came.wait(0.05)
        time.sleep(0.2)
        for _ in range(count):
            came.clear()
            begin = time.perf_counter()
            publisher.put(b"x" * _SIZE)
            came.wait(5.0)
            found.append((time.perf_counter() - begin) * 1e6)
    finally:
        heard.undeclare()
        close_session(session)
    return found


def robot_router(stack: ExitStack, folder: Path, endpoint: str, security: str) -> str:
    """A robot's router, as its supervisor starts it: the endpoint of its own nodes."""
    own = f"unixsock-stream/{folder}/{'door' if security else 'plain'}.sock"
    network = Network(mode="router", listen=(own, endpoint), name="r1", security=security)
    process = subprocess.Popen(
        [sys.executable, "-m", "robo.process.router"],
        env={**base_environment(), NETWORK_VARIABLE: msgspec.json.encode(network).decode()},
        stderr=subprocess.DEVNULL,
    )
    stack.callback(process.wait)
    stack.callback(process.terminate)
    while next(tcp.answering([endpoint], 1.0), None) is None:
        time.sleep(0.002)
    return own


def through_a_router(store: Keystore, count: int, *, secured: bool) -> list[float]:
    endpoint = f"{'tls' if secured else 'tcp'}/127.0.0.1:{_free_port()}"
    ann, ben = (str(store.name_folder(name)) if secured else "" for name in ("ann", "ben"))
    options = ["--security", str(store.name_folder("site"))] if secured else []
    with router(endpoint, *options), echo(endpoint, ben):
        return round_trips(endpoint, ann, count)


def into_a_robot(store: Keystore, folder: Path, count: int, *, secured: bool) -> list[float]:
    endpoint = f"{'tls' if secured else 'tcp'}/127.0.0.1:{_free_port()}"
    security = str(store.name_folder("r1")) if secured else ""
    with ExitStack() as stack:
        own = robot_router(stack, folder, endpoint, security)
        stack.enter_context(echo(own, "", "r1/ping", "r1/pong"))
        ann = str(store.name_folder("ann")) if secured else ""
        return round_trips(endpoint, ann, count, "r1/ping", "r1/pong")


def loads_rules(folder: Path, robots: int) -> float:
    """How much longer a router takes from its policy until it listens, with the rules of so many robots, s."""
    found = []
    for count in (0, robots):
        store = keystore(folder / f"rules{count}-{time.monotonic_ns()}", count)
        known = store.policy()
        begin = time.perf_counter()
        store.write_rules(known)
        endpoint = f"tls/127.0.0.1:{_free_port()}"
        network = Network(mode="router", listen=(endpoint,), security=str(store.name_folder("site")))
        session = open_session(network)
        while next(tcp.answering([endpoint], 1.0), None) is None:
            time.sleep(0.001)
        found.append(time.perf_counter() - begin)
        close_session(session)
    return found[1] - found[0]


def outage(store: Keystore) -> float:
    """The longest pause of a topic at 100 Hz while its router's certificate is renewed, s."""
    endpoint = f"tls/127.0.0.1:{_free_port()}"
    with router(endpoint, "--security", str(store.name_folder("site"))):
        one, other = (
            open_session(Network(mode="client", connect=(endpoint,), security=str(store.name_folder(name))))
            for name in ("ann", "ben")
        )
        times: list[float] = []
        heard = other.declare_subscriber("bench/beat", lambda _: times.append(time.perf_counter()))
        publisher = one.declare_publisher("bench/beat")

        def beat(seconds: float) -> None:
            end = time.perf_counter() + seconds
            while time.perf_counter() < end:
                publisher.put(b"x")
                time.sleep(0.01)

        beat(1.0)
        begin = time.perf_counter()
        store.renew(["site"], 1)
        beat(3.0)
        heard.undeclare()
        for session in (one, other):
            close_session(session)
    felt = [begin, *(at for at in times if at >= begin)]
    return max(later - earlier for earlier, later in pairwise(felt))


def _share(values: Sequence[float], part: float) -> float:
    return sorted(values)[min(len(values) - 1, int(len(values) * part))]


def table(rounds: int, count: int) -> list[str]:
    """The figures."""
    p50: dict[str, list[float]] = {}
    p99: dict[str, list[float]] = {}
    rules: dict[int, list[float]] = {ROBOTS: [], 10 * ROBOTS: []}
    pauses = []
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as name:
        folder = Path(name)
        store = keystore(folder, ROBOTS)
        for index in range(rounds):
            for way, secured in (("router", False), ("router", True), ("door", False), ("door", True)):
                word = "TLS and rules" if secured else "in the clear"
                if way == "router":
                    found = through_a_router(store, count, secured=secured)
                else:
                    found = into_a_robot(store, folder, count, secured=secured)
                p50.setdefault(f"{way} | {word}", []).append(_share(found, 0.5))
                p99.setdefault(f"{way} | {word}", []).append(_share(found, 0.99))
            for robots, took in rules.items():
                took.append(loads_rules(folder, robots))
            pauses.append(outage(store))
            print(f"  security: round {index + 1} of {rounds}", file=sys.stderr)
    lines = ["| through | | p50 µs | p99 µs |", "|---|---|---|---|"]
    lines += [f"| {one} | {Spread.of(p50[one]).text('.0f')} | {Spread.of(p99[one]).text('.0f')} |" for one in p50]
    lines += ["", "| | s |", "|---|---|"]
    lines += [f"| rules of {robots} robots | {Spread.of(took).text('.2f')} |" for robots, took in rules.items()]
    lines += [f"| outage, a router's certificate renewed | {Spread.of(pauses).text('.2f')} |", ""]
    load, felt = Spread.of(rules[ROBOTS]).median, Spread.of(pauses).median
    ratio = Spread.of([b / a for a, b in zip(p50["router | in the clear"], p50["router | TLS and rules"], strict=True)])
    for what, value, limit in (
        (f"A round trip with TLS and rules takes {ratio.median:.2f} times as long", ratio.median, LIMIT),
        (f"Rules of {ROBOTS} robots take {load:.2f} s", load, MOST_FOR_RULES),
        (f"A renewal is felt for {felt:.2f} s", felt, MOST_OUTAGE),
    ):
        lines.append(f"- {what}, at most {limit:g}: {'holds' if value <= limit else 'DOES NOT HOLD'}.")
    return [*lines, ""]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.security", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each measurement (default 5)")
    parser.add_argument("--messages", type=int, default=2000, help="messages of a round (default 2000)")
    parser.add_argument("--quick", action="store_true", help="one short round; writes no results")
    parser.add_argument("--echo", nargs=4, metavar=("ENDPOINT", "DIR", "KEY", "KEY"), help="be the other process")
    options = parser.parse_args()
    if options.echo:
        serve(*options.echo)
        return
    rounds, count = (1, 300) if options.quick else (options.rounds, options.messages)
    head = f"Written by `python -m benchmarks.security`: medians over {rounds} rounds of {count} messages (extremes)."
    about = (__doc__ or "").split("\n\n", 1)[1].splitlines()
    text = "\n".join(["# What security costs", "", head, "", *machine(), *about, "", *table(rounds, count)])
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
