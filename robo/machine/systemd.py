"""Asking systemd, by its own command."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from robo.errors import SystemdError

_BOOTED = Path("/run/systemd/system")
"""There where systemd runs the machine: see sd_booted(3)."""
_ANSWER = 90.0
"""How long it may take to do what it is asked to, s: as long as it itself waits for a service to stop by default."""
_SHOWN = (
    "LoadState",
    "UnitFileState",
    "ActiveState",
    "SubState",
    "Result",
    "StatusText",
    "NRestarts",
    "MainPID",
    "ActiveEnterTimestamp",
)


class Systemd:
    """The service manager of the machine, or a user's own."""

    def __init__(self, *, by_user: bool) -> None:
        """
        Raises:
            SystemdError: it does not run here.
        """
        program = shutil.which("systemctl")
        if program is None or not _BOOTED.is_dir():
            raise SystemdError(
                "systemd does not run this machine, so it starts nothing at boot; in a container, or on another "
                "system, have `robo up` run by what starts programs there (`robo export compose`, `kubernetes`)"
            )
        self._command = [program, *(["--user"] if by_user else [])]
        self.shown = " ".join(["systemctl", *self._command[1:]])
        """How people call it."""

    def reload(self) -> None:
        """Let it read its units again.

        Raises:
            SystemdError: it refuses, as for all that follows.
        """
        self._do("daemon-reload")

    def enable(self, unit: str) -> None:
        """Have it start a unit with the machine, or with its user's first session."""
        self._do("enable", unit)

    def disable(self, unit: str) -> None:
        """Have it stop a unit, and start it no more."""
        self._do("disable", "--now", unit)

    def state(self, unit: str) -> dict[str, str]:
        """What it knows of a unit, by its own words."""
        shown = self._do("show", unit, f"--property={','.join(_SHOWN)}")
        return {name: value for name, _, value in (line.partition("=") for line in shown.splitlines())}

    def _do(self, *words: str) -> str:
        try:
            done = subprocess.run(
                [*self._command, "--no-ask-password", *words],
                capture_output=True,
                text=True,
                timeout=_ANSWER,
                env={**os.environ, "LC_ALL": "C"},
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SystemdError(f"{self.shown} {' '.join(words)}: {error}") from None
        if done.returncode != 0:
            raise SystemdError(f"{self.shown} {words[0]} refuses: {_reason(done.stderr or done.stdout)}")
        return done.stdout


def _reason(said: str) -> str:
    lines: Sequence[str] = [line for line in said.splitlines() if line.strip()]
    text = "; ".join(lines) or "no reason is given"
    if "connect to bus" in text:
        text += " (log in as this user with a session of its own: `machinectl shell`, `ssh`; `sudo -u` makes none)"
    return text
