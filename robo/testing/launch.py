"""Starting robots for a test."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import zenoh

from robo.errors import NetworkError
from robo.testing.robot import Robot
from robo.testing.run import LaunchFailed, Run, words_of
from robo.wire.network import Network
from robo.wire.session import close_session, open_session

START_TIMEOUT = 30.0
"""The least that a robot may take until it is ready, s, unless the test says otherwise."""


class Launch:
    """What `launch` gives a test."""

    def __init__(self, folder: Callable[[], Path], workspace: Path, patience: float) -> None:
        """
        Args:
            folder: makes one for a run.
            workspace: where robots are started: relative manifests are looked for there, and in its `launch/`.
            patience: how long tests wait for them, s.
        """
        self.robots: list[Robot] = []
        """Those that it has started."""
        self._folder = folder
        self._workspace = workspace
        self._patience = patience
        self._made = ExitStack()

    def __call__(
        self,
        manifest: str | os.PathLike[str] = "robot.yaml",
        /,
        *groups: str,
        robot_name: str = "r1",
        folder: str | os.PathLike[str] | None = None,
        timeout: float | None = None,
        may_die: Sequence[str] = (),
        options: Sequence[str] = (),
        **arguments: object,
    ) -> Robot:
        """Start a robot and wait until all of it is ready. It ends with the test.

        Args:
            manifest: a path, or PACKAGE:FILE, as for `robo up`; relative to pytest's root folder.
            groups: start only these.
            robot_name: its name. Robots of different tests do not meet, whatever they are called.
            folder: where it is started, in the place of pytest's root folder: manifests and modules are found there.
            timeout: how long all of that may take, s; by default 30, or robo_patience where that is more.
            may_die: the nodes of which it is no fault if they end, or hang, or never get ready.
            options: further words for `robo up`: `["-p", "gripper.rate:=5.0"]`.
            arguments: of the manifest.

        Raises:
            LaunchFailed: it does not start; says what it printed, and which node is at fault.
        """
        words = [*groups, *words_of(arguments), *options]
        if timeout is None:
            timeout = max(START_TIMEOUT, self._patience)
        workspace = self._workspace if folder is None else Path(folder)
        run = Run(os.fspath(manifest), robot_name, words, self._folder(), workspace)
        with ExitStack() as made:
            made.callback(run.end)
            run.wait_until_reached(timeout)
            session = _join(run, timeout)
            made.callback(close_session, session)
            robot = Robot(run, session, may_die, self._patience)
            made.pop_all()
        self._made.callback(close_session, session)
        self._made.callback(robot.close)
        self.robots.append(robot)
        robot.wait_until_ready(timeout)
        return robot

    def close(self) -> None:
        """End all robots. Raises as `Robot.close`."""
        self._made.close()


def _join(run: Run, timeout: float) -> zenoh.Session:
    try:
        return open_session(Network(mode="client", connect=(run.endpoint,), timeout=timeout), plain=True)
    except NetworkError as error:
        raise LaunchFailed(f"{run.manifest}: {error}\n{run.printed()}") from None
