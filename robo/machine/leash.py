"""`python -m robo.machine.leash PID COMMAND...`: becomes a command that is told to end when its parent ends.

However a test run ends, `kill -9` included, the robots that it has started end as well; so does a viewer with its tool.
The kernel looks at the thread that has started it: let that be one that lives as long as the process.
"""

import ctypes
import os
import signal
import sys

_PARENT_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG, linux/prctl.h


def end_with_parent(number: signal.Signals) -> None:
    """Have the kernel send this process a signal when its parent ends (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, number, 0, 0, 0)


def main(words: list[str]) -> None:
    """Become the command."""
    parent, *command = words
    end_with_parent(signal.SIGTERM)
    if os.getppid() == int(parent):  # else it has died before this could be said
        os.execv(command[0], command)


if __name__ == "__main__":
    main(sys.argv[1:])
