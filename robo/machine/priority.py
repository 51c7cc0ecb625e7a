"""The priority and the processors of a process."""

import os
from collections.abc import Sequence


def give_priority(pid: int, nice: int | None, cpus: Sequence[int]) -> str | None:
    """Give a new process its priority and its processors, before it has a second thread.

    Args:
        pid: its id.
        nice: its nice value; None for that of the supervisor.
        cpus: the processors that it may use; empty for all.

    Returns:
        Where it has to run without them, what it lacks and why.
    """
    try:
        if nice is not None:
            os.setpriority(os.PRIO_PROCESS, pid, nice)
        if cpus:
            os.sched_setaffinity(pid, cpus)
    except ProcessLookupError:
        return None  # it has ended already
    except (OSError, ValueError, AttributeError) as error:
        # macOS has no affinity, and a lower nice value needs rights that most users lack.
        wishes = [f"priority {nice}"] if nice is not None else []
        wishes += [f"cpus {list(cpus)}"] if cpus else []
        return f"{' '.join(wishes)}: {error}"
    return None
