"""A systemd of its own, as the first process of a PID namespace, with units that a test brings and no others.

It has its own /proc, /run, /tmp, /srv, /var/lib, /var/log, /etc/systemd and control groups; nothing of it reaches the
machine's systemd, nor anything that this one has started. robo is below /srv, wherever it is here: a checkout may be
in a folder that a service does not see. It takes root, and a kernel that lets it.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from robo.machine import cgroup
from tests.support import eventually

UNITS = "/etc/systemd/system"
_TARGETS = ("lab", "sysinit", "basic", "shutdown", "multi-user", "network-online", "time-sync")
_OWN = ("/run", "/tmp", "/var/lib", "/var/log", "/etc/systemd")
_CHECKOUT, _PACKAGES = "/srv/robo/checkout", "/srv/robo/packages"
_SCRIPT = f"""
set -e
mount --make-rprivate /
mount -t proc proc /proc
mount -t tmpfs tmpfs /srv
mkdir -p {_CHECKOUT} {_PACKAGES}
mount --bind "$CHECKOUT" {_CHECKOUT}
mount --bind "$PACKAGES" {_PACKAGES}
for place in {" ".join(_OWN)}; do mount -t tmpfs tmpfs $place; done
mount -t tmpfs tmpfs /sys/fs/cgroup
for line in $HIERARCHIES; do
    kind=${{line%%:*}}; line=${{line#*:}}; options=${{line%%:*}}; place=${{line#*:}}
    mkdir -p $place
    mount -t $kind ${{options:+-o $options}} cgroup $place
done
mkdir -p /run/systemd/system {UNITS}
for name in {" ".join(_TARGETS)}; do
    printf '[Unit]\\nDescription=%s\\nDefaultDependencies=no\\n' $name > /run/systemd/system/$name.target
done
exec env -i container=lab PATH=$PATH SYSTEMD_UNIT_PATH={UNITS}:/run/systemd/system SYSTEMD_LOG_TARGET=console \\
    $SYSTEMD --system --unit=lab.target
"""


class SystemdMachine:
    """A machine of its own, as far as systemd goes."""

    def __init__(self, init: int) -> None:
        self._init = init
        """The id of its systemd, as this machine sees it."""

    def run(self, *words: str, timeout: float = 60.0, cwd: str = "/srv") -> "subprocess.CompletedProcess[str]":
        """Run a command there, to its end."""
        return subprocess.run(
            [
                "nsenter",
                "-t",
                str(self._init),
                "-m",
                "-p",
                "-u",
                "-i",
                "-C",
                f"--wd=/proc/{self._init}/root{cwd}",
                *words,
            ],
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
            stdin=subprocess.DEVNULL,
        )

    def write(self, path: str, text: str) -> None:
        """Write a file there, which everybody may read."""
        file = Path(f"/proc/{self._init}/root{path}")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        file.chmod(0o644)

    def read(self, path: str) -> str:
        """A file there."""
        return Path(f"/proc/{self._init}/root{path}").read_text()

    def show(self, unit: str, name: str) -> str:
        """A property of a unit, as systemd says it."""
        return self.run("systemctl", "show", "--value", f"--property={name}", unit).stdout.strip()

    def host_pid(self, pid: int) -> int:
        """The process id, as this machine sees it, of a process there."""
        for process in psutil.process_iter():
            with suppress(OSError, psutil.Error, StopIteration, ValueError):
                lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
                inner = next(line for line in lines if line.startswith("NSpid:")).split()[1:]
                of_machine = os.readlink(f"/proc/{process.pid}/ns/pid") == os.readlink(f"/proc/{self._init}/ns/pid")
                if of_machine and int(inner[-1]) == pid:
                    return process.pid
        raise LookupError(f"no process {pid} there")

    def processes(self) -> list[str]:
        """The command lines of all processes there but systemd."""
        found = []
        for name in os.listdir(f"/proc/{self._init}/root/proc"):
            if name.isdecimal() and name != "1":
                with suppress(OSError):
                    words = Path(f"/proc/{self._init}/root/proc/{name}/cmdline").read_bytes().split(b"\0")
                    found.append(b" ".join(words).decode(errors="replace").strip())
        return [words for words in found if words]


def _hierarchies() -> tuple[list[str], list[Path]]:
    """The mounts of control groups as the script takes them, and this process's folders in them."""
    mounts, folders = [], []
    own = cgroup.own_folders()
    for line in Path("/proc/self/mountinfo").read_text().splitlines():
        left, right = line.split(" - ")
        kind, _, options = right.split()[:3]
        if kind not in ("cgroup", "cgroup2"):
            continue
        names = [word for word in options.split(",") if word not in ("rw", "ro")] if kind == "cgroup" else []
        named = [name for name in names if name.startswith("name=")]
        mine = own.get(named[0] if named else names[0] if names else "")
        if mine is not None and "cpuset" not in names:  # there a new group has no processors, and takes nobody in
            mounts.append(f"{kind}:{','.join((['none'] if named else []) + names)}:{left.split()[4]}")
            folders.append(mine)
    return mounts, folders


@contextmanager
def systemd_machine() -> Iterator[SystemdMachine]:
    """Start one, and end all of it. Where that is not possible, the test is skipped."""
    systemd = next(filter(os.path.exists, ("/lib/systemd/systemd", "/usr/lib/systemd/systemd")), None)
    if systemd is None or shutil.which("systemctl") is None:
        pytest.skip("systemd is not installed")
    if os.getuid() != 0 or shutil.which("unshare") is None or shutil.which("nsenter") is None:
        pytest.skip("a systemd of its own takes root, unshare and nsenter")
    mounts, own = _hierarchies()
    folders = [folder / f"robo-lab-{os.getpid()}" for folder in own]
    try:
        for folder in folders:
            folder.mkdir(exist_ok=True)
    except OSError as error:
        pytest.skip(f"no control groups can be made here: {error}")
    into = " && ".join(f"echo $$ > {folder}/cgroup.procs" for folder in folders)
    unshare = "exec unshare --fork --pid --mount --uts --ipc --cgroup --kill-child bash -c"
    command = ["bash", "-c", f'{into} && {unshare} "$0"', _SCRIPT]
    environment = {
        "PATH": os.environ["PATH"],
        "HIERARCHIES": " ".join(mounts),
        "SYSTEMD": systemd,
        "CHECKOUT": str(Path(__file__).parents[1]),
        "PACKAGES": sysconfig.get_path("purelib"),
    }
    process = subprocess.Popen(
        command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    try:
        init = _init_of(process)
        machine = SystemdMachine(init)
        eventually(lambda: machine.show("lab.target", "ActiveState") == "active", "systemd has started")
        yield machine
    finally:
        process.kill()  # with it goes its namespace, and all that is in there
        process.communicate()
        eventually(lambda: all(map(cgroup.remove, folders)), "its control groups are empty")


def _init_of(process: "subprocess.Popen[bytes]") -> int:
    """The id of the systemd, once it has become one."""
    end = time.monotonic() + 40.0
    while time.monotonic() < end:
        if process.poll() is not None:
            said = process.stdout.read().decode(errors="replace") if process.stdout is not None else ""
            pytest.skip(f"no systemd can be started here: {said.strip()[-300:]}")
        with suppress(psutil.Error):
            for child in psutil.Process(process.pid).children():
                if child.name() == "systemd":
                    return child.pid
        time.sleep(0.01)
    pytest.fail("no systemd within 40 s")


def readable_python() -> tuple[str, str]:
    """An interpreter of the same version that every user there may run, and where robo and its packages are.

    One in somebody's home, as of pyenv, is none.
    """
    real = Path(sys.executable).resolve()
    if real.is_relative_to("/root") or real.is_relative_to("/home"):
        system = Path("/usr/bin") / f"python{sys.version_info.major}.{sys.version_info.minor}"
        if not system.exists():
            pytest.skip(f"{real} is in a home, and there is no {system}: a service sees none that fits")
        real = system
    robo = (_CHECKOUT, f"{_CHECKOUT}/messages", f"{_CHECKOUT}/services")
    return str(real), os.pathsep.join([*robo, _PACKAGES])
