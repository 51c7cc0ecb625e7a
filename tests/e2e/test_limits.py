"""Processes that use more than they may, with real control groups where these can be made, and without."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from robo.machine import cgroup
from tests.support import PATIENCE, eventually, plain_environment, robo, run_robo

pytestmark = pytest.mark.timeout(120)

EATER = """
import robo
from robo import timer


class Eater(robo.Node):
    \"\"\"Need ever more memory.\"\"\"

    def on_start(self) -> None:
        self.kept: list[bytearray] = []

    @timer(rate=20.0)
    def eat(self) -> None:
        self.kept.append(bytearray(b"x" * 8_000_000))


class Quiet(robo.Node):
    \"\"\"Do nothing.\"\"\"
"""
MANIFEST = """
groups:
  g:
    namespace: ${robot_name}
    nodes:
      eater: {service: "eater:Eater", limits: {memory: 120M}%s}
      quiet: {service: "eater:Quiet"%s}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "eater.py").write_text(EATER)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def memory_group_is_to_be_had() -> bool:
    """Whether a group that limits memory can be made here."""
    own = cgroup.own_folders()
    folder = own.get("memory", own.get("", Path("/nowhere"))) / f"robo-test-{os.getpid()}"
    try:
        folder.mkdir()
    except OSError:
        return False
    found = (folder / "memory.limit_in_bytes").exists() or (folder / "memory.max").exists()
    folder.rmdir()
    return found


def why(endpoint: str) -> str:
    return run_robo("why", "eater", "--connect", endpoint).stdout


def test_a_node_that_allocates_without_bound_dies_by_its_limit_and_that_is_told(folder: Path, endpoint: str) -> None:
    (folder / "m.yaml").write_text(MANIFEST % ("", ""))
    with robo("up", "m.yaml", "--robot-name", "r1", "--listen", endpoint, cwd=str(folder)) as run:
        run.wait_for("eater was killed")
        said = "killed by SIGKILL: it needed more memory than its limit of 120M"
        if not memory_group_is_to_be_had():
            said = "of memory, and its limit is 120M"
        assert said in run.output
        assert said in why(endpoint)
        with robo("events", "--json", "--connect", endpoint) as events:
            event = json.loads(events.wait_for('"failed"'))
        assert (event["node"], said in event["reason"]) == ("/r1/eater", True)
        assert said in run_robo("logs", "robo", "--connect", endpoint).stdout
        listed = run_robo("ps", "--json", "--connect", endpoint).stdout.splitlines()
        states = {row["node"]: row["state"] for row in map(json.loads, listed)}
        assert states == {"/r1/eater": "failed", "/r1/quiet": "ready"}
        run.interrupt()
        run.wait()
    left = [folder for own in cgroup.own_folders().values() for folder in own.glob(f"robo-*-{run.process.pid}-*")]
    assert not left


def test_without_a_control_group_it_is_looked_at(folder: Path, endpoint: str) -> None:
    if os.getuid() != 0 or shutil.which("unshare") is None:
        pytest.skip("control groups that nobody may make take root and unshare")
    (folder / "m.yaml").write_text(MANIFEST % ("", ""))
    groups = [str(own) for own in {*cgroup.own_folders().values()} if own.is_dir()]
    hide = " && ".join(["mount --make-rprivate /", *(f"mount -t tmpfs -o ro tmpfs {group}" for group in groups)])
    up = f"{sys.executable} -m robo up m.yaml --robot-name r1 --listen {endpoint}"
    process = subprocess.Popen(
        ["unshare", "-m", "bash", "-c", f"{hide} && exec {up}"],
        cwd=folder, env=plain_environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    said = ""
    try:
        assert process.stdout is not None
        for line in process.stdout:
            said += line
            if "eater" in line and "of memory, and its limit is 120M" in line:
                break
    finally:
        process.send_signal(signal.SIGINT)
        said += process.communicate(timeout=PATIENCE)[0]
    assert "eater was killed by SIGKILL: it used " in said or "eater failed" in said, said
    assert "of memory, and its limit is 120M" in said


def test_nodes_that_share_a_process_end_together_and_each_is_told_why(folder: Path, endpoint: str) -> None:
    (folder / "m.yaml").write_text(MANIFEST % (", process: both", ", process: both"))
    with robo("up", "m.yaml", "--robot-name", "r1", "--listen", endpoint, cwd=str(folder)) as run:
        run.wait_for("eater failed")
        run.wait_for("quiet failed")
        assert "its limit" in why(endpoint)


def test_open_files_have_a_limit(folder: Path, endpoint: str) -> None:
    code = "import sys; kept = [open('/dev/null') for _ in range(100)]"
    (folder / "files.py").write_text(code)
    (folder / "m.yaml").write_text("groups: {g: {nodes: {f: {run: [python3, files.py], limits: {files: 50}}}}}")
    with robo("up", "m.yaml", "--robot-name", "r1", "--listen", endpoint, cwd=str(folder)) as run:
        run.wait()
        assert "f failed: exit code 1: it had as many files open as its limit of 50 allows" in run.output


def test_a_run_in_the_background_keeps_no_file_that_grows(folder: Path, endpoint: str) -> None:
    (folder / "m.yaml").write_text("groups: {g: {nodes: {y: {run: 'yes hello'}}}}")
    done = run_robo("up", "m.yaml", "-d", "--robot-name", "r1", "--listen", endpoint, cwd=str(folder))
    assert done.returncode == 0, done.stderr
    pid = int(done.stdout.partition("(process ")[2].partition(")")[0])
    try:

        def quiet() -> bool:
            return {os.readlink(f"/proc/{pid}/fd/{stream}") for stream in (1, 2)} == {os.devnull}

        eventually(quiet, "what it prints goes nowhere")
        files = [
            file for file in psutil.Process(pid).open_files() if "deleted" in os.readlink(f"/proc/{pid}/fd/{file.fd}")
        ]
        assert not files
    finally:
        assert run_robo("down", "--robot-name", "r1", "--connect", endpoint).returncode == 0
