"""`python -m benchmarks.dashboard`: what the page in a browser takes, and what it costs the robot; writes DASHBOARD.md.

The reference robot drives an arc in simulation, its page is served by `robo dashboard`, and headless Chromium has all
panels of it in view. Then a camera sends 30 pictures a second, and the emergency stop is clicked again and again: from
the click to the first command to the base that is 0; beside it in the same run a plain Zenoh client that calls the
same service. At last ten pages are open, one of which reads nothing: what the others get, and how evenly the safety
monitor commands the base, before and meanwhile. `--seconds 5 --stops 5` is enough to see it work, and writes nothing;
figures want an idle machine. Needs the extra dashboard, playwright and chromium.
"""

import argparse
import importlib
import os
import random
import shutil
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import psutil
import zenoh

import robo_messages
from benchmarks.__main__ import machine
from robo.samples.publishing import Sender
from robo.wire.network import Network
from robo.wire.qos import QoS
from robo.wire.session import close_session, open_session
from robo_messages import CompressedImage, Twist

RESULTS = Path(__file__).parent / "DASHBOARD.md"
MOST_CPU, MOST_MEMORY, MOST_STOP = 5.0, 60.0, 0.2
"""Granted with all panels and one browser: percent of a core, MB; and to the emergency stop, s."""
PICTURES = 30.0
"""A second."""
PAGES = 10
WATCHED = ["r1/odom", "r1/scan", "r1/camera/compressed"]
_FULL_SECONDS, _FULL_STOPS = 30.0, 200
"""Only such figures are written down."""


class Base:
    """What the base is told, with the time at which a subscriber beside it has heard of it."""

    def __init__(self, session: zenoh.Session) -> None:
        self._changed = threading.Condition()
        self._moves = False
        self._at = 0.0
        self.times: list[float] = []
        self._end = session.declare_subscriber("r1/cmd_vel", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        twist = robo_messages.decode(sample.payload.to_bytes(), Twist)
        now, moves = time.perf_counter(), bool(twist.linear.x or twist.angular.z)
        with self._changed:
            self.times.append(now)
            if moves != self._moves:
                self._moves, self._at = moves, now
                self._changed.notify()

    def wait(self, moves: bool) -> float:
        """When it was told to move, or to stand."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._moves is moves, 10):
                sys.exit("the base was not told in ten seconds")
            return self._at


class Pages:
    """Pages that are no browser: they take what comes and say so, but the last one, which reads nothing."""

    def __init__(self, port: int) -> None:
        client = importlib.import_module("websockets.sync.client")
        self.counts = [0] * (PAGES - 2)
        self._over = threading.Event()
        self._ends: list[threading.Thread] = []
        address = f"ws://127.0.0.1:{port}/socket"
        watch = msgspec.json.encode({"do": "watch", "keys": WATCHED}).decode()
        self._connect = partial(client.connect, address, max_size=None)
        self._watch = watch
        self._ends += [threading.Thread(target=self._read, args=(number,)) for number in range(PAGES - 2)]
        stalled = socket.create_connection(("127.0.0.1", port))
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.sendall(
            f"GET /socket HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        time.sleep(0.5)
        stalled.sendall(_masked(watch.encode()))
        self._ends.append(threading.Thread(target=self._stall, args=(stalled,)))
        for thread in self._ends:
            thread.start()

    def _read(self, number: int) -> None:
        with self._connect() as connection:
            connection.send(self._watch)
            while not self._over.is_set():
                said = connection.recv(10)
                connection.send('{"do": "read", "count": 1}')
                self.counts[number] += isinstance(said, bytes)

    def _stall(self, stalled: socket.socket) -> None:
        """It says that it lives, and reads nothing."""
        with stalled:
            while not self._over.wait(1.0):
                try:
                    stalled.sendall(_masked(b'{"do": "read", "count": 0}'))
                except OSError:
                    return

    def close(self) -> None:
        self._over.set()
        for thread in self._ends:
            thread.join()


def _masked(text: bytes) -> bytes:
    """A frame of text as browsers send it, with a mask that changes nothing."""
    size = bytes([0x80 | len(text)]) if len(text) < 126 else b"\xfe" + struct.pack(">H", len(text))
    return b"\x81" + size + bytes(4) + text


def picture(number: int) -> bytes:
    """A picture of 640 × 480 in colour, as PNG, of about 60 kB."""
    noise = random.Random(number).randbytes(640 * 3)
    rows = b"".join(b"\0" + (noise if y % 16 == 0 else bytes([(y + 40 * number) % 256]) * 1920) for y in range(480))

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", 640, 480, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


@contextmanager
def camera(session: zenoh.Session) -> Iterator[None]:
    """Somebody who sends pictures."""
    sender = Sender(session, WATCHED[2], "sensor/CompressedImage", QoS.DEFAULT, "/r1/camera")
    pictures = [robo_messages.encode(CompressedImage(format="png", data=memoryview(picture(n)))) for n in range(4)]
    over = threading.Event()

    def run() -> None:
        begin, number = time.monotonic(), 0
        while not over.wait(max(0.0, begin + number / PICTURES - time.monotonic())):
            sender.send(pictures[number % 4])
            number += 1

    thread = threading.Thread(target=run)
    thread.start()
    yield
    over.set()
    thread.join()
    sender.close()


def main() -> None:
    """Measure, print, write, and exit with 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=_FULL_SECONDS, help="for each situation")
    parser.add_argument("--stops", type=int, default=_FULL_STOPS, help="emergency stops by each way")
    options = parser.parse_args()
    with ExitStack() as undo:
        report, holds = measure(undo, options.seconds, options.stops)
    print(report)
    if options.seconds >= _FULL_SECONDS and options.stops >= _FULL_STOPS:
        RESULTS.write_text(report, encoding="utf-8")
    sys.exit(0 if holds else 1)


