"""The clients of `benchmarks.dead_links`: those whose links die, those that watch, one that floods.

`python -m benchmarks.dead_links_worker VERB …`; each says `ready` once it has joined.
"""

import json
import os
import sys
import threading
import time
from itertools import pairwise

import zenoh

from robo.wire.codec import unpack_attachment
from robo.wire.network import Network
from robo.wire.session import open_session

LOCAL = "tcp/127.0.0.1:7447"
CALL_EVERY = 0.1
"""s."""
FLOOD_SIZE, FLOOD_RATE = 500_000, 20.0
"""Bytes of a message, and Hz: as a camera's."""


def main() -> None:
    verb, *words = sys.argv[1:]
    if verb == "watch":
        watch(float(words[0]))
    elif verb == "flood":
        flood(zenoh.CongestionControl.BLOCK if words[0] == "block" else zenoh.CongestionControl.DROP)
    else:
        be_many(words[0], int(words[1]), strange=verb == "strangers")


def tool(endpoint: str) -> zenoh.Session:
    """A client with robo's settings."""
    return open_session(Network(mode="client", connect=(endpoint,)))


def stranger(endpoint: str) -> zenoh.Session:
    """A client with the settings that Zenoh comes with."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    return zenoh.open(config)


def be_many(endpoint: str, count: int, *, strange: bool) -> None:
    """So many clients that subscribe to everything."""
    sessions = [stranger(endpoint) if strange else tool(endpoint) for _ in range(count)]
    subscribers = [session.declare_subscriber("**", zenoh.handlers.RingChannel(10)) for session in sessions]
    print("ready", len(subscribers), flush=True)
    threading.Event().wait()


def flood(control: zenoh.CongestionControl) -> None:
    """Publish large messages through the router."""
    publisher = tool(LOCAL).declare_publisher("r1/image", congestion_control=control)
    print("ready", flush=True)
    while True:
        publisher.put(bytes(FLOOD_SIZE))
        time.sleep(1 / FLOOD_RATE)


def watch(seconds: float) -> None:
    """Print what passes through the router: the longest gap and age of odometry, the longest call, s."""
    arrivals: list[tuple[float, float]] = []
    calls: list[float] = []
    failed = 0

    def arrived(sample: zenoh.Sample) -> None:
        said = unpack_attachment(sample.attachment.to_bytes()) if sample.attachment is not None else None
        arrivals.append((time.monotonic(), time.time() - said.source_time * 1e-9 if said is not None else 0.0))

    listener, caller = tool(LOCAL), tool(LOCAL)
    listener.declare_subscriber("r1/odom", arrived)
    while len(arrivals) < 10:
        time.sleep(0.05)
    print("ready", flush=True)
    begin = time.monotonic()

    def call() -> None:
        nonlocal failed
        while time.monotonic() - begin < seconds:
            asked = time.monotonic()
            answers = [reply.ok for reply in caller.get("r1/emergency_stop", payload=b"\x80", timeout=30.0)]
            calls.append(time.monotonic() - asked)
            failed += not answers or None in answers
            time.sleep(CALL_EVERY)

    calling = threading.Thread(target=call)
    calling.start()
    time.sleep(seconds)
    end = time.monotonic()
    calling.join()
    counted = [(at, age) for at, age in arrivals if at >= begin]
    gap = max(b - a for a, b in pairwise([begin, *(at for at, _ in counted if at < end), end]))
    print(json.dumps([gap, max(age for _, age in counted), max(calls), failed, len(calls)]), flush=True)
    os._exit(0)


if __name__ == "__main__":
    main()
