"""`python -m benchmarks.fleet [ROBOTS]`: many light robots on this machine, under one router; writes FLEET.md.

Each robot is a supervisor, a router that dials the common one, and one node. Told is how long it takes until a
client of the common router sees all of them, what they hold and use at rest, and whether anything links robot to robot.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import psutil

from benchmarks.__main__ import machine
from robo.tools import nodes, runs
from robo.wire import admin
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

PORT = 17447
MANIFEST = """
groups:
  light:
    namespace: ${robot_name}
    nodes: {position_tracker: {service: robo_services.position_tracker}}
"""
ROUNDS = 5
"""How often they are started; told is the median, with the smallest and the largest."""
REST = 10.0
"""How long they are watched at rest, s."""


RESULTS = Path(__file__).parent / "FLEET.md"


def main(robots: int) -> None:
    lines = list(measure(robots))
    text = "\n".join([f"# A fleet of {robots} light robots", "", *machine(), *(f"- {line}" for line in lines), ""])
    RESULTS.write_text(text)
    print(text)


def one_run(folder: str, robots: int) -> str:
    """The same robots by one supervisor, with one router for all."""
    manifest = Path(folder) / "fleet.yaml"
    nodes_text = "{position_tracker: {service: robo_services.position_tracker}}"
    manifest.write_text(f"groups: {{light: {{replicas: {robots}, namespace: 'r${{index}}', nodes: {nodes_text}}}}}\n")
    endpoint = f"tcp/127.0.0.1:{PORT}"
    robo = [sys.executable, "-m", "robo"]
    begin = time.monotonic()
    command = [*robo, "up", str(manifest), "-d", "--wait", "--robot-name", "fleet", "--listen", endpoint]
    subprocess.run(command, check=True, capture_output=True)
    took = time.monotonic() - begin
    subprocess.run([*robo, "down", "--connect", endpoint], check=True, capture_output=True)
    return f"as one run of {robots} robots, one node each: all ready {took:.2f} s after the command"


def measure(robots: int) -> Iterator[str]:
    site = f"tcp/127.0.0.1:{PORT}"
    robo = [sys.executable, "-m", "robo"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        manifest = Path(folder) / "light.yaml"
        manifest.write_text(MANIFEST)
        yield one_run(folder, robots)

        def start(*words: str, until: ExitStack = stack) -> subprocess.Popen[bytes]:
            process = subprocess.Popen([*robo, *words], **quiet)  # type: ignore[call-overload]
            until.callback(process.wait, 20)
            until.callback(process.terminate)
            started: subprocess.Popen[bytes] = process
            return started

        def start_all(until: ExitStack) -> list[subprocess.Popen[bytes]]:
            """All robots, as soon as they are seen; how long that took is in `took`."""
            begin = time.monotonic()
            started = []
            for i in range(1, robots + 1):
                listen = ("--listen", f"tcp/127.0.0.1:{PORT + i}", "--connect", site)
                started.append(start("up", str(manifest), "--robot-name", f"r{i}", *listen, until=until))
            while len(nodes.list_nodes(session)) < robots:
                time.sleep(0.02)
            took.append(time.monotonic() - begin)
            return started

        took: list[float] = []
        router = start("router", "--listen", site)
        session = open_session(Network(mode="client", connect=(site,), timeout=10))
        stack.callback(close_session, session)
        for _ in range(ROUNDS - 1):
            with ExitStack() as ended:
                start_all(ended)
            while nodes.list_nodes(session):
                time.sleep(0.02)
        processes = [router, *start_all(stack)]
        seen = time.time()
        figures = f"{statistics.median(took):.2f} s ({min(took):.2f}-{max(took):.2f})"
        yield (f"{robots} robots: all seen {figures} after the first command")
        while len(ready := [e.time * 1e-9 for e in runs.EventStream(session).past() if e.event == "ready"]) < robots:
            time.sleep(0.05)
        yield (f"the last one: seen {max(0.0, seen - max(ready)) * 1e3:.0f} ms after it was ready by its own word")

        # One that comes to the others: what discovery itself takes.
        late = start(
            "up", str(manifest), "--robot-name", "late", "--listen", f"tcp/127.0.0.1:{PORT - 1}", "--connect", site
        )
        begin = time.monotonic()
        while len(nodes.list_nodes(session)) < robots + 1:
            time.sleep(0.005)
        yield (f"one more: seen {time.monotonic() - begin:.2f} s after its command")
        fresh = open_session(Network(mode="client", connect=(site,)))
        begin = time.monotonic()
        assert len(nodes.list_nodes(fresh)) == robots + 1
        yield (f"a new client knows all of them within {(time.monotonic() - begin) * 1e3:.0f} ms")
        close_session(fresh)

        family = [psutil.Process(p.pid) for p in (*processes, late)]
        family += [child for p in family for child in p.children(recursive=True)]
        time.sleep(3)
        before = sum(sum(p.cpu_times()[:2]) for p in family)
        time.sleep(REST)
        used = (sum(sum(p.cpu_times()[:2]) for p in family) - before) / REST
        resident = sum(p.memory_info().rss for p in family)
        yield (f"at rest: {len(family)} processes, {resident / 1e6:.0f} MB resident, {used:.1%} of a core")

        found = admin.routers(session, 5.0)
        own = {router.zid: router for router in found}
        centre = next(router for router in found if router.name == "router")
        between = [
            (router.name, own[one.zid].name)
            for router in found
            for one in router.sessions
            if one.zid in own and centre.zid not in (router.zid, one.zid)
        ]
        status = nodes.all_status(session, 5.0)
        zids = {one.zid for one in status.values()}
        links = [one.node for one in status.values() if zids & set(one.links) - {one.zid}]
        yield (f"links between robots: {json.dumps(between)} of routers, {json.dumps(links)} of nodes")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
