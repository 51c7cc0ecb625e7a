"""Names for the parts of an exported file."""

import re
from itertools import chain, count

from robo.launch.plan import ProcessPlan


def slug(text: str) -> str:
    """A text as a name: what may not stand in one is `_`."""
    return re.sub(r"[^A-Za-z0-9_]", "_", text)


def take(name: str, taken: set[str], joint: str = "_") -> str:
    """A name, or the first of name_2, name_3 … that is not taken; it is then."""
    free = next(one for one in chain([name], (f"{name}{joint}{number}" for number in count(2))) if one not in taken)
    taken.add(free)
    return free


def robot_of(process: ProcessPlan) -> str:
    """The robot that a process belongs to."""
    return process.namespace.partition("/")[0]


def inner_name(process: ProcessPlan) -> str:
    """A process's full name within its robot."""
    return process.full_name.strip("/").removeprefix(robot_of(process)).strip("/") or process.name
