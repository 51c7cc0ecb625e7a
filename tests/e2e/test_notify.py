"""What a service manager hears of a real run, over a socket of the test's."""

import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support import PATIENCE, Running, plain_environment

pytestmark = pytest.mark.timeout(180)

MANIFEST = """
groups:
  g:
    namespace: ${robot_name}
    nodes:
      smoother: {service: robo_services.velocity_smoother}
      late: {run: [python3, late.py], ready: {log: here}, needs: [smoother]}
      broken: {run: [python3, -c, "import sys; sys.exit(3)"]}
"""
LATE = """
import os, time
print("found", sorted({"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"} & os.environ.keys()), flush=True)
while not os.path.exists("go"):
    time.sleep(0.02)
print("here", flush=True)
time.sleep(1e6)
"""


class Manager:
    """A service manager that only listens."""

    def __init__(self, address: Path) -> None:
        self.lines: list[str] = []
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(address))

    def wait_for(self, text: str) -> None:
        """Listen until a line is said that begins so."""
        end = time.monotonic() + PATIENCE
        while not any(line.startswith(text) for line in self.lines):
            assert self.hear(end - time.monotonic()), f"no {text!r} in {self.lines}"

    def hear(self, seconds: float) -> bool:
        """Hear what is said next; returns whether anything was."""
        self._socket.settimeout(max(0.001, seconds))
        try:
            self.lines += self._socket.recv(65_536).decode().split("\n")
        except TimeoutError:
            return False
        return True

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    there = Manager(tmp_path / "notify")
    yield there
    there.close()


def test_a_run_tells_how_it_comes_along(tmp_path: Path, manager: Manager, endpoint: str) -> None:
    (tmp_path / "m.yaml").write_text(MANIFEST)
    (tmp_path / "late.py").write_text(LATE)
    # Whose process id is not known yet: systemd says it, of a service, and leaves it out where a shell is in between.
    environment = plain_environment() | {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "600000"}
    words = ["up", "m.yaml", "--robot-name", "r1", "--listen", endpoint]
    run = Running([sys.executable, "-m", "robo", *words], cwd=str(tmp_path), env=environment)
    try:
        run.wait_for("found []")
        manager.wait_for("STATUS=1 of 3 nodes ready; ")
        manager.wait_for("EXTEND_TIMEOUT_USEC=")
        manager.wait_for("WATCHDOG=1")
        assert "READY=1" not in manager.lines
        (tmp_path / "go").touch()
        manager.wait_for("READY=1")
        manager.wait_for("STATUS=2 of 3 nodes ready; broken failed: ended with exit code 3")

        os.kill(run.process.pid, signal.SIGSTOP)  # whoever hangs gives no sign of life
        while manager.hear(1.5):  # what was said before
            pass
        manager.lines.clear()
        os.kill(run.process.pid, signal.SIGCONT)
        manager.wait_for("WATCHDOG=1")

        run.process.send_signal(signal.SIGTERM)
        manager.wait_for("STOPPING=1")
        assert run.wait() in (0, 1)
        assert any(line.startswith("EXTEND_TIMEOUT_USEC=17") for line in manager.lines)
    finally:
        run.close()


def test_a_watchdog_for_another_process_hears_nothing(tmp_path: Path, manager: Manager, endpoint: str) -> None:
    (tmp_path / "m.yaml").write_text("groups: {g: {nodes: {s: {run: [sleep, '1000']}}}}")
    address = {"NOTIFY_SOCKET": str(tmp_path / "notify")}
    environment = plain_environment() | address | {"WATCHDOG_USEC": "600000", "WATCHDOG_PID": "1"}
    words = ["up", "m.yaml", "--robot-name", "r1", "--listen", endpoint]
    run = Running([sys.executable, "-m", "robo", *words], cwd=str(tmp_path), env=environment)
    try:
        manager.wait_for("READY=1")
        run.process.send_signal(signal.SIGTERM)
        manager.wait_for("STOPPING=1")
        assert "WATCHDOG=1" not in manager.lines
        assert run.wait() == 0
    finally:
        run.close()
