"""A process that keeps commands in a ring until it is killed, and says how many are in it for good:

python -m tests.flight_process FOLDER
"""

import itertools
import sys
import time
from pathlib import Path

from robo.bag.types import topic_of
from robo.recording.flight.ring import Limits, Ring
from robo_messages import Twist
from tests import bags


def main() -> None:
    """Keep 1,000 commands a second."""
    ring = Ring(Path(sys.argv[1]), Limits(duration=30.0, size=10_000_000), time.time_ns())
    number = ring.recording.topic(topic_of("r1/cmd_vel", Twist))
    for sequence in itertools.count(1):
        now = time.time_ns()
        ring.recording.write(number, bags.twist(sequence), now, now, sequence, "here")
        if sequence % 100 == 0:
            ring.recording.flush()
            sys.stdout.write(f"{sequence}\n")
            sys.stdout.flush()
        time.sleep(0.001)


if __name__ == "__main__":
    main()
