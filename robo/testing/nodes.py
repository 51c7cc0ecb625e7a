"""The processes of a robot of a test: how they are, and what a test does to them."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

import zenoh

from robo.errors import NodeNotFound, RunError
from robo.testing.cut import Cut
from robo.testing.ending import state_of
from robo.testing.run import LaunchFailed, Run
from robo.text.suggestions import suggest
from robo.tools import runs
from robo.wire.reports import ProcessStatus

_LOOK = 0.05
"""How often a robot is asked how it is, s."""

_SEEN = 10.0
"""How long a supervisor may take to see that a process was killed, s."""

_FINE = ("ready", "standby", "completed", "stopped")
_DOWN = ("failed", "degraded")


class Nodes:
    """Asks for the processes of one run, and hurts them."""

    def __init__(self, run: Run, session: zenoh.Session, may_die: Sequence[str]) -> None:
        """
        Args:
            run: whose they are.
            session: on its network.
            may_die: those of which it is no fault if they are down.
        """
        self.run_id = ""
        """Of the run, once it has been ready."""
        self.namespace = ""
        """What all of them share of theirs, without outer slashes, once it is known."""
        self._run = run
        self._session = session
        self._may_die = frozenset(may_die)
        self._hurt: set[str] = set()
        """The full names of those that the test has killed, paused or cut off."""
        self._cuts: dict[str, Cut] = {}
        self._paused: dict[str, int] = {}

    def processes(self) -> list[ProcessStatus]:
        """All of them; raises RunError where the supervisor does not answer."""
        return runs.processes(self._session, self._run.robot)

    def process(self, node: str) -> ProcessStatus:
        """One of them; raises NodeNotFound where there is none."""
        there = self.processes()
        meant = [one for one in there if one.name.is_meant(node)]
        if len(meant) != 1:
            labels = (one.name.label for one in there)
            raise NodeNotFound(f"{self._run.robot} has no node {node}; {suggest(node, labels)}")
        return meant[0]

    def wait_until(self, node: str, condition: Callable[[ProcessStatus], bool], timeout: float) -> ProcessStatus:
        """Wait until something is true of one of them."""
        end = time.monotonic() + timeout
        while not condition(found := self.process(node)):
            if time.monotonic() > end:
                raise AssertionError(f"it is not so within {timeout:g} s: {state_of(found)}")
            time.sleep(_LOOK)
        return found

    def wait_until_ready(self, timeout: float) -> None:
        """Wait until all are ready; of those that may die, until they are down."""
        end = time.monotonic() + timeout
        while True:
            there = self._processes_so_far()
            if there and all(map(self._is_settled, there)):
                self.run_id, self.namespace = there[0].run, _shared_namespace(one.node for one in there)
                return
            broken = [one for one in there if self._is_broken(one)]
            unready = [one for one in there if not self._is_settled(one)]
            if broken:
                raise LaunchFailed(f"{self._run.manifest}: {'; '.join(map(state_of, broken))}")
            if self._run.is_over():
                raise LaunchFailed(f"{self._run.manifest}: the run has ended\n{self._run.printed()}")
            if time.monotonic() > end:
                what = "; ".join(map(state_of, unready)) or "its supervisor does not answer"
                raise LaunchFailed(f"{self._run.manifest}: not ready within {timeout:g} s: {what}")
            time.sleep(_LOOK)

    def is_expected(self, process: ProcessStatus) -> bool:
        """Whether it is the test's doing, or no fault, if it is down."""
        return process.node in self._hurt or self._may_be_down(process)

    # -- faults ------------------------------------------------------------------------------------------------------

    def kill(self, node: str) -> None:
        """End one as SIGKILL does, and wait until its supervisor has seen it."""
        pid = self._victim(node)
        os.kill(pid, signal.SIGKILL)
        end = time.monotonic() + _SEEN
        while any(one.pid == pid for one in self._processes_so_far()):
            if time.monotonic() > end:
                raise LaunchFailed(f"the supervisor has not seen within {_SEEN:g} s that {node} was killed")
            time.sleep(_LOOK)

    def pause(self, node: str) -> None:
        """Stop one where it is."""
        pid = self._victim(node)
        self._paused[node] = pid
        os.kill(pid, signal.SIGSTOP)

    def resume(self, node: str) -> None:
        """Let one that is paused go on."""
        with suppress(ProcessLookupError):  # its watchdog was quicker
            os.kill(self._paused.pop(node), signal.SIGCONT)

    def cut(self, node: str) -> None:
        """Cut one off the network; raises CannotCut where that is not possible."""
        self._cuts[node] = Cut(self._victim(node))

    def mend(self, node: str) -> None:
        """Let one that was cut off join the network again."""
        self._cuts.pop(node).mend()

    def undo(self) -> None:
        """Resume all that are paused, and mend all that are cut off."""
        for node in list(self._cuts):
            self.mend(node)
        for node in list(self._paused):
            self.resume(node)

    # -- themselves --------------------------------------------------------------------------------------------------

    def _victim(self, node: str) -> int:
        """The process id of one; what becomes of it now is the test's doing."""
        meant = self.process(node)
        if meant.pid is None:
            raise RunError(f"{node} does not run: {state_of(meant)}")
        self._hurt |= {one.node for one in self.processes() if one.pid == meant.pid}  # those that share its process
        return meant.pid

    def _processes_so_far(self) -> list[ProcessStatus]:
        try:
            return self.processes()
        except RunError:  # it is just coming, or going
            return []

    def _is_settled(self, process: ProcessStatus) -> bool:
        return process.state in _FINE or (process.state in _DOWN and self._may_be_down(process))

    def _is_broken(self, process: ProcessStatus) -> bool:
        if self._may_be_down(process):
            return False
        return process.state == "failed" or (process.state == "degraded" and process.node not in self._hurt)

    def _may_be_down(self, process: ProcessStatus) -> bool:
        return any(process.name.is_meant(name) for name in self._may_die)


def _shared_namespace(full_names: Iterable[str]) -> str:
    """The namespace that nodes have in common, without outer slashes; empty for the root."""
    return os.path.commonpath([name.rpartition("/")[0] or "/" for name in full_names]).strip("/")
