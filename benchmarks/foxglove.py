"""`python -m benchmarks.foxglove`: what the bridge to Foxglove takes; writes FOXGLOVE.md.

The reference robot drives in simulation. Processor time and memory are those of the bridge's process: without a client,
with one that has all topics, with nine more of which one reads nothing. Beside it, with one client in the same run, a
program that hands the same messages on as the bytes that they are, from plain Zenoh to a plain socket. The client is a
process of its own. `--seconds 5` is enough to see it work, and writes nothing; figures want a minute each, on an idle
machine.
"""

import argparse
import asyncio
import importlib
import json
import os
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import msgspec
import psutil
import zenoh

from benchmarks.__main__ import machine
from robo.bridges.foxglove.feed import PERIOD
from robo.wire.network import Network
from robo.wire.session import open_session

RESULTS = Path(__file__).parent / "FOXGLOVE.md"
MOST_CPU = 5.0
"""With one client, percent of a core."""
MOST_MEMORY = 60.0
"""With one client, resident, MB."""
MOST_MORE = 40.0
"""That ten clients may take beyond one of them, MB: sixteen of them wait for the one that reads nothing."""
_FULL = 60.0
"""Only figures of so many seconds are written down."""


class Figures(msgspec.Struct, frozen=True):
    """Of one situation."""

    name: str
    rate: float
    """Messages a second that the first client gets."""
    cpu: float
    """Percent of a core."""
    memory: float
    """Resident, MB."""


def main() -> None:
    """Measure, print, write, and exit with 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each situation")
    parser.add_argument("--raw", metavar="ENDPOINT", help=argparse.SUPPRESS)
    parser.add_argument("--client", metavar="URL", help=argparse.SUPPRESS)
    parser.add_argument("--stalled", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.raw:
        asyncio.run(hand_on(options.raw))
    elif options.client:
        watch(options.client, stalled=options.stalled)
    else:
        sys.exit(0 if measure(options.seconds) else 1)


async def hand_on(endpoint: str) -> None:
    """Hand all topics on as they are, to whoever connects."""
    serve = importlib.import_module("websockets.asyncio.server").serve
    session = open_session(Network(mode="client", connect=(endpoint,)))
    subscriber: Any = session.declare_subscriber("r1/**", zenoh.handlers.RingChannel(8192))
    head = struct.Struct("<BIQ")

    async def client(connection: Any) -> None:
        while True:
            await asyncio.sleep(PERIOD)
            while (sample := subscriber.handler.try_recv()) is not None:
                await connection.send(head.pack(1, 1, time.time_ns()) + sample.payload.to_bytes())

    async with serve(client, "127.0.0.1", 0, compression=None) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        print(json.dumps({"drive": f"ws://127.0.0.1:{port}"}), flush=True)
        await asyncio.Future()


def watch(url: str, *, stalled: bool) -> None:
    """Subscribe all topics, and print each second how many messages have come."""
    connect = importlib.import_module("websockets.sync.client").connect
    count, due, number = 0, time.monotonic() + 1.0, 0
    with connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as connection:
        while True:
            said = connection.recv()
            if isinstance(said, bytes):
                count += said[0] == 1
            elif (word := json.loads(said))["op"] == "advertise":
                wanted = [{"id": (number := number + 1), "channelId": one["id"]} for one in word["channels"]]
                connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
                if stalled:
                    connection.socket.settimeout(None)
                    time.sleep(1e6)
            if time.monotonic() >= due:
                due += 1.0
                print(count, flush=True)


def measure(seconds: float) -> bool:
    """All situations. Returns whether the limits held."""
    found: list[Figures] = []
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        endpoint = stack.enter_context(_robot(Path(name)))
        command = [sys.executable, "-m", "robo", "bridge", "foxglove", "--connect", endpoint]
        bridge, url = stack.enter_context(_server([*command, "--listen", "127.0.0.1:0", "--json"]))
        found.append(_situation("no client", bridge, None, seconds))
        with _client(url) as client:
            found.append(_situation("one client, all topics", bridge, client, seconds))
            for number in range(9):
                stack.enter_context(_client(url, *(["--stalled"] if number == 0 else [])))
            found.append(_situation("ten clients, one of them reads nothing", bridge, client, seconds))
        raw, url = stack.enter_context(_server([*_own(), "--raw", endpoint]))
        client = stack.enter_context(_client(url))
        found.append(_situation("raw: one client, bytes as they are", raw, client, seconds))
    text = _report(found, seconds)
    print(text)
    if seconds >= _FULL:
        RESULTS.write_text(text, encoding="utf-8")
    broken = list(_broken(found))
    print("\n".join(broken))
    return not broken


def _broken(found: Sequence[Figures]) -> Iterator[str]:
    _, one, ten, _ = found
    if one.cpu > MOST_CPU:
        yield f"one client takes {one.cpu:.1f} % of a core, more than {MOST_CPU:g}"
    if one.memory > MOST_MEMORY:
        yield f"one client takes {one.memory:.0f} MB, more than {MOST_MEMORY:g}"
    if ten.memory - one.memory > MOST_MORE:
        yield f"ten clients take {ten.memory - one.memory:.0f} MB more, more than {MOST_MORE:g}"
    if ten.rate < 0.9 * one.rate:
        yield f"beside others a client gets {ten.rate:.0f} messages a second in the place of {one.rate:.0f}"


def _situation(name: str, server: psutil.Process, client: "Counter | None", seconds: float) -> Figures:
    time.sleep(2.0)  # until all is subscribed
    begin, used, count = time.monotonic(), sum(server.cpu_times()[:2]), client.count() if client is not None else 0
    time.sleep(seconds)
    took = time.monotonic() - begin
    cpu = (sum(server.cpu_times()[:2]) - used) / took * 100
    rate = ((client.count() - count) / took) if client is not None else 0.0
    return Figures(name, rate, cpu, server.memory_info().rss / 1e6)


class Counter:
    """How many messages a client has, as it prints them."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        self._out: IO[str] = process.stdout
        os.set_blocking(self._out.fileno(), False)
        self._count, self._rest = 0, ""

    def count(self) -> int:
        """What it printed last."""
        *lines, self._rest = (self._rest + (self._out.read() or "")).split("\n")
        if lines:
            self._count = int(lines[-1])
        return self._count


