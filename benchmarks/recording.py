"""`python -m benchmarks.recording`: a robot that says much, recorded by `robo bag record`; writes RECORDING.md.

`robot` says 2,200 messages a second: 1,000 odometries, 1,000 commands, 200 scans of 360 rays. `images` are 30 a second
of 640x480 in three colours. Who publishes is a node in a process of its own, a router is between. `raw zenoh` is a
client that only counts, with one thread that blocks in Zenoh's channel, in another process at the same time; the
recorder decodes, encodes as CDR, compresses, and writes to the disk within a second. Processor time is that of the
whole process while messages come, in percent of one core; memory is at the end, with what it shares with others.
`lost` is what was published and is not in the file; `counted` is what the recorder says that it has lost.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import psutil

from benchmarks.__main__ import machine
from robo import bag
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from tests.conftest import free_port

RESULTS = Path(__file__).parent / "RECORDING.md"
MOST_CPU, MOST_MEMORY = 10.0, 80.0
"""For `robot`: percent of a core, MB."""
CASES = (("robot", "zstd"), ("robot", "none"), ("images", "zstd"), ("images", "none"))


def worker(role: str, endpoint: str, workload: str, seconds: float) -> "subprocess.Popen[bytes]":
    words = [sys.executable, "-m", "benchmarks.recording_worker", role, endpoint, workload, str(seconds)]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def answer(process: "subprocess.Popen[bytes]") -> Any:
    assert process.stdout is not None
    found = msgspec.json.decode(process.stdout.readline())
    process.wait(30)
    return found


def say(process: "subprocess.Popen[bytes]") -> None:
    assert process.stdin is not None
    process.stdin.write(b"\n")
    process.stdin.flush()


def measure(endpoint: str, workload: str, compression: str, seconds: float, folder: Path) -> tuple[str, bool]:
    """A row of the table, and whether it is as good as it has to be."""
    path = folder / f"{workload}_{compression}.mcap"
    with ExitStack() as processes:
        return _measured(endpoint, workload, compression, seconds, path, processes)


def _measured(
    endpoint: str, workload: str, compression: str, seconds: float, path: Path, processes: ExitStack
) -> tuple[str, bool]:
    def started(process: "subprocess.Popen[bytes]") -> "subprocess.Popen[bytes]":
        processes.callback(process.wait)
        processes.callback(process.kill)
        return process

    raw = started(worker("subscribe", endpoint, workload, seconds))
    words = ["bag", "record", "bench/*", "--exclude", "bench/log", "--exclude", "bench/parameter_events"]
    words += ["--exclude", "bench/diagnostics", "-o", str(path), "--compression", compression, "--json", "--no-tf"]
    command = [sys.executable, "-m", "robo", *words, "--connect", endpoint]
    recorder = started(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE))
    assert recorder.stderr is not None
    recorder.stderr.readline()  # it listens
    watched = psutil.Process(recorder.pid)
    publisher = started(worker("publish", endpoint, workload, seconds))
    while not path.exists() or path.stat().st_size < 10_000:
        time.sleep(0.02)
    say(raw)
    before, begin = watched.cpu_times(), time.monotonic()
    published = answer(publisher)
    after, took = watched.cpu_times(), time.monotonic() - begin
    say(raw)
    plain = answer(raw)
    memory = watched.memory_info().rss / 1e6
    time.sleep(0.5)
    recorder.terminate()
    said = msgspec.json.decode(recorder.communicate(timeout=60)[0])
    sent = sum(published["sent"].values())
    with bag.open(path) as opened:
        count = opened.count
    counted = sum(topic["lost"] for topic in said["topics"])
    used = 100 * (after.user + after.system - before.user - before.system) / took
    rate = sent / published["seconds"]
    cells = [
        f"{workload}, {compression}", f"{rate:,.0f}", f"{sent - count:,}", f"{counted:,}", f"{used:.1f} %",
        f"{memory:.0f} MB", f"{path.stat().st_size / 1e6:.1f} MB", f"{sent - plain['came']:,}",
        f"{100 * plain['used'] / took:.1f} %",
    ]  # fmt: skip
    good = sent == count if workload == "robot" else sent - count == counted
    good = good and (workload != "robot" or (used <= MOST_CPU and memory <= MOST_MEMORY))
    return " | ".join(cells), good


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.recording", description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="of each (default 60)")
    parser.add_argument("--quick", action="store_true", help="5 s of each; writes no results")
    options = parser.parse_args()
    seconds = 5.0 if options.quick else options.seconds
    lines = [
        "# Recordings",
        "",
        f"Written by `python -m benchmarks.recording`: {seconds:.0f} s of each.",
        "",
        *machine(),
        *__doc__.split("\n\n", 1)[1].splitlines(),
        "",
        f"`robot` may lose nothing, and take {MOST_CPU:g} % of a core and {MOST_MEMORY:g} MB; of `images` each loss is "
        "counted.",
        "",
        "| | messages/s | lost | counted | processor | memory | file | raw zenoh lost | raw zenoh processor |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = open_session(Network(mode="router", listen=(endpoint,)))
    all_good = True
    with tempfile.TemporaryDirectory() as folder:
        for workload, compression in CASES:
            row, good = measure(endpoint, workload, compression, seconds, Path(folder))
            all_good = all_good and good
            lines.append(f"| {row} |")
            print(lines[-1], "" if good else "  <- not as it has to be", flush=True)
    close_session(router)
    if not options.quick:
        RESULTS.write_text("\n".join(lines) + "\n")
    sys.exit(0 if all_good else 1)


if __name__ == "__main__":
    main()
