"""A secured network for tests: a keystore, a router, a robot, and sessions of its people and of intruders."""

import functools
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

import zenoh

from robo.security import certificates
from robo.security.keystore import Keystore
from robo.wire.network import Mode, Network, zenoh_config
from tests.conftest import free_port
from tests.support import PATIENCE, Running, plain_environment

NOBODY = 65534
AS_NOBODY = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
"""Words before a command of another user."""
VERY_SHORT = 1e-6
"""Days: a certificate that has expired when it is written."""


class Site:
    """A router with its keystore, and a robot that drives."""

    def __init__(self, folder: Path, *, secured: bool = True) -> None:
        self.folder = folder
        self.secured = secured
        self.protocol = "tls" if secured else "tcp"
        self.endpoint = f"{self.protocol}/127.0.0.1:{free_port()}"
        self.door = f"{self.protocol}/127.0.0.1:{free_port()}"
        """Where the robot itself listens."""
        self.store = Keystore(folder / "security")
        self.other = Keystore(folder / "other")
        """Of another network."""
        self._stack = ExitStack()
        self._environment = {**plain_environment(), "XDG_STATE_HOME": str(folder / "state"), "ROBO_LOG_LEVEL": "warn"}
        if secured:
            self._make()
        self.router = self.start("router", "--name", "site", "--listen", self.endpoint, security="site")
        self.router.wait_for("router site at")
        words = ("simulation.yaml", "--robot-name", "r1", "--connect", self.endpoint, "--listen", self.door)
        self.robot = self.start("up", *words, security="r1")
        self.robot.wait_for("r1 is ready")
        self.robot.wait_for(f"{self.endpoint} is reached")

    def _make(self) -> None:
        self.store.init("site")
        for name, role in {
            "site": "router", "r1": "robot", "r2": "robot", "ann": "operator", "eve": "viewer", "gone": "viewer",
        }.items():  # fmt: skip
            self.store.add(name, role, (), 30)  # type: ignore[arg-type]
        self.store.add("late", "viewer", (), VERY_SHORT)
        self.keep("gone")
        self.store.revoke("gone")
        self.other.init("other")
        self.other.add("mallory", "operator", (), 30)
        self.other.add("false", "router", (), 30)

    def of_another_host(self) -> Path:
        """A folder with the key and the certificate of a router of this network that is on another host."""
        folder = self.folder / "elsewhere"
        if not folder.exists():
            folder.mkdir(mode=0o700)
            ca = certificates.Pair(self.store.ca_key.read_bytes(), (self.store.folder / "ca.pem").read_bytes())
            key = certificates.make_key()
            (folder / "key.pem").write_bytes(key)
            issued = certificates.issue(ca, key, "elsewhere", ("other.example",), days=1, serves=True)
            (folder / "cert.pem").write_bytes(issued)
        return folder

    def keep(self, name: str) -> None:
        """Have an intruder keep a copy of a name's folder."""
        kept = self.kept(name)
        kept.mkdir(mode=0o700)
        for file in self.store.name_folder(name).iterdir():
            (kept / file.name).write_bytes(file.read_bytes())
            (kept / file.name).chmod(0o600)

    def kept(self, name: str) -> Path:
        """Where an intruder keeps it."""
        return self.folder / f"kept_{name}"

    def name(self, name: str) -> Path:
        """The folder of a name."""
        for folder in self.store.name_folder(name), self.other.name_folder(name), self.kept(name):
            if folder.is_dir():
                return folder
        raise LookupError(name)

    def start(self, *words: str, security: str = "") -> Running:
        """Start a command that ends with the site."""
        secured = ["--security", str(self.name(security))] if security and self.secured else []
        command = [sys.executable, "-m", "robo", *words, *secured]
        running = Running(command, cwd=str(self.folder), env=self._environment)
        self._stack.callback(running.close)
        return running

    def run(self, *words: str, security: str = "", endpoint: str | None = None) -> tuple[int, str]:
        """Run a tool to its end: its exit code and all that it prints."""
        running = self.start(*words, "--connect", endpoint or self.endpoint, security=security)
        return running.wait(PATIENCE), running.output

    def session(self, name: str | Path, mode: Mode = "client", endpoint: str | None = None) -> zenoh.Session:
        """A session as one of its people has it, or as who has a name's folder has it."""
        folder = name if isinstance(name, Path) else self.name(name) if self.secured else ""
        network = Network(
            mode=mode,
            connect=(endpoint or self.endpoint,), timeout=PATIENCE,
            security=str(folder),
        )  # fmt: skip
        return self.keep_open(zenoh.open(zenoh_config(network)))

    def intruder(self, name: str, **settings: object) -> zenoh.Session:
        """A session of somebody who sets Zenoh up as he likes, with the files of a name, where they let him in.

        Raises:
            ZError: they do not.
        """
        own: dict[str, object] = {
            "mode": "client",
            "connect/endpoints": [self.endpoint],
            "scouting/multicast/enabled": False,
            "transport/shared_memory/enabled": False,
        }
        if self.secured and name:
            folder = self.name(name)
            own["transport/link/tls"] = {
                "enable_mtls": True, "root_ca_certificate": str(self.store.folder / "ca.pem"),
                "connect_private_key": str(folder / "key.pem"), "connect_certificate": str(folder / "cert.pem"),
            }  # fmt: skip
        return self.keep_open(zenoh.open(plain_config(own | {k.replace("__", "/"): v for k, v in settings.items()})))

    def outsider(self, *words: str) -> Running:
        """Start a program of another user of this machine, who can read its own file alone; see `tests.outsider`."""
        place = Path(tempfile.mkdtemp(prefix="robo-outsider-"))
        self._stack.callback(shutil.rmtree, place)
        place.chmod(0o755)
        file = shutil.copy(Path(__file__).with_name("outsider.py"), place)
        running = Running([*AS_NOBODY, sys.executable, str(file), *words], cwd=str(place), env=dict(os.environ))
        self._stack.callback(running.close)
        return running

    def keep_open(self, session: zenoh.Session) -> zenoh.Session:
        """Close a session with the site."""
        self._stack.callback(session.close)
        return session

    def close(self) -> None:
        """End all of it."""
        self._stack.close()


@functools.cache
def no_other_user() -> str:
    """Why another user cannot be played here; empty where he can."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        return "another user is played by root, with setpriv"
    tried = [*AS_NOBODY, sys.executable, "-c", "import zenoh"]
    done = subprocess.run(tried, capture_output=True, text=True, check=False)
    return f"another user cannot run this Python: {done.stderr.strip()[-200:]}" if done.returncode else ""


def plain_config(settings: Mapping[str, object]) -> zenoh.Config:
    """Zenoh's settings by their paths."""
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def everything_of(pid: int) -> str:
    """What the system tells of a process: command line and environment."""
    found = ""
    for name in ("cmdline", "environ"):
        found += Path(f"/proc/{pid}/{name}").read_bytes().decode(errors="replace")
    return found + os.linesep
