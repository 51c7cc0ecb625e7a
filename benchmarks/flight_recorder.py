"""`python -m benchmarks.flight_recorder`: what a flight recorder takes; writes FLIGHT_RECORDER.md.

The reference robot drives in simulation with one; then with ten times its messages. Processor time and memory are those
of the recorder's process; beside it in the same run a plain Zenoh subscriber of the same topics, which empties its
channel as often and does nothing with what comes. At the end the safety monitor is killed, and it is measured after
how long the file is there, and what of the time before is in it. `--seconds 15` is enough to see it work, and writes
nothing; figures want a minute each, on an idle machine.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import psutil
import zenoh

from benchmarks.__main__ import machine
from robo import bag
from robo.recording.flight.flight import LOOK
from robo.wire import codec, sources
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Header, Odometry

RESULTS = Path(__file__).parent / "FLIGHT_RECORDER.md"
MOST_CPU = 3.0
"""For the reference robot, percent of a core."""
LATEST_FILE = 5.0
"""After the kill, s."""
LEAST_BEFORE = 10.0
"""That is in the file from before the kill, s."""
MOST_MEMORY = 100.0
"""Resident, MB."""
TIMES = 10
"""As many messages as the robot has."""
_RING_MB = 8.0
_MORE_RING = 1.25
"""What is found on the disk may be so many times what is granted: what comes between two looks, and the types."""
_FULL = 60.0
"""Only figures of so many seconds are written down."""


class Figures(msgspec.Struct, frozen=True):
    """Of one situation."""

    name: str
    rate: float
    """Messages a second."""
    cpu: float
    """Percent of a core."""
    raw: float
    """Of the plain subscriber, percent of a core."""
    memory: float
    """Resident, MB."""
    ring: float
    """On disk, MB."""


def main() -> None:
    """Measure, print, write, and exit with 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each situation")
    parser.add_argument("--raw", metavar="ENDPOINT", help=argparse.SUPPRESS)
    parser.add_argument("--load", metavar="ENDPOINT", help=argparse.SUPPRESS)
    parser.add_argument("--rate", type=float, default=0.0, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.raw:
        listen(options.raw)
    elif options.load:
        publish(options.load, options.rate)
    else:
        sys.exit(0 if measure(options.seconds) else 1)


def listen(endpoint: str) -> None:
    """Receive all topics and do nothing; each second the number of messages."""
    session = open_session(Network(mode="client", connect=(endpoint,)))
    subscriber: Any = session.declare_subscriber("r1/**", zenoh.handlers.RingChannel(8192))
    count, due = 0, time.monotonic() + 1.0
    while True:
        time.sleep(LOOK)
        while subscriber.handler.try_recv() is not None:
            count += 1
        if time.monotonic() >= due:
            due += 1.0
            print(count, flush=True)


def publish(endpoint: str, rate: float) -> None:
    """Publish odometry on ten topics."""
    session = open_session(Network(mode="peer", connect=(endpoint,)))
    encoding = codec.encoding_of(Odometry)
    publishers = [session.declare_publisher(f"r1/load_{number}", encoding=encoding) for number in range(10)]
    signed = [sources.counted(publisher.id) for publisher in publishers]
    payload = msgspec.msgpack.encode(Odometry(Header(frame_id="odom"), "base_link"))
    begin = time.monotonic()
    number = 0
    while True:
        which = number % 10
        stamp = codec.pack_attachment(number // 10 + 1, time.time_ns())
        publishers[which].put(payload, attachment=stamp, source_info=signed[which]())
        number += 1
        time.sleep(max(0.0, begin + number / rate - time.monotonic()))


def measure(seconds: float) -> bool:
    """All situations. Returns whether the limits held."""
    with tempfile.TemporaryDirectory() as name, _robot(Path(name)) as (endpoint, processes):
        folder = Path(name)
        recorder, monitor = processes["/r1/flight_recorder"], processes["/r1/safety_monitor"]
        found = [_situation("the reference robot", endpoint, recorder, folder, seconds)]
        with _beside("--load", endpoint, "--rate", str((TIMES - 1) * found[0].rate)):
            found.append(_situation(f"{TIMES} times as many messages", endpoint, recorder, folder, seconds))
            killed = time.time_ns()
            monitor.send_signal(signal.SIGKILL)
            latency = _time_to_file(folder)
        path = next((folder / "files").glob("*.mcap"))
        lost = _lost(path)
        with bag.open(path) as recording:
            before, count = (killed - recording.begin) * 1e-9, recording.count
    text = _report(found, latency, before, count, lost, seconds)
    print(text)
    if seconds >= _FULL:
        RESULTS.write_text(text, encoding="utf-8")
    broken = list(_broken(found, latency, before))
    print("\n".join(broken))
    return not broken


def _broken(found: list[Figures], latency: float, before: float) -> Iterator[str]:
    """Which limits do not hold."""
    limits = [
        ("% of a core", found[0].cpu, MOST_CPU),
        ("s until the file is there", latency, LATEST_FILE),
        *(("MB resident", one.memory, MOST_MEMORY) for one in found),
        *(("MB of the ring", one.ring, _MORE_RING * _RING_MB) for one in found),
    ]
    yield from (f"{value:.1f} {what}: {most:g} are granted" for what, value, most in limits if value > most)
    if before < LEAST_BEFORE:
        yield f"{before:.1f} s before the kill are in the file: {LEAST_BEFORE:g} are wanted"


def _lost(path: Path) -> int:
    return sum(one.count for one in bag.check(path).findings if one.kind.value == "lost")


def _situation(name: str, endpoint: str, recorder: psutil.Process, folder: Path, seconds: float) -> Figures:
    with _beside("--raw", endpoint) as raw:
        said = _lines(raw)
        next(said)
        before = next(said)
        listener = psutil.Process(raw.pid)
        begin, own, theirs = time.monotonic(), _used(recorder), _used(listener)
        time.sleep(seconds)
        span = time.monotonic() - begin
        own, theirs = _used(recorder) - own, _used(listener) - theirs
        raw.kill()
        after = max([before, *said])
    ring = sum(path.stat().st_size for path in (folder / "ring").rglob("*.mcap"))
    memory = recorder.memory_info().rss
    rate = (after - before) / span
    return Figures(name, rate, 100 * own / span, 100 * theirs / span, memory / 1e6, ring / 1e6)


def _used(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _time_to_file(folder: Path) -> float:
    begin = time.monotonic()
    while not list((folder / "files").glob("*.mcap")):
        if time.monotonic() - begin > 60:
            sys.exit("no file was written within a minute")
        time.sleep(0.01)
    return time.monotonic() - begin


@contextmanager
def _beside(*words: str) -> Iterator[subprocess.Popen[str]]:
    """This module as another process."""
    command = [sys.executable, "-m", "benchmarks.flight_recorder", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def _lines(process: subprocess.Popen[str]) -> Iterator[int]:
    """The numbers that it prints."""
    assert process.stdout is not None
    return map(int, process.stdout)


@contextmanager
def _robot(folder: Path) -> Iterator[tuple[str, dict[str, psutil.Process]]]:
    """The reference robot, its endpoint and its processes by node."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    command = [sys.executable, "-m", "robo", "up", "robot.yaml", "--robot-name", "r1", "--listen", endpoint]
    own = {"folder": folder / "files", "ring_folder": folder / "ring", "ring_size": _RING_MB}
    words = [word for name, value in own.items() for word in ("-p", f"flight_recorder.{name}:={value}")]
    run = subprocess.Popen(
        [*command, *words, "demo:=arc", "flight_recorder:=true"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "ROBO_LOG_DIR": str(folder / "log")},
    )
    try:
        assert run.stdout is not None
        if not any("is ready" in line for line in run.stdout):
            sys.exit("the robot did not start")
        time.sleep(3.0)  # what the start has left behind settles
        session = open_session(Network(mode="client", connect=(endpoint,)))
        found = dict(_processes(session))
        close_session(session)
        yield endpoint, found
    finally:
        run.terminate()
        run.communicate()


def _processes(session: zenoh.Session) -> Iterator[tuple[str, psutil.Process]]:
    from robo.tools.runs import processes

    for status in processes(session, "r1"):
        if status.pid is not None:
            yield status.node, psutil.Process(status.pid)


def _report(found: list[Figures], latency: float, before: float, count: int, lost: int, seconds: float) -> str:
    rows = [
        f"| {one.name} | {one.rate:.0f} | {one.cpu:.1f} | {one.raw:.1f} | {one.memory:.0f} | {one.ring:.1f} |"
        for one in found
    ]
    return "\n".join(
        [
            "# A flight recorder",
            "",
            "Written by `python -m benchmarks.flight_recorder`, which says what is measured.",
            "",
            *machine(),
            "",
            f"{seconds:g} s each. At most {MOST_CPU:g} % of a core are granted for the reference robot, the ring "
            f"{_RING_MB:g} MB.",
            "",
            "| | messages a second | % of a core | plain subscriber | MB resident | MB of the ring |",
            "|---|---|---|---|---|---|",
            *rows,
            "",
            f"Safety monitor killed at {TIMES} times the messages: the file is there after {latency:.1f} s (at most "
            f"{LATEST_FILE:g} are granted); it has {count:,} messages, from {before:.0f} s before the kill on (at "
            f"least {LEAST_BEFORE:g} are wanted), {lost} are missing. At most {MOST_MEMORY:g} MB are granted to the "
            f"process, {_MORE_RING * _RING_MB:g} to what the ring takes of the disk.",
            "",
        ]
    )


if __name__ == "__main__":
    main()