def measure(undo: ExitStack, seconds: float, stops: int) -> tuple[str, bool]:
    """All situations: the report, and whether the limits held."""
    endpoint = undo.enter_context(_robot())
    session = open_session(Network(mode="client", connect=(endpoint,)))
    undo.callback(close_session, session)
    base = Base(session)
    base.wait(True)
    alone = _evenness(base, seconds)
    server, address = undo.enter_context(_server(endpoint))
    sync_api = importlib.import_module("playwright.sync_api")
    playwright = undo.enter_context(sync_api.sync_playwright())
    browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
    undo.callback(browser.close)
    page = browser.new_page(viewport={"width": 1360, "height": 2200})
    page.goto(address)
    page.wait_for_selector("#map canvas[data-drawn]")
    rows = [("one browser, all panels", *_load(server, seconds))]
    with camera(session):
        page.wait_for_selector("#camera canvas[data-drawn]")
        before = _drawn(page)
        rows.append((f"and {PICTURES:g} pictures a second", *_load(server, seconds)))
        drawn = (_drawn(page) - before) / seconds
        clicked = _stops(base, stops, lambda which: _click(page, which))
        called = _stops(base, stops, lambda which: _call(session, which))
        pages = Pages(int(address.rsplit(":", 1)[1].strip("/")))
        time.sleep(1.0)
        begun = list(pages.counts)
        rows.append((f"and {PAGES} pages, one of which reads nothing", *_load(server, seconds)))
        beside = _evenness(base, 0.0, seconds)
        got = [(now - then) / seconds for then, now in zip(begun, pages.counts, strict=True)]
        pages.close()
    stop = _p99(clicked)
    holds = rows[0][1] <= MOST_CPU and rows[0][2] <= MOST_MEMORY and stop <= MOST_STOP
    lines = [
        "# The dashboard",
        "",
        "Written by `python -m benchmarks.dashboard`, which says what is measured.",
        "",
        *machine(),
        f"{seconds:g} s each, {stops} emergency stops by each way. For the first row at most {MOST_CPU:g} % of a core "
        f"and {MOST_MEMORY:g} MB are granted, to the emergency stop by click {MOST_STOP * 1e3:g} ms.",
        "",
        "| | server, % of a core | MB resident |",
        "|---|---|---|",
        *(f"| {name} | {cpu:.1f} | {memory:.0f} |" for name, cpu, memory in rows),
        "",
        "| emergency stop | p50 ms | p99 ms |",
        "|---|---|---|",
        f"| by a click, with {drawn:.0f} pictures a second drawn | {_ms(statistics.median(clicked))} | {_ms(stop)} |",
        f"| by a plain Zenoh client | {_ms(statistics.median(called))} | {_ms(_p99(called))} |",
        "",
        f"Of the ten pages each that reads got {min(got):.0f} to {max(got):.0f} messages a second of {len(WATCHED)} "
        f"topics. From one command to the base to the next: p99 {_ms(alone)} ms without the dashboard, "
        f"{_ms(beside)} ms meanwhile.",
        "",
    ]
    return "\n".join(lines), holds


