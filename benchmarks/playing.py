"""`python -m benchmarks.playing`: recordings played as they were made, and as fast as nothing is lost.

**At rate 1**: a recording of odometry and commands 50 times a second each and of scans of 360 rays 10 times a second is
played by `robo bag play`; another process of this machine notes when each message arrives. A message is as late as it
is beyond the earliest of its run, each reckoned from its time in the recording. `raw` plays the same bytes with
zenoh-python alone: a loop that sleeps until each is due, over the same router.

**As fast as nothing is lost**: the log of a real robot, with its odometry, transforms and scans, to the position
tracker: by the CARMEN player and, made a recording, by `robo bag play --rate 0`, in turn. Times are those that the
players tell, until the tracker has the last message.
"""

import argparse
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from benchmarks.__main__ import machine
from robo import bag
from robo.bag.forms.from_carmen import Setting, from_carmen
from robo.bag.types import topic_of
from robo.interfaces import cdr
from robo.wire.network import Network
from robo.wire.session import close_session, open_session
from robo_messages import Header, LaserScan, Message, Odometry, Time, Twist, Vector3

RESULTS = Path(__file__).parent / "PLAYING.md"
ROOM = Path(__file__).parents[1] / "robo" / "share" / "logs"
START = 1_700_000_000_000_000_000
MOST = 5.0
"""What issue and documentation promise, ms."""

RAW = """
import sys, time
import zenoh
from robo import bag
import robo_messages
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{sys.argv[2]}"]')
session = zenoh.open(config)
with bag.open(sys.argv[1]) as recording:
    every = [(m.arrived, m.topic.name, robo_messages.encode(m.value)) for m in recording.messages()]
block = zenoh.CongestionControl.BLOCK
ends = {name: session.declare_publisher(name, congestion_control=block) for _, name, _ in every}
time.sleep(0.5)
first, begin = every[0][0], time.monotonic()
for at, name, payload in every:
    left = begin + (at - first) * 1e-9 - time.monotonic()
    if left > 0:
        time.sleep(left)
    ends[name].put(payload)
session.close()
"""


def drive(path: Path, seconds: int) -> list[int]:
    """Make a recording of a robot. Returns the times of its messages, ns."""
    scan = LaserScan(ranges=[1.0 + ray / 360 for ray in range(360)])
    times: list[int] = []
    with bag.Recording(path, bag.Options(compression="none", sync=False)) as recording:
        odometry, commands, scans = (
            recording.topic(topic_of(f"r1/{name}", type_))
            for name, type_ in (("odom", Odometry), ("cmd_vel", Twist), ("scan", LaserScan))
        )
        for step in range(seconds * 50):
            at = START + step * 20_000_000
            stamp = Time.from_nanoseconds(at)
            said: list[tuple[int, Message, int]] = [
                (odometry, Odometry(Header(stamp, "odom"), "base_link"), at),
                (commands, Twist(Vector3(x=step / 50)), at + 3_000_000),
            ]
            if step % 5 == 0:
                said.append((scans, msgspec.structs.replace(scan, header=Header(stamp, "laser")), at + 7_000_000))
            for number, message, when in said:
                recording.write(number, cdr.encoder(type(message))(message), when, when, step + 1)
                times.append(when)
    return times


