"""A robot as a service: its unit as systemd judges it, and run for real by a systemd of its own."""

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robo.export.systemd.unit import WATCHDOG
from tests.conftest import free_port
from tests.support import eventually, run_robo
from tests.systemd_machine import UNITS, SystemdMachine, readable_python, systemd_machine

pytestmark = pytest.mark.timeout(300)

MANIFEST = """
description: two nodes and a command
groups:
  g:
    namespace: ${robot_name}
    restart: on-failure
    limits: {memory: 400M}
    nodes:
      smoother: {service: robo_services.velocity_smoother}
      mux: {service: robo_services.twist_mux}
      port: {run: [python3, port.py]}
"""
PORT = """
import os, time
try:
    os.close(os.open("/dev/ttyS0", os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY))
    print("the port is opened", flush=True)
except OSError as error:
    print(f"the port is not opened: {error.strerror}", flush=True)
print("found", sorted(name for name in os.environ if "NOTIFY" in name or "WATCHDOG" in name), flush=True)
time.sleep(1e6)
"""
UNIT = "robo-r1.service"
LISTEN, OTHER = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
"""The machine has the network of this one."""


# -- as systemd judges it ----------------------------------------------------------------------------------------------


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--run-as", "daemon"),
        ("--run-as", "dynamic"),
        ("--run-as", "dynamic", "--device", "/dev/ttyUSB0", "--jit"),
        ("--user",),
    ],
    ids=["plain", "user", "dynamic", "device", "own manager"],
)
def test_its_unit_is_clean_and_hardly_exposed(tmp_path: Path, options: tuple[str, ...]) -> None:
    (tmp_path / "m.yaml").write_text(MANIFEST)
    system = () if "--user" in options else ("--system",)
    done = run_robo(
        "export", "systemd", "m.yaml", "--robot-name", "r1", *system, *options, "-o", ".", cwd=str(tmp_path)
    )
    assert done.returncode == 0, done.stderr
    own = ["--user"] if "--user" in options else []
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)}
    analyze = ["systemd-analyze", *own]
    verified = subprocess.run(
        [*analyze, "verify", "--recursive-errors=yes", f"./{UNIT}"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (verified.returncode, verified.stderr) == (0, "")
    if not own:
        judged = subprocess.run(
            [*analyze, "security", "--offline=true", "--threshold=20", f"./{UNIT}"],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert judged.returncode == 0, judged.stdout[-200:]


# -- run for real ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def machine() -> Iterator[SystemdMachine]:
    with systemd_machine() as there:
        there.write("/srv/m.yaml", MANIFEST)
        there.write("/srv/port.py", PORT)
        yield there


def robo(machine: SystemdMachine, *words: str) -> "subprocess.CompletedProcess[str]":
    python, packages = readable_python()
    return machine.run("env", f"PYTHONPATH={packages}", python, "-m", "robo", *words)


def install(machine: SystemdMachine, *options: str) -> str:
    words = ("m.yaml", "--robot-name", "r1", "--system", "--run-as", "dynamic", "--listen", LISTEN)
    done = robo(machine, "service", "install", *words, *options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def start(machine: SystemdMachine) -> int:
    """Start it; returns its main process."""
    done = machine.run("systemctl", "restart", UNIT)
    assert done.returncode == 0, (done.stderr, machine.run("systemctl", "status", UNIT).stdout, log(machine))
    return int(machine.show(UNIT, "MainPID"))


def log(machine: SystemdMachine) -> str:
    """What the last run has written."""
    folder = Path("/var/log/private/robo/r1/r1")
    newest = machine.run("sh", "-c", f"ls -d {folder}/*/ | tail -n 1").stdout.strip()
    return machine.run("sh", "-c", f"cat {newest}*.jsonl").stdout


def wait_for_next(machine: SystemdMachine, before: int) -> int:
    """Wait until another main process is ready."""

    def next_is_ready() -> bool:
        new = machine.show(UNIT, "MainPID") not in ("0", str(before))
        return new and machine.show(UNIT, "ActiveState") == "active"

    eventually(next_is_ready, "it is started again", 60.0)
    return int(machine.show(UNIT, "MainPID"))


def test_it_is_installed_once_and_is_ready_when_its_nodes_are(machine: SystemdMachine) -> None:
    first = install(machine)
    assert f"wrote {UNITS}/{UNIT}" in first
    assert "systemctl start robo-r1.service" in first
    assert "is there already, as it should be" in install(machine)
    assert machine.show(UNIT, "UnitFileState") == "enabled"

    main = start(machine)
    assert machine.show(UNIT, "StatusText") == "3 of 3 nodes ready"
    (found,) = json.loads(robo(machine, "service", "status", "--system", "--json").stdout)
    assert (found["robot"], found["state"], found["pid"]) == ("r1", "active (running)", main)
    assert not found["changed"]
    listed = robo(machine, "ps", "--robot-name", "r1", "--connect", LISTEN).stdout
    assert listed.count("ready") == 3, listed
    assert "found []" in log(machine)  # the variables of systemd are for the supervisor alone
    # A user that nobody else is, with limits by control groups of its own.
    assert machine.run("stat", "-c", "%U", f"/proc/{main}").stdout.strip() == "robo-r1"


def test_a_supervisor_that_hangs_is_killed_and_comes_back(machine: SystemdMachine) -> None:
    install(machine)
    machine.write(f"{UNITS}/{UNIT}.d/quick.conf", "[Service]\nWatchdogSec=2\nRestartSec=0.2\n")
    machine.run("systemctl", "daemon-reload")
    main = start(machine)
    os.kill(machine.host_pid(main), signal.SIGSTOP)
    after = wait_for_next(machine, main)
    assert after != main
    assert int(machine.show(UNIT, "NRestarts")) >= 1
    assert machine.show(UNIT, "StatusText") == "3 of 3 nodes ready"
    assert machine.show(UNIT, "WatchdogUSec") == "2s"


def test_a_supervisor_that_is_killed_comes_back_and_leaves_nothing(machine: SystemdMachine) -> None:
    install(machine)
    main = start(machine)
    before = machine.run("pgrep", "-f", "/r1/").stdout.split()
    assert before
    os.kill(machine.host_pid(main), signal.SIGKILL)
    wait_for_next(machine, main)
    assert not {*before} & {*machine.run("pgrep", "-f", "/r1/").stdout.split()}


def test_it_is_stopped_soon_and_whole(machine: SystemdMachine) -> None:
    install(machine)
    start(machine)
    begin = time.monotonic()
    assert machine.run("systemctl", "stop", UNIT).returncode == 0
    took = time.monotonic() - begin
    assert machine.show(UNIT, "Result") == "success"
    assert machine.show(UNIT, "ActiveState") == "inactive"
    assert machine.processes() == []
    assert took < WATCHDOG  # nobody had to be killed: that begins at TimeoutStopSec
    assert "stopping" in log(machine)


@pytest.mark.skipif(not os.path.exists("/dev/ttyS0"), reason="this machine has no serial port")
@pytest.mark.parametrize("granted", [False, True], ids=["none", "granted"])
def test_a_device_is_there_for_a_service_that_is_granted_it(machine: SystemdMachine, granted: bool) -> None:
    # As udev leaves a serial port; without it the port may be root's alone.
    made = "mknod /srv/ttyS0 c 4 64 && chgrp dialout /srv/ttyS0 && chmod 660 /srv/ttyS0"
    done = machine.run("sh", "-c", f"test -e /srv/ttyS0 || {{ {made} && mount --bind /srv/ttyS0 /dev/ttyS0; }}")
    assert done.returncode == 0, done.stderr
    install(machine, "--force", *(["--device", "/dev/ttyS0"] if granted else []))
    start(machine)
    told = log(machine)
    assert ("the port is opened" in told) == granted, told
    assert ("the port is not opened: No such file" in told) != granted, told


def test_what_somebody_has_changed_is_left_alone(machine: SystemdMachine) -> None:
    install(machine, "--force")
    text = machine.read(f"{UNITS}/{UNIT}")
    machine.write(f"{UNITS}/{UNIT}", text.replace("RestartSec=2", "RestartSec=7"))
    for words in (["install", "m.yaml", "--system", "--run-as", "dynamic"], ["remove"]):
        done = robo(machine, "service", *words, "--robot-name", "r1")
        assert done.returncode == 2
        assert "was changed since robo has written it; --force drops the changes" in done.stderr
    assert "RestartSec=7" in machine.read(f"{UNITS}/{UNIT}")
    (found,) = json.loads(robo(machine, "service", "status", "--json").stdout)
    assert found["changed"]

    assert robo(machine, "service", "remove", "--robot-name", "r1", "--force").returncode == 0
    assert robo(machine, "service", "status", "--json").stdout.strip() == "[]"
    assert machine.show(UNIT, "ActiveState") == "inactive"
    again = robo(machine, "service", "remove", "--robot-name", "r1")
    assert (again.returncode, "nothing is to be done" in again.stdout) == (0, True)


MANAGER = """
[Service]
User=daemon
Type=notify
ExecStart=/lib/systemd/systemd --user --unit=lab.target
Environment=XDG_RUNTIME_DIR=/run/user/1 HOME=/srv/home
Environment=SYSTEMD_UNIT_PATH=/srv/home/.config/systemd/user:/run/systemd/system
Delegate=yes
"""


@pytest.mark.skipif(not os.path.exists("/lib/systemd/systemd"), reason="systemd is elsewhere")
def test_a_users_own_service_manager_runs_it_without_root(machine: SystemdMachine) -> None:
    python, packages = readable_python()
    for folder in ("/run/user/1", "/srv/home"):
        machine.run("install", "-d", "-o", "daemon", folder)
    machine.write(f"{UNITS}/manager.service", MANAGER)
    machine.run("systemctl", "daemon-reload")
    began = machine.run("systemctl", "start", "manager.service")
    assert began.returncode == 0, began.stderr
    variables = ["XDG_RUNTIME_DIR=/run/user/1", "HOME=/srv/home", f"PYTHONPATH={packages}"]
    as_user = ["setpriv", "--reuid=daemon", "--clear-groups", "env", *variables]
    words = ("install", "m.yaml", "--robot-name", "r2", "--listen", OTHER)
    installed = machine.run(*as_user, python, "-m", "robo", "service", *words)
    assert installed.returncode == 0, installed.stderr
    assert "loginctl enable-linger" in installed.stdout
    started = machine.run(*as_user, "systemctl", "--user", "start", "robo-r2.service")
    assert started.returncode == 0, started.stderr
    status = machine.run(*as_user, python, "-m", "robo", "service", "status", "--robot-name", "r2", "--json")
    (found,) = json.loads(status.stdout)
    assert (found["manager"], found["state"], found["status"]) == ("user", "active (running)", "3 of 3 nodes ready")
    removed = machine.run(*as_user, python, "-m", "robo", "service", "remove", "--robot-name", "r2")
    assert removed.returncode == 0, removed.stderr
    assert not [words for words in machine.processes() if "/r2/" in words]
