"""The processes of `benchmarks.recording`: who publishes, and a raw subscriber; each says in JSON what it did.

python -m benchmarks.recording_worker publish|subscribe ENDPOINT WORKLOAD SECONDS
"""

import os
import random
import sys
import threading
import time

import msgspec
import zenoh

from robo import Node, Publisher
from robo.wire.network import Network
from robo.wire.session import open_session
from robo_messages import Header, Image, LaserScan, Odometry, Time, Twist, Vector3

RATES = {"robot": {"odom": 1_000.0, "cmd_vel": 1_000.0, "scan": 200.0}, "images": {"image": 30.0}}
"""Messages a second, by topic."""
SAID = 0.5
"""After its last message: how long the raw subscriber waits for more, s."""


class Robot(Node):
    """Says as much as a large robot."""

    odom = Publisher(Odometry, "odom")
    cmd_vel = Publisher(Twist, "cmd_vel")
    scan = Publisher(LaserScan, "scan")
    image = Publisher(Image, "image")


def publish(endpoint: str, workload: str, seconds: float) -> dict[str, object]:
    """Publish evenly, and say how many of each topic were published, and within which time."""
    rng = random.Random(0)
    header = Header(Time(1_700_000_000, 0), "base_link")
    messages = {
        "odom": Odometry(header, "base_link"),
        "cmd_vel": Twist(linear=Vector3(x=0.5)),
        "scan": LaserScan(header, ranges=[rng.uniform(0.1, 8.0) for _ in range(360)]),
        "image": Image(header, 480, 640, "rgb8", 0, 1_920, memoryview(rng.randbytes(921_600))),
    }
    session = open_session(Network(mode="peer", connect=(endpoint,)))
    with Robot(namespace="bench", session=session) as node:
        publishers = {name: getattr(node, name) for name in RATES[workload]}
        while not all(publisher.has_subscribers for publisher in publishers.values()):
            time.sleep(0.05)
        time.sleep(1.0)
        begin = time.monotonic()
        sent = dict.fromkeys(publishers, 0)
        while (now := time.monotonic() - begin) < seconds:
            for name, publisher in publishers.items():
                if sent[name] < RATES[workload][name] * now:
                    publisher.publish(messages[name])
                    sent[name] += 1
            due = min((count + 1) / RATES[workload][name] for name, count in sent.items())
            time.sleep(max(0.0, begin + due - time.monotonic()))
        took = time.monotonic() - begin
        time.sleep(SAID)
    return {"sent": sent, "seconds": took}


def subscribe(endpoint: str, workload: str, _seconds: float) -> dict[str, object]:
    """Count what comes, as plainly as Python can, until nothing more does."""
    session = open_session(Network(mode="client", connect=(endpoint,)))
    came = 0
    size = 0

    def take() -> None:
        nonlocal came, size
        while True:
            sample = subscriber.recv()
            came += str(sample.key_expr) in names  # and not what a node says of itself
            size += len(sample.payload.to_bytes())

    names = [f"bench/{name}" for name in RATES[workload]]
    expression = names[0] if len(names) == 1 else "bench/*"
    subscriber = session.declare_subscriber(expression, zenoh.handlers.FifoChannel(10_000))
    thread = threading.Thread(target=take, daemon=True)
    thread.start()
    sys.stdin.readline()
    used = time.process_time()
    sys.stdin.readline()
    used = time.process_time() - used
    return {"came": came, "size": size, "used": used}


def main() -> None:
    role, endpoint, workload, seconds = sys.argv[1:]
    act = publish if role == "publish" else subscribe
    sys.stdout.buffer.write(msgspec.json.encode(act(endpoint, workload, float(seconds))) + b"\n")
    sys.stdout.flush()
    os._exit(0)  # a thread still waits for messages


if __name__ == "__main__":
    main()
