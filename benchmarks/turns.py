"""`python -m benchmarks.turns`: how soon an emergency stop answers while its node computes; writes TURNS.md.

The node computes in a timer's callback, in pure Python, for 2 s at a time and nearly without a pause. A
client in another process calls its services at random moments, over one unix socket; a time is that from
the call to the answer. Two services have a turn of their own: one publishes a zero command, the other
also writes the stop down before it answers (`node.memory`), as the safety monitor does. The third shares the
node's turn and is there for comparison. With `5 ms` Python's threads give way to each other as Python
has it, with `1 ms` as in the process of every node. `idle`: nothing is computed.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.__main__ import Spread, machine
from robo import Network, Node, Publisher, open_session, service, timer
from robo.node.memory import Memory
from robo.process.runner import SWITCH_INTERVAL
from robo_messages import Trigger, Twist

RESULTS = Path(__file__).parent / "TURNS.md"

LIMIT = 20.0
"""Within this, at its 99th percentile, an emergency stop answers, ms."""

VARIANTS = {
    "idle, 5 ms": (0.0, 0.005),
    "computing, 5 ms": (2.0, 0.005),
    f"computing, {SWITCH_INTERVAL * 1e3:g} ms": (2.0, SWITCH_INTERVAL),
}
"""How long the node computes at a time, s, and after what time threads give way, s."""

SERVICES = {"own turn": "stop", "own turn, written down": "stop_and_keep", "node's turn": "stop_in_turn"}


class Busy(Node):
    """Computes, and can be stopped all the same."""

    command = Publisher(Twist, "cmd_vel")
    seconds = 0.0
    """How long it computes at a time."""

    @timer(rate=100.0)
    def plan(self) -> None:
        end = time.monotonic() + self.seconds
        while time.monotonic() < end:
            sum(i * i for i in range(200))

    @service("stop", turn="stop")
    def stop(self, _: Trigger.Request) -> Trigger.Response:
        self.command.publish(Twist())
        return Trigger.Response(message="stopped")

    @service("stop_and_keep", turn="stop")
    def stop_and_keep(self, request: Trigger.Request) -> Trigger.Response:
        answer = self.stop(request)
        self.memory.keep("stopped", True)
        return answer

    @service("stop_in_turn")
    def stop_in_turn(self, request: Trigger.Request) -> Trigger.Response:
        return self.stop(request)


class Caller(Node):
    """Calls."""


def serve(endpoint: str, seconds: float, interval: float) -> None:
    """Be the node that computes, until the input ends."""
    sys.setswitchinterval(interval)
    node = Busy(session=open_session(Network(mode="peer", listen=(endpoint,))))
    node.seconds, node.memory = seconds, Memory(endpoint.partition("/")[2] + ".json")
    node.start()
    print("ready", flush=True)
    sys.stdin.read()
    os._exit(0)  # what it computes keeps nobody waiting


def times(seconds: float, interval: float, calls: dict[str, int]) -> dict[str, list[float]]:
    """How long each call of each service took, ms."""
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as folder:
        endpoint = f"unixsock-stream/{folder}/busy.sock"
        command = [sys.executable, "-m", "benchmarks.turns", "--serve", endpoint, str(seconds), str(interval)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as busy:
            assert busy.stdout is not None
            busy.stdout.readline()
            session = open_session(Network(mode="peer", connect=(endpoint,)))
            try:
                with Caller(session=session) as caller:
                    return {name: _called(caller, SERVICES[name], count) for name, count in calls.items()}
            finally:
                session.close()
                busy.kill()


def _called(caller: Node, name: str, count: int) -> list[float]:
    client = caller.create_client(Trigger.Request, Trigger.Response, name, timeout=60.0)
    client(Trigger.Request())
    found = []
    for _ in range(count):
        time.sleep(random.uniform(0.002, 0.02))
        begin = time.perf_counter()
        client(Trigger.Request())
        found.append((time.perf_counter() - begin) * 1e3)
    return found


def table(rounds: int, count: int) -> list[str]:
    """The figures, a line for each service and variant."""
    figures: dict[tuple[str, str], tuple[list[float], list[float], list[float]]] = {}
    for index in range(rounds):
        for variant, (seconds, interval) in VARIANTS.items():
            # In the node's turn each call waits for the end of a computation: a few say it.
            calls = {name: 2 if seconds and name == "node's turn" else count for name in SERVICES}
            for name, found in times(seconds, interval, calls).items():
                p50, p99, most = figures.setdefault((name, variant), ([], [], []))
                p50.append(_share(found, 0.5))
                p99.append(_share(found, 0.99))
                most.append(max(found))
        print(f"  turns: round {index + 1} of {rounds}", file=sys.stderr)
    lines = ["| the service has | the node is | p50 ms | p99 ms | most ms |", "|---|---|---|---|---|"]
    for (name, variant), spreads in figures.items():
        lines.append(" | ".join([f"| {name}", variant, *(Spread.of(one).text(".1f") for one in spreads)]) + " |")
    name, variant = list(SERVICES)[1], list(VARIANTS)[-1]
    reached = Spread.of(figures[name, variant][1]).median
    verdict = "holds" if reached <= LIMIT else "DOES NOT HOLD"
    text = f"An emergency stop that is written down answers within {LIMIT:g} ms (p99) beside a computation: {verdict},"
    return [*lines, "", f"{text} {reached:.1f} ms.", ""]


def _share(values: Sequence[float], part: float) -> float:
    return sorted(values)[min(len(values) - 1, int(len(values) * part))]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.turns", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each measurement (default 5)")
    parser.add_argument("--calls", type=int, default=100, help="calls of a round (default 100)")
    parser.add_argument("--quick", action="store_true", help="one short round; writes no results")
    parser.add_argument("--serve", nargs=3, metavar=("ENDPOINT", "S", "S"), help="be the node that computes")
    options = parser.parse_args()
    if options.serve:
        endpoint, seconds, interval = options.serve
        serve(endpoint, float(seconds), float(interval))
    rounds, calls = (1, 50) if options.quick else (options.rounds, options.calls)
    head = f"Written by `python -m benchmarks.turns`: medians over {rounds} rounds of {calls} calls (smallest-largest)."
    about = (__doc__ or "").split("\n\n", 1)[1].splitlines()
    text = "\n".join(["# An emergency stop with a turn of its own", "", head, "", *machine(), *about, ""])
    text = "\n".join([text, *table(rounds, calls)])
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
