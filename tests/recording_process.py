"""A process that records until it is killed, and says after each message how many were written:

python -m tests.recording_process FILE MESSAGES_PER_SECOND
"""

import sys
import time

from robo import bag
from robo.bag.types import topic_of
from robo_messages import Twist
from tests import bags


def main() -> None:
    """Record commands, and print the number and the time of each, ns."""
    path, rate = sys.argv[1], float(sys.argv[2])
    compression: bag.Compression = "zstd" if bags.readable("zstd") else "none"
    with bag.Recording(path, bag.Options(compression=compression)) as recording:
        number = recording.topic(topic_of("r1/cmd_vel", Twist))
        begin, sequence = time.monotonic(), 0
        while True:
            sequence += 1
            now = time.time_ns()
            recording.write(number, bags.twist(sequence), now, now, sequence, "here")
            sys.stdout.write(f"{sequence} {now}\n")
            sys.stdout.flush()
            time.sleep(max(0.0, begin + sequence / rate - time.monotonic()))


if __name__ == "__main__":
    main()
