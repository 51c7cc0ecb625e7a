"""`python -m benchmarks.bag_files`: what `robo bag` takes for a recording of ten minutes; writes BAG_FILES.md.

A robot's odometry and commands at 50 Hz and scans of 360 rays at 10 Hz. Each verb is a process of its own, as
somebody types it; its processor time holds the start of Python, and its memory is the most that it had. Beside them
stands `robo bag --help`, and a Python that reads the file's bytes: what nobody can do without.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.__main__ import machine
from robo import bag
from robo.bag.types import topic_of
from robo.interfaces import cdr
from robo_messages import Header, LaserScan, Odometry, Time, Twist

RESULTS = Path(__file__).parent / "BAG_FILES.md"
START = 1_700_000_000 * 10**9
VERBS = {
    "read its bytes": "",
    "--help": "--help",
    "info --quick": "info drive.mcap --quick",
    "info": "info drive.mcap",
    "check": "check drive.mcap",
    "diff with itself": "diff drive.mcap drive.mcap",
    "cut, the middle": "cut drive.mcap -o cut.mcap --start 25% --end 75%",
    "filter, without scans": "filter drive.mcap -o filter.mcap --exclude **/scan",
    "merge with itself": "merge drive.mcap drive.mcap -o merge.mcap",
    "recover": "recover broken.mcap -o recover.mcap",
    "convert to JSON Lines": "convert drive.mcap -o drive.jsonl",
    "convert from JSON Lines": "convert drive.jsonl -o lines.mcap",
    "convert to CSV": "convert drive.mcap -o tables --to csv",
    "convert from CSV": "convert tables -o tables.mcap",
}


def record(path: Path, seconds: float) -> int:
    """Write the recording; how many messages."""
    encoders = cdr.encoder(Odometry), cdr.encoder(Twist), cdr.encoder(LaserScan)
    with bag.Recording(path, bag.Options(sync=False)) as recording:
        odometry, commands, scans = (
            recording.topic(topic_of(f"r1/{name}", type_))
            for name, type_ in (("odom", Odometry), ("cmd_vel", Twist), ("scan", LaserScan))
        )
        count = 0
        for tick in range(round(seconds * 50)):
            at = START + tick * 20_000_000
            header = Header(Time.from_nanoseconds(at), "odom")
            where, command = Odometry(header, "base_link"), Twist()
            where.pose.pose.position.x = command.linear.x = tick * 0.001
            recording.write(odometry, encoders[0](where), at + 300_000, at, tick + 1, "base")
            recording.write(commands, encoders[1](command), at + 400_000, at, tick + 1, "planner")
            count += 2
            if tick % 5 == 0:
                ranges = [(tick * 7 + ray * 13) % 4096 / 512 for ray in range(360)]
                scan = LaserScan(Header(Time.from_nanoseconds(at), "laser"), ranges=ranges)
                recording.write(scans, encoders[2](scan), at + 500_000, at, tick // 5 + 1, "laser")
                count += 1
    return count


def measure(folder: Path, words: str, seconds: float) -> tuple[float, float, int]:
    """Wall time and processor time of a verb, s, and the most memory it had, bytes."""
    command = [sys.executable, "-m", "robo", "bag", *words.replace("25%", str(seconds / 4)).replace(
        "75%", str(seconds * 3 / 4)).split()]  # fmt: skip
    if not words:
        command = [sys.executable, "-c", "open('drive.mcap', 'rb').read()"]
    begin = time.monotonic()
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    wall = time.monotonic() - begin
    if status:
        raise SystemExit(f"{' '.join(command)} ended with {status}")
    return wall, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


def main() -> None:
    """Measure each verb once, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="of the recording")
    parser.add_argument("--out", type=Path, default=RESULTS)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        count = record(folder / "drive.mcap", asked.seconds)
        data = (folder / "drive.mcap").read_bytes()
        (folder / "broken.mcap").write_bytes(data[:-1_000])
        lines = [
            "# What is done with recordings\n",
            f"By `python -m benchmarks.bag_files --seconds {asked.seconds:g}` on {machine()[0]} {count:,} messages, "
            f"{len(data) / 1e6:.1f} MB as zstd.\n",
            "| `robo bag` | s | processor s | MB |",
            "|---|---|---|---|",
        ]
        for title, words in VERBS.items():
            wall, used, most = measure(folder, words, asked.seconds)
            lines.append(f"| {title} | {wall:.2f} | {used:.2f} | {most / 1e6:.0f} |")
            print(lines[-1], flush=True)
    asked.out.write_text("\n".join([*lines, ""]))


if __name__ == "__main__":
    main()
