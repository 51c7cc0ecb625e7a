"""The pytest plugin in runs of its own: what it says of nodes that hang, die or leave something, and what is left."""

import re
import subprocess
import sys

import psutil
import pytest

pytest_plugins = ["pytester"]

NODE = """
import os, sys, threading, time

import pytest
import robo
from robo import Node, subscribe
from robo.testing import RunNode
from robo_messages import String


class Arm(Node):
    @subscribe("order")
    def on_order(self, order: String) -> None:
        print("arm is told to", order.data)
        if order.data == "hang":
            while True:
                time.sleep(0.01)
        elif order.data == "die":
            sys.exit("the arm is broken")
        elif order.data == "fork":
            print("child", os.spawnlp(os.P_NOWAIT, "sleep", "sleep", "987654"))
        elif order.data == "thread":
            threading.Thread(target=threading.Event().wait, name="of the arm", daemon=False).start()


@pytest.fixture
def arm(run_node):
    return run_node(Arm, namespace="r1")


@pytest.fixture
def impatient(clock):
    clock.patience = 1.0


"""

FAULTS = {
    "def test_hang(arm, impatient):\n    arm.send('order', String('hang'))\n": [
        r"Hung: /r1/arm: on_order has been running for \d\.\d s",
        r"the thread robo-r1/order has not come back for 1 s; it stands at",
        r"in on_order\n.*time\.sleep\(0\.01\)",
        "arm is told to hang",
        r"the test has left behind\n.*the thread robo-r1/order, at .*test_arm\.py:\d+ in on_order",
    ],
    "def test_die(arm):\n    arm.send('order', String('die'))\n": [
        "NodeEnded: /r1/arm ended with exit code 1; its log says why",
        "CRITICAL .*the arm is broken",
        "arm is told to die",
    ],
    "def test_fork(arm):\n    arm.send('order', String('fork'))\n": [
        r"Leak: the test has left behind\n.*the process \d+: sleep 987654",
        "arm is told to fork",
    ],
    "def test_thread(arm):\n    arm.send('order', String('thread'))\n": [
        r"Leak: the test has left behind\n.*the thread of the arm, at .*threading\.py",
        "robo: still running, and given up: the thread of the arm",
    ],
    "def test_session(nothing_left):\n    robo.open_session(robo.Network(mode='peer'))\n": [
        r"Leak: the test has left behind\n.*a session, [0-9a-f]+, that nobody has closed",
    ],
}
"""What a test does, and what the run says of it."""

FINE = "def test_fine(arm):\n    arm.send('order', String('rest'))\n\n\n"


def run(pytester: pytest.Pytester, tests: str, *options: str) -> "subprocess.CompletedProcess[str]":
    """Run tests as a user does; without the entry point, so that it is the plugin of this checkout."""
    pytester.makepyfile(test_arm=NODE + tests)
    pytester.makeini("[pytest]\nfilterwarnings = error\n")
    command = [sys.executable, "-m", "pytest", "-p", "no:robo", "-p", "robo.testing.plugin", *options]
    return subprocess.run(
        command, cwd=pytester.path, capture_output=True, text=True, timeout=60, check=False, stdin=subprocess.DEVNULL
    )


def children_named(output: str) -> list[int]:
    return [int(pid) for pid in re.findall(r"^child (\d+)$", output, re.MULTILINE)]


@pytest.mark.parametrize("options", [("-p", "no:xdist"), ("-n", "2")], ids=["in one process", "in two"])
def test_what_goes_wrong_is_named_and_does_not_survive(pytester: pytest.Pytester, options: tuple[str, ...]) -> None:
    ended = run(pytester, FINE + "\n\n".join(FAULTS), *options)
    output = ended.stdout + ended.stderr
    assert ended.returncode == 1, output
    for patterns in FAULTS.values():
        for pattern in patterns:
            if "given up" not in pattern or "no:xdist" in options:  # what workers print at their end is not shown
                assert re.search(pattern, output), f"{pattern}\n{output}"
    # A test that hangs fails, and what it leaves is an error of its own; the others fail at their end.
    assert re.search(r"1 failed, 5 passed, 5 errors in", output), output
    assert not any(map(psutil.pid_exists, children_named(output)))


def test_fine_tests_leave_nothing_and_say_nothing(pytester: pytest.Pytester) -> None:
    ended = run(pytester, FINE)
    assert ended.returncode == 0, ended.stdout
    assert ended.stderr == ""
    assert "1 passed" in ended.stdout


def test_a_patience_that_is_none_is_told(pytester: pytest.Pytester) -> None:
    ended = run(pytester, FINE, "-o", "robo_patience=soon", "-p", "no:xdist")
    assert ended.returncode != 0
    assert "robo_patience = soon: say how many seconds, such as 10" in ended.stdout + ended.stderr


def test_it_needs_none_of_pytests_other_plugins(pytester: pytest.Pytester) -> None:
    ended = run(pytester, FINE, "-p", "no:xdist", "-p", "no:logging", "-p", "no:capture", "-p", "no:timeout")
    assert ended.returncode == 0, ended.stdout + ended.stderr
