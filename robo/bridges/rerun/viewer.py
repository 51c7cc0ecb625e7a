"""Rerun's viewer as a process that ends with us, heard by this machine alone."""

import importlib.util
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

from robo.errors import NetworkError, RunError

LOOPBACK = "127.0.0.1"
_READY = 30.0
"""How long it may take to begin, s."""


class Viewer:
    """One that has been started. It ends with us, however we end: let the main thread start it, see `machine.leash`."""

    def __init__(self, port: int, memory: str, web_port: int | None) -> None:
        """
        Args:
            port: to which is sent what is to be seen.
            memory: what it may keep: `1GiB`; the oldest goes first.
            web_port: where its page is for a browser; None for a window.

        Raises:
            RunError: it is not there, or has ended at once.
            NetworkError: the port is taken.
        """
        self._check(port)
        words = [
            sys.executable,
            "-m",
            "robo.machine.leash",
            str(os.getpid()),
            str(_program()),
            "--bind",
            LOOPBACK,
            "--port",
            str(port),
            "--memory-limit",
            memory,
        ]
        words += ["--server-memory-limit", memory, "--expect-data-soon"]
        if web_port is not None:
            self._check(web_port)
            words += ["--serve-web", "--web-viewer-port", str(web_port)]
        self.address = f"http://{LOOPBACK}:{web_port}/?url=rerun%2Bhttp://{LOOPBACK}:{port}/proxy" if web_port else ""
        hint = "" if web_port is not None else ": is there a display? --web shows it in a browser"
        # In a group of its own: Ctrl-C is ours, and we end it when what was drawn is there.
        self._process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env={"RUST_LOG": "warn", **os.environ},  # it would tell of itself before we say where it is
            process_group=0,
        )
        try:
            self._wait(port, hint)
        except BaseException:
            self.close()
            raise

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed it."""
        return self._process.poll() is None

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _wait(self, port: int, hint: str) -> None:
        end = time.monotonic() + _READY
        while time.monotonic() < end:
            if not self.is_open:
                code = self._process.returncode
                raise RunError(f"Rerun's viewer ended with {code}{hint}")
            with socket.socket() as probe:
                if probe.connect_ex((LOOPBACK, port)) == 0:
                    return
            time.sleep(0.05)
        raise RunError(f"Rerun's viewer did not begin within {_READY:g} s")

    def _check(self, port: int) -> None:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, port))
            except OSError as error:
                text = f"port {port} of {LOOPBACK} cannot be had: {error.strerror}; --port and --web-port say others"
                raise NetworkError(text) from None


def has_display() -> bool:
    """Whether a window can be shown."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _program() -> Path:
    spec = importlib.util.find_spec("rerun_cli")
    folder = Path(spec.origin).parent if spec is not None and spec.origin else Path()
    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    for file in (folder / name, folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"):
        if file.is_file():
            return file
    raise RunError("Rerun's viewer is not installed: pip install 'robo-zenoh[rerun]'")
