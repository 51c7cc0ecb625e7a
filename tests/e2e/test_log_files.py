"""Log files of real runs: folders that go, disks that are full, floods, runs that are refused."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from robo.text.files import size_of
from tests.support import Running, eventually, plain_environment, robo, run_robo

TALK = "import time\nnumber = 0\nwhile True:\n    print(number, flush=True)\n    number += 1\n    time.sleep(0.05)\n"


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the logs of the test are kept, told as a desktop tells it: `Command` drops what begins with ROBO_."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "robo" / "log"


def manifest(folder: Path, log: str = "both", **commands: str) -> str:
    """A manifest of commands; its file."""
    file = folder / "talk.yaml"
    nodes = ", ".join(f"{name}: {{log: {log}, run: {json.dumps(command)}}}" for name, command in commands.items())
    file.write_text(f"groups: {{g: {{nodes: {{{nodes}}}}}}}\n")
    return str(file)


@pytest.fixture
def talking(tmp_path: Path) -> str:
    (tmp_path / "talk.py").write_text(TALK)
    return manifest(tmp_path, talker=f"{sys.executable} {tmp_path}/talk.py")


def numbers(text: str) -> list[int]:
    """What the talker has said, as far as it is there."""
    return [int(line.rpartition(" ")[2]) for line in text.splitlines() if " | " in line and line.split()[1] == "talker"]


def test_a_folder_that_goes_is_told_and_made_again(base: Path, talking: str, endpoint: str) -> None:
    with robo("up", talking, "--listen", endpoint) as run:
        run.wait_for("talker | 1")
        with held_up(run):  # it would make again what goes, or begin a file in it
            shutil.rmtree(base)
            base.write_text("in the way")
        run.wait_for("no log files are written")  # though the file that is open goes on growing, unseen
        assert "no log files are written since" in told("ps", endpoint)
        assert "lines are missing so far" in told("why", endpoint)
        assert json.loads(told("ps", endpoint, "--json"))["log_problem"]
        base.unlink()
        run.wait_for("log files are written again")
        last = max(numbers(run.output))
        run.wait_for(f"talker | {last + 5}")
        kept = run_robo("logs").stdout
        assert "lines are missing since" in kept
        assert max(numbers(kept)) > last


@contextmanager
def held_up(run: Running) -> Iterator[None]:
    """A supervisor does nothing meanwhile."""
    supervisor = psutil.Process(run.process.pid)
    supervisor.suspend()
    try:
        yield
    finally:
        supervisor.resume()


def told(verb: str, endpoint: str, *words: str) -> str:
    return run_robo(verb, *words, "--connect", endpoint).stdout


def test_where_files_lack_the_supervisor_is_asked(base: Path, talking: str, endpoint: str) -> None:
    with robo("up", talking, "--listen", endpoint) as run:
        run.wait_for("talker | 5")
        (file,) = base.glob("*/*/talker.jsonl")
        with held_up(run):
            file.rename(file.with_name("talker.jsonl.1"))
            file.mkdir()
        run.wait_for("no log files are written")
        last = max(numbers(run.output))
        run.wait_for(f"talker | {last + 5}")
        found = run_robo("logs", "talker")
        assert "no log files are written since" in found.stderr
        seen = numbers(found.stdout)
        assert seen == list(range(len(seen))), "none is missing, and none is there twice"
        assert len(seen) > last
        with robo("logs", "talker", "-f", "-n", "1") as follower:
            follower.wait_for("talker |")
            follower.wait_for(f"talker | {max(numbers(run.output)) + 10}")
        file.rmdir()
        run.wait_for("log files are written again")


@pytest.mark.skipif(os.geteuid() != 0 or sys.platform != "linux", reason="only root may mount a small disk")
def test_a_full_disk_stops_files_and_nothing_else(base: Path, talking: str, endpoint: str) -> None:
    base.mkdir(parents=True)
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(base)], check=False)
    if mounted.returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        with robo("up", talking, "--listen", endpoint) as run:
            run.wait_for("talker | 1")
            ballast = base / "ballast"
            try:
                with ballast.open("wb", buffering=0) as file:
                    while True:
                        file.write(b"x" * 4096)
            except OSError:
                pass
            run.wait_for("no log files are written: No space left on device")
            assert "No space left on device" in told("ps", endpoint)
            ballast.unlink()
            run.wait_for("log files are written again")
            last = max(numbers(run.output))
            run.wait_for(f"talker | {last + 5}")
            assert max(numbers(run_robo("logs").stdout)) > last
            (file_,) = base.glob("*/*/talker.jsonl")
            for line in file_.read_bytes().splitlines():
                json.loads(line)
            assert run.output.count("no log files are written") == 1
    finally:
        subprocess.run(["umount", "-l", str(base)], check=True)


@pytest.fixture
def floods(tmp_path: Path) -> str:
    (tmp_path / "endless.py").write_text("while True: print('x' * 1_000_000, end='')\n")
    endless = f"{sys.executable} {tmp_path}/endless.py"
    return manifest(tmp_path, noisy="yes", nul="cat /dev/zero", endless=endless, log="file")


def test_a_flood_is_logged_in_part_and_told_while_it_lasts(base: Path, floods: str, endpoint: str) -> None:
    with robo("up", floods, "--listen", endpoint) as run:
        run.wait_for("is ready")

        def told(name: str) -> bool:
            return any("left out: it prints too much" in file.read_text() for file in base.glob(f"*/*/{name}.jsonl"))

        eventually(lambda: all(map(told, ("noisy", "nul", "endless"))), "each flood is told while it goes on")
        assert run_robo("logs", "noisy", "-n", "1000").stdout.count("| y") > 10


def test_floods_fill_no_more_than_a_run_may(base: Path, floods: str, endpoint: str) -> None:
    words = [sys.executable, "-m", "robo", "up", floods, "--listen", endpoint]
    run = Running(words, env=plain_environment() | {"ROBO_LOG_RUN_LIMIT": "1"})
    try:
        for name in ("noisy", "nul", "endless"):
            run.wait_for(f"the log of {name} is full: its oldest lines go from now on")
        sizes = [sum(size_of(file) for file in base.glob("*/*/*.jsonl*")) for _ in range(20)]
        assert 200_000 < max(sizes) <= 1_000_000
        assert run.output.count("the log of noisy is full") == 1
    finally:
        run.close()


def test_a_run_that_is_refused_leaves_the_logs_of_the_one_that_runs(base: Path, talking: str, endpoint: str) -> None:
    with robo("up", talking, "--listen", endpoint) as run:
        run.wait_for("is ready")
        second = run_robo("up", talking, "--listen", endpoint)
        assert second.returncode == 1
        assert "runs already" in second.stdout
        assert numbers(run_robo("logs", "talker").stdout)
        assert len(list(base.glob("*/*"))) == 1


def test_a_limit_that_is_no_number_is_told(talking: str, endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBO_LOG_LIMIT", "much")
    found = run_robo("up", talking, "--listen", endpoint)
    assert found.returncode == 2
    assert "ROBO_LOG_LIMIT='much': say how many megabytes" in found.stderr
