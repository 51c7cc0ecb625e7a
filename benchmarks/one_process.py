"""`python -m benchmarks.one_process`: several nodes in one process beside as many processes.

Messages: a Twist there and back between two nodes, both turns included, in one process and in two on one unix socket,
in short blocks in turn. Memory: nodes of one class under `robo up`, in one process and each in its own, as `robo ps`
tells it after a second.
"""

import argparse
import json
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import msgspec

from benchmarks.__main__ import BLOCK, WARM_UP, Bench, Spread, Worker, in_blocks, machine, measure

RESULTS = Path(__file__).parent / "ONE_PROCESS.md"
NODES = 10
SERVICES = ("velocity_controller", "position_tracker", "safety_monitor")
ALLOWED = 1.5
"""What each of ten nodes may take beyond one, MB."""


def _trips(folder: str, rounds: int, blocks: int) -> list[str]:
    times: dict[str, list[int]] = {"one process": [], "two processes": []}
    with ExitStack() as stack:
        pings = {
            "one process": stack.enter_context(
                Worker("worker", "both", "robo", "twist", f"unixsock-stream/{folder}/both.sock", "")
            ),
            "two processes": Bench(folder).pair(stack, "echo", "ping", "robo", "twist")[1],
        }

        def block(variant: str) -> None:
            trips = msgspec.json.decode(pings[variant].ask(WARM_UP + BLOCK), type=list[int])
            times[variant] += trips[WARM_UP:]

        for ping in pings.values():
            ping.ask(300)
        in_blocks(rounds, blocks, [*times], block, "nodes of one process")
    size = blocks * BLOCK
    medians: dict[str, float] = {}
    rows = []
    for variant, found in times.items():
        ordered = [sorted(found[start : start + size]) for start in range(0, len(found), size)]
        half = Spread.of([one[len(one) // 2] / 1e3 for one in ordered])
        tail = Spread.of([one[len(one) * 99 // 100] / 1e3 for one in ordered])
        medians[variant] = half.median
        rows.append(f"| {variant} | {half.text('.1f')} | {tail.text('.0f')} |")
    ratio = medians["two processes"] / medians["one process"]
    head = ["| a Twist there and back | p50 µs | p99 µs |", "|---|---|---|"]
    return [*head, *rows, "", f"Within one process {ratio:.1f} times as fast.", ""]


def _memory(rounds: int) -> list[str]:
    def once(variant: str) -> float:
        service, count, where = variant.split()
        return _resident(service, int(count), together=where == "together")

    lines = [
        f"| node | one alone, MB | {NODES} in one process | each more | {NODES} processes |",
        "|---|---|---|---|---|",
    ]
    for service in SERVICES:
        variants = [f"{service} 1 together", f"{service} {NODES} together", f"{service} {NODES} apart"]
        found = measure(rounds, variants, once, "memory of nodes")
        one, together, apart = (Spread.of(found[variant]) for variant in variants)
        each = (statistics.median(found[variants[1]]) - statistics.median(found[variants[0]])) / NODES
        lines.append(
            f"| {service} | {one.text('.1f')} | {together.text('.1f')} | {each:.2f}, of {ALLOWED} allowed |"
            f" {apart.text('.0f')} |"
        )
    return [*lines, ""]


def _resident(service: str, count: int, *, together: bool) -> float:
    """The resident memory of so many nodes, MB; where each has its own process, of all of these."""
    endpoint = f"tcp/127.0.0.1:{_free_port()}"
    robo = [sys.executable, "-m", "robo"]
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as folder:
        manifest = Path(folder) / "nodes.yaml"
        shared = "process: team, " if together else ""
        node = f"{{service: robo_services.{service}, replicas: {count}}}"
        manifest.write_text(f"groups: {{g: {{{shared}nodes: {{node: {node}}}}}}}\n", encoding="utf-8")
        up = [*robo, "up", "-d", "--wait", str(manifest), "--robot-name", "bench", "--listen", endpoint]
        subprocess.run(up, capture_output=True, check=True)
        time.sleep(1.0)  # their timers tick: what they allocate belongs to the nodes
        try:
            told = subprocess.run([*robo, "ps", "--json", "--connect", endpoint], capture_output=True, check=True)
        finally:
            subprocess.run([*robo, "down", "--connect", endpoint], capture_output=True, check=True)
    nodes = [json.loads(line) for line in told.stdout.splitlines()]
    by_process = {node["pid"]: int(node["memory"]) for node in nodes}
    return sum(by_process.values()) / 1e6


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port: int = s.getsockname()[1]
        return port


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.one_process", description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each measurement (default 5)")
    parser.add_argument("--quick", action="store_true", help="one short round; writes no results")
    options = parser.parse_args()
    rounds, blocks = (1, 4) if options.quick else (options.rounds, 20)
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as folder:
        lines = [
            "# Several nodes in one process",
            "",
            f"Written by `python -m benchmarks.one_process`: medians over {rounds} rounds (smallest-largest).",
            "",
            *machine(),
            *(__doc__ or "").split("\n\n", 1)[1].splitlines(),
            "",
            *_trips(folder, rounds, blocks),
            *_memory(rounds),
        ]
    text = "\n".join(lines)
    print(text)
    if not options.quick:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