def _evenness(base: Base, wait: float, last: float = 0.0) -> float:
    """The 99th percentile of the time between commands to the base in the next seconds, or the last ones, s."""
    time.sleep(wait)
    since = time.perf_counter() - (last or wait)
    times = [at for at in list(base.times) if at >= since]
    gaps = [after - before for before, after in pairwise(times)]
    return _p99(gaps) if gaps else 0.0


def _load(server: psutil.Process, seconds: float) -> tuple[float, float]:
    """Percent of a core, and MB resident."""
    server.cpu_percent()
    time.sleep(seconds)
    return server.cpu_percent(), server.memory_info().rss / 1e6


def _stops(base: Base, count: int, do: Callable[[str], None]) -> list[float]:
    """How long emergency stops take to reach the base, s."""
    found = []
    for _ in range(count):
        base.wait(True)
        time.sleep(0.1)
        begin = time.perf_counter()
        do("emergency_stop")
        found.append(base.wait(False) - begin)
        time.sleep(0.3)
        do("reset_emergency_stop")
    base.wait(True)
    return found


def _click(page: Any, which: str) -> None:
    name = "#stop" if which == "emergency_stop" else "#reset:not([disabled])"
    if which != "emergency_stop":
        page.wait_for_selector(name)
    box = page.locator(name).bounding_box() if which != "emergency_stop" else page.query_selector(name).bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def _call(session: zenoh.Session, which: str) -> None:
    for _ in session.get(f"r1/{which}", payload=b"\x80", timeout=5.0):
        pass


def _drawn(page: Any) -> int:
    return int(page.get_attribute("#camera canvas", "data-drawn"))


def _p99(values: list[float]) -> float:
    return sorted(values)[min(len(values) - 1, int(0.99 * len(values)))]


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.1f}"


@contextmanager
def _server(endpoint: str) -> Iterator[tuple[psutil.Process, str]]:
    """`robo dashboard`, and where its page is."""
    command = [sys.executable, "-m", "robo", "dashboard", "--connect", endpoint, "--listen", "127.0.0.1:0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        text = ""
        while "}" not in text:
            text += run.stdout.readline()
        yield psutil.Process(run.pid), msgspec.json.decode(text)["drive"]
        run.terminate()


@contextmanager
def _robot() -> Iterator[str]:
    """The reference robot, which drives an arc; its endpoint."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    command = [
        sys.executable,
        "-m",
        "robo",
        "up",
        "robot.yaml",
        "demo:=arc",
        "--robot-name",
        "r1",
        "--listen",
        endpoint,
    ]
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "ROBO_LOG_DIR": folder}
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as run:
            assert run.stdout is not None
            if not any("is ready" in line for line in run.stdout):
                sys.exit("the robot did not start")
            yield endpoint
            run.terminate()
            run.communicate()


if __name__ == "__main__":
    main()
