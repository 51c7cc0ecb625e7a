"""`python -m benchmarks.fleet [ROBOTS]`: many light robots on this machine, under one router; writes FLEET.md.

Each robot is a supervisor, a router that dials the common one, and one node. Told is how long it takes until a
client of the common router sees all of them, how long `robo ps --fleet` takes, what they hold and use at rest, how long
it takes until all are seen again after the common router was killed, and whether anything links robot to robot.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import psutil
import zenoh

from benchmarks.__main__ import machine
from robo.tools import fleet as tools
from robo.tools import nodes, runs
from robo.wire import admin
from robo.wire.keys import ALL_TOKENS
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

PORT = 17447
SITE = f"tcp/127.0.0.1:{PORT}"
MANIFEST = """
groups:
  light:
    namespace: ${robot_name}
    nodes: {position_tracker: {service: robo_services.position_tracker}}
"""
ROUNDS = 3
"""How often they are started; told is the median, with the smallest and the largest."""
REST = 10.0
"""How long they are watched at rest, s."""


RESULTS = Path(__file__).parent / "FLEET.md"


def main(robots: int) -> None:
    load = f"Load of the machine before: {os.getloadavg()[0]:.1f}."
    lines = list(measure(robots))
    text = "\n".join([f"# A fleet of {robots} light robots", "", *machine(), load, "", *(f"- {x}" for x in lines), ""])
    RESULTS.write_text(text)
    print(text)


def one_run(folder: str, robots: int) -> str:
    """The same robots by one supervisor, with one router for all."""
    manifest = Path(folder) / "fleet.yaml"
    nodes_text = "{position_tracker: {service: robo_services.position_tracker}}"
    manifest.write_text(f"groups: {{light: {{replicas: {robots}, namespace: 'r${{index}}', nodes: {nodes_text}}}}}\n")
    robo = [sys.executable, "-m", "robo"]
    begin = time.monotonic()
    command = [*robo, "up", str(manifest), "-d", "--wait", "--robot-name", "fleet", "--listen", SITE]
    subprocess.run(command, check=True, capture_output=True)
    took = time.monotonic() - begin
    subprocess.run([*robo, "down", "--connect", SITE], check=True, capture_output=True)
    return f"as one run of {robots} robots, one node each: all ready {took:.2f} s after the command"


class Fleet:
    """A site's router, a client of it, and the robots that were started there.

    Args:
        manifest: what each robot runs.
        ends: what is to be ended in the end.
    """

    def __init__(self, manifest: Path, ends: ExitStack) -> None:
        self._manifest = manifest
        self._ends = ends
        self.processes = [self._router()]
        self.session = open_session(Network(mode="client", connect=(SITE,), timeout=10))
        ends.callback(close_session, self.session)

    def _router(self) -> "subprocess.Popen[bytes]":
        return self._start(self._ends, "router", "--listen", SITE)

    def lose_router(self) -> None:
        """Kill the site's router, and start it again."""
        self.processes[0].kill()
        self.processes[0].wait()
        self.processes[0] = self._router()

    def _start(self, ends: ExitStack, *words: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", "robo", *words]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        ends.callback(process.wait, 20)
        ends.callback(process.terminate)
        return process

    def add(self, ends: ExitStack, name: str, port: int) -> "subprocess.Popen[bytes]":
        """Start one more robot."""
        where = ("--listen", f"tcp/127.0.0.1:{port}", "--connect", SITE)
        return self._start(ends, "up", str(self._manifest), "--robot-name", name, *where)

    def add_many(self, ends: ExitStack, robots: int) -> float:
        """Start so many robots. Returns how long it took until all were seen, s."""
        begin = time.monotonic()
        self.processes += [self.add(ends, f"r{i}", PORT + i) for i in range(1, robots + 1)]
        self.wait_for(robots)
        return time.monotonic() - begin

    def wait_for(self, robots: int, every: float = 0.02) -> None:
        """Wait until so many robots are seen, looking again after so many seconds."""
        while len(nodes.list_nodes(self.session)) != robots:
            time.sleep(every)

    def wait_for_nobody(self) -> None:
        """Wait until nothing is seen of robots any more: one that comes before finds its names taken."""
        while any(reply.ok is not None for reply in self.session.liveliness().get(ALL_TOKENS, timeout=5.0)):
            time.sleep(0.02)

    def all_ready(self, robots: int) -> float:
        """When the last of the robots was ready by its own word, s since 1970."""
        while (
            len(ready := [e.time * 1e-9 for e in runs.EventStream(self.session).past() if e.event == "ready"]) < robots
        ):
            time.sleep(0.05)
        return max(ready)


def measure(robots: int) -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder, ExitStack() as ends:
        manifest = Path(folder) / "light.yaml"
        manifest.write_text(MANIFEST)
        yield one_run(folder, robots)
        fleet = Fleet(manifest, ends)
        took = []
        for _ in range(ROUNDS - 1):
            router = fleet.processes[:1]
            with ExitStack() as ended:
                took.append(fleet.add_many(ended, robots))
            fleet.processes = router
            fleet.wait_for_nobody()
        took.append(fleet.add_many(ends, robots))
        seen = time.time()
        figures = f"{statistics.median(took):.2f} s ({min(took):.2f}-{max(took):.2f})"
        yield (f"{robots} robots: all seen {figures} after the first command")
        late = max(0.0, seen - fleet.all_ready(robots)) * 1e3
        yield (f"the last one: seen {late:.0f} ms after it was ready by its own word")
        yield from one_more(fleet, robots, ends)
        yield one_line_a_robot(fleet, robots + 1)
        yield at_rest(fleet.processes)
        yield links_between(fleet.session)
        yield router_lost(fleet, robots + 1)


def one_more(fleet: Fleet, robots: int, ends: ExitStack) -> Iterator[str]:
    """A robot, then a client, that comes to the others: what discovery itself takes."""
    fleet.processes.append(fleet.add(ends, "late", PORT - 1))
    begin = time.monotonic()
    fleet.wait_for(robots + 1, every=0.005)
    yield (f"one more: seen {time.monotonic() - begin:.2f} s after its command")
    fresh = open_session(Network(mode="client", connect=(SITE,)))
    begin = time.monotonic()
    assert len(nodes.list_nodes(fresh)) == robots + 1
    yield (f"a new client knows all of them within {(time.monotonic() - begin) * 1e3:.0f} ms")
    close_session(fresh)


def one_line_a_robot(fleet: Fleet, robots: int) -> str:
    """How long the command takes, and what it asks, without Python's start."""
    begin = time.monotonic()
    subprocess.run([sys.executable, "-m", "robo", "ps", "--fleet", "--connect", SITE], check=True, capture_output=True)
    whole = time.monotonic() - begin
    begin = time.monotonic()
    found = tools.robots_of(tools.Watch(fleet.session, 5.0).look())
    asked = time.monotonic() - begin
    ready = sum(robot.state == "ready" for robot in found)
    assert (len(found), ready) == (robots, robots), found
    return f"`robo ps --fleet`: {whole:.2f} s for {robots} robots, of which the network takes {asked:.2f} s"


def router_lost(fleet: Fleet, robots: int) -> str:
    """How long after the end of the site's router all of them are seen again by a tool that stays."""
    begin = time.monotonic()
    fleet.lose_router()
    fleet.wait_for(0)
    gone = time.monotonic() - begin
    fleet.wait_for(robots)
    took = time.monotonic() - begin
    return f"the site's router killed and started again: none seen after {gone:.2f} s, all again after {took:.2f} s"


def at_rest(started: Sequence["subprocess.Popen[bytes]"]) -> str:
    """What the processes and their children hold and use while nothing happens."""
    family = [psutil.Process(p.pid) for p in started]
    family += [child for p in family for child in p.children(recursive=True)]
    time.sleep(3)
    before = sum(sum(p.cpu_times()[:2]) for p in family)
    time.sleep(REST)
    used = (sum(sum(p.cpu_times()[:2]) for p in family) - before) / REST
    resident = sum(p.memory_info().rss for p in family)
    return f"at rest: {len(family)} processes, {resident / 1e6:.0f} MB resident, {used:.1%} of a core"


def links_between(session: zenoh.Session) -> str:
    """Which routers and nodes of one robot are linked to those of another; there should be none."""
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
    return f"links between robots: {json.dumps(between)} of routers, {json.dumps(links)} of nodes"


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