def free_endpoint() -> str:
    """A Zenoh endpoint on loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def robo(*words: str) -> "subprocess.Popen[str]":
    """A command that runs beside this."""
    command = [sys.executable, "-m", "robo", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@contextmanager
def standing(*words: str, sign: str, told: list[str] | None = None) -> Iterator[str]:
    """While this goes on a command runs that has said a line with a sign; where it is reached.

    What it says after that is `told` at its end.
    """
    endpoint = free_endpoint()
    process = robo(*words, "--listen", endpoint)
    try:
        assert process.stdout is not None
        next(line for line in process.stdout if sign in line)
        yield endpoint
    finally:
        process.terminate()
        said = process.communicate(timeout=20)[0]
        if told is not None:
            told.append(said)


def lateness(play: Callable[[], int], session: zenoh.Session, times: list[int]) -> list[float]:
    """How late each message of a run arrived beyond the earliest, ms."""
    arrived: list[int] = []
    handler: Any = zenoh.handlers.Callback(lambda _: arrived.append(time.monotonic_ns()), indirect=False)
    heard = session.declare_subscriber("r1/**", handler)
    assert play() == 0
    end = time.monotonic() + 10
    while len(arrived) < len(times) and time.monotonic() < end:
        time.sleep(0.01)
    heard.undeclare()
    assert len(arrived) == len(times), f"{len(times) - len(arrived)} messages are lost"
    beyond = [came - at for came, at in zip(arrived, times, strict=True)]
    least = min(beyond)
    return [(one - least) * 1e-6 for one in beyond]


def paced(folder: Path, seconds: int, turns: int) -> list[str]:
    """The table of the first part."""
    path = folder / "drive.mcap"
    times = drive(path, seconds)
    found: dict[str, list[float]] = {"raw": [], "robo bag play": []}
    with standing("router", sign="router at") as endpoint:
        session = open_session(Network(mode="client", connect=(endpoint,)))
        ways: dict[str, list[str]] = {
            "raw": [sys.executable, "-c", RAW, str(path), endpoint],
            "robo bag play": [sys.executable, "-m", "robo", "bag", "play", str(path), "--connect", endpoint],
        }
        for _ in range(turns):
            for way, command in ways.items():

                def play(command: list[str] = command) -> int:
                    return subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode

                found[way] += lateness(play, session, times)
        close_session(session)
    lines = ["| | p50 ms | p99 ms | p99.9 ms | longest ms | beyond 5 ms |", "|---|---|---|---|---|---|"]
    for way, late in found.items():
        ordered = sorted(late)
        half, tail, end = (ordered[len(ordered) * part // 1000] for part in (500, 990, 999))
        beyond = sum(one > MOST for one in late)
        lines.append(f"| {way} | {half:.2f} | {tail:.2f} | {end:.2f} | {ordered[-1]:.2f} | {beyond} of {len(late):,} |")
    return lines


def tracked(folder: Path, log: Path, turns: int) -> list[str]:
    """The table of the second part."""
    path = folder / "log.mcap"
    from_carmen(log, path, Setting(namespace="my_robot"), "none")
    manifest = folder / "tracker.yaml"
    manifest.write_text(
        "groups:\n  tracking:\n    namespace: my_robot\n"
        "    nodes: {position_tracker: {service: robo_services.position_tracker}}\n"
    )
    carmen_times, bag_times, ends = [], [], []
    for _ in range(turns):
        process = robo("up", "replay.yaml", f"log:={log}", "rate:=0", "delay:=0.5", "--listen", free_endpoint())
        said, _unused = process.communicate(timeout=120)
        carmen_times.append(float(re.findall(r"played .* in ([\d.]+) s", said)[0]))
        told: list[str] = []
        with standing("up", str(manifest), sign="is ready", told=told) as endpoint:
            play = robo("bag", "play", str(path), "--rate", "0", "--json", "--connect", endpoint)
            said, _unused = play.communicate(timeout=120)
            bag_times.append(msgspec.json.decode(said.splitlines()[-1])["seconds"])
        ends.append(float(re.findall(r"distance ([\d.]+) m", told[0])[-1]))
    lines = ["| | s, median (least-most) | the tracker's way, m |", "|---|---|---|"]
    for way, took, way_driven in (("CARMEN player", carmen_times, ""), ("robo bag play --rate 0", bag_times, "")):
        driven = ", ".join(sorted({f"{z:.3f}" for z in ends})) if way.startswith("robo") else way_driven
        lines.append(f"| {way} | {statistics.median(took):.2f} ({min(took):.2f}-{max(took):.2f}) | {driven} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.playing", description="Measure, print, PLAYING.md.")
    parser.add_argument("--seconds", type=int, default=60, help="length of the recording (default 60)")
    parser.add_argument("--turns", type=int, default=5, help="of each way (default 5)")
    parser.add_argument("--log", type=Path, default=next(ROOM.glob("*.log.gz")), help="a CARMEN log")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="robo-bench-") as name:
        folder = Path(name)
        fast = tracked(folder, asked.log.resolve(), asked.turns)
        slow = paced(folder, asked.seconds, asked.turns)
    lines = [
        "# Playing recordings",
        "",
        f"Written by `python -m benchmarks.playing --log {asked.log.name}`: {asked.turns} turns of each way.",
        "",
        *machine(),
        *(__doc__ or "").split("\n\n", 1)[1].splitlines(),
        "",
        *slow,
        "",
        *fast,
        "",
    ]
    text = "\n".join(lines)
    print(text)
    RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
