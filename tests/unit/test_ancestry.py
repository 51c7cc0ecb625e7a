"""Who has started whom, and when, with as little of /proc as a hardened service has."""

import os
import subprocess
import sys
import time

from robo.machine import ancestry

_PARENT = """
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
print(child.pid, flush=True)
input()
child.communicate(b"\\n")
"""


def test_parents_and_children_are_found_over_generations() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _PARENT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        grandchild = int(parent.stdout.readline())
        assert ancestry.ancestors(grandchild)[:2] == [parent.pid, os.getpid()]
        assert {parent.pid, grandchild} <= {*ancestry.descendants(os.getpid())}
        assert ancestry.descendants(parent.pid) == [grandchild]
        assert ancestry.descendants(grandchild) == []
        parent.communicate("\n")
    assert ancestry.ancestors(grandchild) == []


def test_the_age_of_a_process_is_that_of_its_start() -> None:
    before = time.monotonic()
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        # The kernel counts in hundredths of a second.
        assert -0.02 <= ancestry.age(process.pid) <= time.monotonic() - before + 0.02
        process.communicate(b"\n")
    assert ancestry.age(os.getpid()) > 0