def _own() -> list[str]:
    return [sys.executable, "-m", "benchmarks.foxglove"]


@contextmanager
def _robot(folder: Path) -> Iterator[str]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    environment = {**os.environ, "XDG_STATE_HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
    command = [sys.executable, "-m", "robo", "up", "--robot-name", "r1", "--listen", endpoint]
    with _process(command, env=environment) as up:
        assert up.stdout is not None
        while "r1 is ready" not in up.stdout.readline():
            assert up.poll() is None
        yield endpoint


@contextmanager
def _server(command: list[str]) -> Iterator[tuple[psutil.Process, str]]:
    with _process(command, stderr=subprocess.DEVNULL) as server:
        assert server.stdout is not None
        yield psutil.Process(server.pid), json.loads(server.stdout.readline())["drive"]


@contextmanager
def _client(url: str, *more: str) -> Iterator[Counter]:
    with _process([*_own(), "--client", url, *more], stderr=subprocess.DEVNULL) as client:
        yield Counter(client)


@contextmanager
def _process(command: list[str], **how: Any) -> "Iterator[subprocess.Popen[str]]":
    how = {"stderr": subprocess.STDOUT, **how}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **how)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _report(found: Sequence[Figures], seconds: float) -> str:
    rows = [f"| {one.name} | {one.rate:.0f} | {one.cpu:.1f} | {one.memory:.0f} |" for one in found]
    return "\n".join(
        [
            "# The bridge to Foxglove and Lichtblick",
            "",
            f"Made by `python -m benchmarks.foxglove`, {seconds:g} s for each row, with the reference robot driving.",
            "",
            *machine(),
            "",
            "| | messages/s of a client | % of a core | MB |",
            "|---|---|---|---|",
            *rows,
            "",
        ]
    )


if __name__ == "__main__":
    main()
