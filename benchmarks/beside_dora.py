"""`python -m benchmarks.beside_dora DORA`: the same small dataflow with robo and with dora, in turn.

A node sends bytes, a second one sends them back; each is a process with a Python node, started by `robo up` or by
`dora run`. A round trip begins when the one before it is over. *First* is the time from the command to the end of the
first round trip, *memory* what is resident of the node that measures. DORA is the program of an environment of its own:
`python3 -m venv DIR && DIR/bin/pip install dora-rs dora-rs-cli`, then `DIR/bin/dora`. It writes DORA.md.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

RESULTS = Path(__file__).parent / "DORA.md"
SIZES = {64: 1000, 1_000_000: 500, 6_000_000: 100}
"""Bytes of a message, and how many round trips of it are timed."""
LIMIT = 120.0
"""How long one run may take, s."""

MEASURE = """
import json, os, time

SIZE, TRIPS, BEGUN = int(os.environ["SIZE"]), int(os.environ["TRIPS"]), float(os.environ["BEGUN"])


class Trips:
    def __init__(self, send):
        self.send, self.sent, self.first, self.times = send, None, None, []

    def begin(self):
        if self.sent is None or time.perf_counter() - self.sent > 1.0:  # nobody was there
            self.go()

    def go(self):
        self.sent = time.perf_counter()
        self.send()

    def back(self):
        now = time.perf_counter()
        if self.first is None:
            self.first = time.time() - BEGUN
        else:
            self.times.append(now - self.sent)
        if len(self.times) < TRIPS:
            self.go()
            return False
        with open("/proc/self/statm") as file:
            memory = int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        times = sorted(self.times)
        p50, p99 = times[len(times) // 2], times[len(times) * 99 // 100]
        print("RESULT " + json.dumps([p50, p99, self.first, memory]), flush=True)
        return True
"""
WITH_ROBO = {
    "measure.py": MEASURE,
    "nodes.py": """
from measure import SIZE, Trips
from robo import Node, Publisher, subscribe, timer
from robo_messages import Image


class Ping(Node):
    ping = Publisher(Image, "ping")

    def on_start(self):
        image = Image(data=bytes(SIZE))
        self.trips, self.over = Trips(lambda: self.ping.publish(image)), False

    @timer(rate=50.0)
    def tick(self):
        if not self.over:
            self.trips.begin()

    @subscribe("pong")
    def on_pong(self, image: Image):
        self.over = self.trips.back()
        if self.over:
            self.shutdown()


class Pong(Node):
    pong = Publisher(Image, "pong")

    @subscribe("ping")
    def on_ping(self, image: Image):
        self.pong.publish(image)
""",
    "flow.yaml": """
groups:
  flow:
    nodes:
      ping: {service: "nodes:Ping", required: true}
      pong: {service: "nodes:Pong"}
""",
}
WITH_DORA = {
    "measure.py": MEASURE,
    "ping.py": """
import numpy, pyarrow
from dora import Node
from measure import SIZE, Trips

node, data = Node(), pyarrow.array(numpy.zeros(SIZE, dtype=numpy.uint8))
trips = Trips(lambda: node.send_output("ping", data))
for event in node:
    if event["type"] == "INPUT" and event["id"] == "tick":
        trips.begin()
    elif event["type"] == "STOP" or (event["type"] == "INPUT" and trips.back()):
        break
""",
    "pong.py": """
from dora import Node

node = Node()
for event in node:
    if event["type"] == "INPUT":
        node.send_output("pong", event["value"])
    elif event["type"] == "STOP":
        break
""",
    "flow.yaml": """
nodes:
  - {id: ping, path: ping.py, inputs: {tick: dora/timer/millis/20, pong: pong/pong}, outputs: [ping]}
  - {id: pong, path: pong.py, inputs: {ping: ping/ping}, outputs: [pong]}
""",
}


class Run(NamedTuple):
    """What the node that measures has seen."""

    p50: float
    """Of the round trips, s."""
    p99: float
    """s."""
    first: float
    """s from the command on."""
    memory: int
    """Bytes."""


def main() -> None:
    """Run both in turn, print a table and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dora", type=Path, help="the program dora")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    dora = options.dora.absolute()
    path = {"PATH": f"{dora.parent}{os.pathsep}{os.environ['PATH']}"}
    version = subprocess.run([dora, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    runs: dict[tuple[int, str], list[Run]] = {}
    for _ in range(options.rounds):
        for size, trips in SIZES.items():
            with tempfile.TemporaryDirectory() as logs:
                up = [
                    sys.executable,
                    "-m",
                    "robo",
                    "up",
                    "flow.yaml",
                    "--robot-name",
                    "flow",
                    "--listen",
                    "tcp/127.0.0.1:0",
                ]
                here = {"ROBO_LOG_DIR": logs, "PYTHONPATH": "."}
                runs.setdefault((size, "robo"), []).append(run(up, WITH_ROBO, size, trips, here))
            runs.setdefault((size, "dora"), []).append(
                run([str(dora), "run", "flow.yaml"], WITH_DORA, size, trips, path)
            )
    lines = ["| message | | p50 | p99 | first | memory |", "|---" * 6 + "|"]
    lines += [row(f"{size:,} bytes", name, seen) for (size, name), seen in runs.items()]
    print("\n".join(lines))
    about = f"{os.cpu_count()} cores, Linux {platform.release()}, CPython {platform.python_version()}, {version}."
    medians = f"Medians of {options.rounds} runs each, the smallest and the largest in brackets."
    RESULTS.write_text("\n".join(["# Beside dora", "", f"Written by {__doc__}", f"{about} {medians}", "", *lines, ""]))


def run(command: Sequence[str], files: Mapping[str, str], size: int, trips: int, environment: Mapping[str, str]) -> Run:
    """One run, in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text)
        told = {"SIZE": str(size), "TRIPS": str(trips), "BEGUN": str(time.time())}
        ended = subprocess.run(
            command, cwd=folder, env={**os.environ, **environment, **told}, capture_output=True, text=True,
            timeout=LIMIT, check=False,
        )  # fmt: skip
        _, found, result = (ended.stdout + ended.stderr).partition("RESULT ")
        if not found:
            sys.exit(f"{command[0]} has measured nothing:\n{ended.stdout}{ended.stderr}")
        return Run(*json.loads(result.partition("\n")[0]))


def row(message: str, name: str, seen: Sequence[Run]) -> str:
    """A line of the table."""
    p50, p99 = ([of * 1e3 for of in times] for times in zip(*((one.p50, one.p99) for one in seen), strict=True))
    cells = [
        *(f"{statistics.median(of):.2f} ms ({min(of):.2f}-{max(of):.2f})" for of in (p50, p99)),
        f"{statistics.median(one.first for one in seen):.2f} s",
        f"{statistics.median(one.memory for one in seen) / 1e6:.0f} MB",
    ]
    return f"| {message} | {name} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
