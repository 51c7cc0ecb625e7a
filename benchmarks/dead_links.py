"""`python -m benchmarks.dead_links`: what a router passes on while links to it are dead.

A robot runs in a network namespace of this program's own. Clients subscribe to `**`; then they are
stopped (SIGSTOP, as by Ctrl-Z), or their cable is cut (a packet filter drops everything, so that no end
is told). Meanwhile two clients on the robot's own host, which have nothing to do with them, measure the
longest gap between two messages of `r1/odom`, how old the messages are at most, and how long a call of
`r1/emergency_stop` takes at most. Needs root, `ip` and `iptables`. Without arguments it writes DEAD_LINKS.md.
"""

import argparse
import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import psutil

RESULTS = Path(__file__).parent / "DEAD_LINKS.md"
ROBOT, OPERATOR = "10.98.7.1", "10.98.7.2"
PORT = 7447
LOCAL = f"tcp/127.0.0.1:{PORT}"
CLONE_NEWNET = 0x40000000


class Case(NamedTuple):
    """Which links are dead."""

    stopped: int
    cut: int

    def text(self) -> str:
        return ", ".join(f"{n} {what}" for n, what in ((self.stopped, "stopped"), (self.cut, "cut")) if n) or "none"


CASES = (Case(0, 0), Case(1, 0), Case(5, 0), Case(20, 0), Case(0, 1), Case(0, 5), Case(0, 20), Case(20, 5))


class Seen(NamedTuple):
    """What the clients on the robot's host saw, s."""

    gap: float
    """Longest time between two messages of `r1/odom`."""
    age: float
    """Longest time from publishing one to its arrival."""
    call: float
    """Longest call of the emergency stop."""
    failed: int
    """Calls that got no answer."""
    calls: int


def main() -> None:
    """Run the cases, print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=16.0, help="how long each case is watched")
    parser.add_argument("--flood", choices=("drop", "block"), help="also publish 10 MB/s, through the router")
    parser.add_argument("--strangers", action="store_true", help="clients with Zenoh's own settings, not robo's")
    parser.add_argument("cases", nargs="*", help="STOPPED+CUT, for example 20+5; by default a row of them")
    options = parser.parse_args()
    if os.geteuid() != 0 or not shutil.which("ip") or not shutil.which("iptables"):
        sys.exit("this needs root, ip and iptables")
    cases = [Case(*map(int, case.split("+"))) for case in options.cases] or CASES
    new_namespace()
    lines = [
        "| dead links | longest gap, s | oldest message, s | longest call, s | failed calls | router |",
        "|---" * 6 + "|",
    ]
    print("\n".join(lines))
    for case in cases:
        seen, router = run(case, options.seconds, flood=options.flood, strangers=options.strangers)
        figures = f"{seen.gap:.2f} | {seen.age:.2f} | {seen.call:.2f} | {seen.failed} of {seen.calls}"
        lines.append(f"| {case.text()} | {figures} | {router} |")
        print(lines[-1], flush=True)
    if len(sys.argv) == 1:
        table = "\n".join(lines)
        RESULTS.write_text(f"# Dead links\n\nWritten by {__doc__}\n{table}\n")


def new_namespace() -> None:
    """Go on in a network of one's own, with loopback only."""
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "no network namespace")
    sh("ip link set lo up")


def sh(command: str) -> None:
    subprocess.run(command, shell=True, check=True, capture_output=True)


@contextmanager
def cable() -> Iterator[list[str]]:
    """A second host at a cable; yields how to run something on it."""
    host = subprocess.Popen(["unshare", "--net", "sleep", "infinity"])
    try:
        own = os.stat("/proc/self/ns/net").st_ino
        while os.stat(f"/proc/{host.pid}/ns/net").st_ino == own:
            time.sleep(0.01)
        there = ["nsenter", "--target", str(host.pid), "--net"]
        sh(f"ip link add robot type veth peer name operator netns {host.pid}")
        sh(f"ip addr add {ROBOT}/24 dev robot && ip link set robot up")
        sh(f"{' '.join(there)} sh -c 'ip addr add {OPERATOR}/24 dev operator && ip link set operator up'")
        yield there
    finally:
        subprocess.run("iptables -F; ip link del robot", shell=True, check=False, capture_output=True)
        host.kill()
        host.wait()


def run(case: Case, seconds: float, *, flood: str | None, strangers: bool) -> tuple[Seen, str]:
    """One case, with a robot of its own."""
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        there = stack.enter_context(cable())
        words = ["-m", "robo", "up", "simulation.yaml", "--robot-name", "r1", "--listen", f"tcp/0.0.0.0:{PORT}"]
        robot = start(stack, [], words, "is ready", {"ROBO_LOG_DIR": folder})
        router = next(
            p
            for p in psutil.Process(robot.pid).children(recursive=True)
            if "robo.process.router" in " ".join(p.cmdline())
        )
        kind = "strangers" if strangers else "tools"
        if flood:
            start(stack, [], worker("flood", flood), "ready")
        watcher = start(stack, [], worker("watch", str(seconds + 2.0)), "ready")
        stopped = start(stack, [], worker(kind, LOCAL, str(case.stopped)), "ready")
        start(stack, there, worker(kind, f"tcp/{ROBOT}:{PORT}", str(case.cut)), "ready")
        time.sleep(2.0)
        if case.stopped:
            stopped.send_signal(signal.SIGSTOP)
        if case.cut:
            sh("iptables -A INPUT -i robot -j DROP && iptables -A OUTPUT -o robot -j DROP")
        assert watcher.stdout is not None
        output = watcher.stdout.readline()
        info = router.memory_info()
        described = f"{info.rss / 1e6:.1f} MB, {router.num_threads()} threads, {sum(router.cpu_times()[:2]):.1f} s"
        stopped.send_signal(signal.SIGCONT)
        return Seen(*json.loads(output)), described


def worker(*words: str) -> list[str]:
    return ["-m", "benchmarks.dead_links_worker", *words]


def start(
    stack: ExitStack, there: Sequence[str], words: Sequence[str], ready: str, more: dict[str, str] | None = None
) -> "subprocess.Popen[str]":
    """A Python process that ends with the case, once it has said a word."""
    process = subprocess.Popen(
        [*there, sys.executable, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, **(more or {})},
    )

    def end() -> None:
        process.send_signal(signal.SIGCONT)
        process.terminate() if "robo" in words else process.kill()
        process.wait()

    stack.callback(end)
    assert process.stdout is not None
    said = []
    for line in process.stdout:
        said.append(line)
        if ready in line:
            break
    else:
        sys.exit(f"{words} ended:\n{''.join(said)}")
    if "watch" not in words:
        threading.Thread(target=process.stdout.read, daemon=True).start()
    return process


if __name__ == "__main__":
    main()
