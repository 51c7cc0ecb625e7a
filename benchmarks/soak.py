"""`python -m benchmarks.soak --minutes 60`: does a supervisor at rest stay at rest?

Runs ten nodes under one supervisor and prints, once a minute, the processor time and the memory of the
supervisor and of its router. It fails if the supervisor takes more than 1 % of a core, or grows by more
than 1 MB from the first quarter of the time to the last.
"""

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

NODES = 10
MOST_CPU = 1.0
"""Percent of a core."""
MOST_GROWTH = 1e6
"""Bytes."""

_MANIFEST = f"""\
groups:
  ten:
    namespace: soak
    nodes:
      node: {{service: robo_services.position_tracker, replicas: {NODES}, restart: on-failure}}
"""


def main() -> None:
    """Run, print, and exit with 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        probe.close()
        Path(folder, "m.yaml").write_text(_MANIFEST)
        command = [sys.executable, "-m", "robo", "up", f"{folder}/m.yaml", "--robot-name", "soak"]
        run = subprocess.Popen(
            [*command, "--listen", f"tcp/127.0.0.1:{port}"],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "ROBO_LOG_DIR": folder},
        )
        try:
            assert run.stdout is not None
            if not any("is ready" in line for line in run.stdout):
                sys.exit("the run did not start")
            ok = watch(psutil.Process(run.pid), options.minutes * 60)
        finally:
            run.terminate()
            run.communicate()
    sys.exit(0 if ok else 1)


def watch(supervisor: psutil.Process, seconds: float) -> bool:
    """Measure for so long. Returns whether all limits held."""
    router = next(p for p in supervisor.children(recursive=True) if "robo.process.router" in " ".join(p.cmdline()))
    time.sleep(min(10.0, seconds / 10))  # what the start has left behind settles
    begin, cpu = time.monotonic(), used(supervisor)
    sizes: list[int] = []
    step = min(60.0, seconds / 8)
    last, last_cpu = begin, cpu
    while time.monotonic() - begin < seconds:
        time.sleep(step)
        now, now_cpu = time.monotonic(), used(supervisor)
        sizes.append(supervisor.memory_info().rss)
        percent = 100 * (now_cpu - last_cpu) / (now - last)
        print(
            f"{(now - begin) / 60:6.1f} min  supervisor {percent:.2f} % of a core, {sizes[-1] / 1e6:.2f} MB; "
            f"router {router.memory_info().rss / 1e6:.2f} MB",
            flush=True,
        )
        last, last_cpu = now, now_cpu
    mean = 100 * (used(supervisor) - cpu) / (time.monotonic() - begin)
    quarter = max(1, len(sizes) // 4)
    growth = max(sizes[-quarter:]) - max(sizes[:quarter])
    print(f"mean {mean:.2f} % of a core (at most {MOST_CPU:g}), growth {growth / 1e6:+.2f} MB")
    return mean <= MOST_CPU and growth <= MOST_GROWTH


def used(process: psutil.Process) -> float:
    """The processor time that a process has used so far, s."""
    times = process.cpu_times()
    return float(times.user + times.system)


if __name__ == "__main__":
    main()
