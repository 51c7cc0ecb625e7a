"""`python -m benchmarks.node_tests`: how long a unit test of a node takes, and one that lets a minute pass.

Prints the least, the median and the 90th percentile of many runs in one process. It fails where the median of a
whole test is more than 20 ms, or that of 60 s at 20 Hz more than 100 ms.
"""

import statistics
import sys
import time
from collections.abc import Sequence

import robo
from robo import Node, Publisher, subscribe, timer
from robo.testing.bench import Bench
from robo.testing.leaks import Before
from robo.testing.node import RunNode
from robo.wire.session import close_session
from robo_messages import String

RUNS = 30
RATES = (10.0, 20.0, 50.0, 100.0)
MOST_FOR_A_TEST = 0.02
MOST_FOR_A_MINUTE = 0.1
"""s."""


class Echo(Node):
    """Says what it hears, and something else at a steady rate."""

    class Parameters(robo.Parameters):
        """How fast."""

        rate: float = 1.0

    parameters: Parameters

    said = Publisher(String, "said")

    @subscribe("heard")
    def on_heard(self, message: String) -> None:
        self.said.publish(message)

    @timer(rate="rate")
    def tick(self) -> None:
        self.said.publish(String("tick"))


def whole_test() -> float:
    """What the fixtures and a test do that sends one message, s."""
    begin = time.perf_counter()
    before = Before()
    session = robo.open_session(robo.Network(mode="peer"))
    bench = Bench(session, patience=10.0)
    node = RunNode(bench)(Echo)
    node.send("heard", String("hello"))
    assert node.published("said") == [String("hello")]
    bench.close()
    close_session(session)
    before.check()
    return time.perf_counter() - begin


def minute(rate: float) -> float:
    """How long it takes to let 60 s pass for a timer, s."""
    session = robo.open_session(robo.Network(mode="peer"))
    bench = Bench(session, patience=10.0)
    node = RunNode(bench)(Echo, rate=rate)
    begin = time.perf_counter()
    bench.clock.advance(60.0)
    took = time.perf_counter() - begin
    assert len(node.published("said")) == 60 * rate
    bench.close()
    close_session(session)
    return took


def told(what: str, times: Sequence[float]) -> float:
    """Print how long something took. Returns the median."""
    median, high = statistics.median(times), statistics.quantiles(times, n=10)[-1]
    print(
        f"{what:24} {min(times) * 1e3:6.1f} ms at least, {median * 1e3:6.1f} median, {high * 1e3:6.1f} in 9 of 10 runs"
    )
    return median


def main() -> None:
    """Measure, print, and exit with 1 where a limit is broken."""
    whole_test()  # what is imported once
    fine = told("a test with one message", [whole_test() for _ in range(RUNS)]) <= MOST_FOR_A_TEST
    for rate in RATES:
        median = told(f"60 s at {rate:g} Hz", [minute(rate) for _ in range(RUNS)])
        fine = fine and (rate > 20.0 or median <= MOST_FOR_A_MINUTE)
    sys.exit(0 if fine else 1)


if __name__ == "__main__":
    main()
