"""`python -m robo.testing.regression`: reads a `Request` from stdin, tells lines of JSON on stdout.

The command line runs it: `{"done": 0.4, "stage": "run 1 of 2"}` while it works, then `{"report": …}` or
`{"mistake": …}`.
"""

import os
import signal
import sys
from typing import Any

import msgspec

from robo.bag.regression.report import ReplayReport
from robo.errors import RoboError
from robo.launch.faults import ManifestFaults, as_text
from robo.process.endings import raised_by_signals
from robo.testing.regression.judge import Request, judge
from robo.text.readable import readable


def main() -> None:
    """Do what is asked."""
    for number in (signal.SIGINT, signal.SIGTERM):  # whoever asked has gone: nothing stays behind
        signal.signal(number, lambda *_: sys.exit(130))
    lines = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # classes are looked at here, and may print

    def tell(line: dict[str, Any]) -> None:
        lines.write(msgspec.json.encode(line) + b"\n")

    request = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=readable(Request))
    try:
        with raised_by_signals():
            report: ReplayReport = judge(request, lambda done, stage: tell({"done": done, "stage": stage}))
        tell({"report": report})
    except ManifestFaults as error:
        tell({"mistake": as_text(error.faults)})
    except RoboError as error:
        tell({"mistake": str(error)})
    except BrokenPipeError:
        sys.exit(130)


if __name__ == "__main__":
    main()
