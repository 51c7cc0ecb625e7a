"""One process of a plan, and what has become of it."""

import asyncio
import os
import re
import time
from collections import deque
from collections.abc import Callable
from functools import partial

import psutil

from robo.launch.manifest import Until
from robo.launch.plan import ProcessPlan
from robo.supervisor.process import Child

CANNOT_START = 127
"""The exit code of a process that could not even be started, as shells have it."""


class Member:
    """A process of the plan: its child, which a restart replaces, and how far it has come."""

    def __init__(self, plan: ProcessPlan, label: str, show: Callable[[str, str], None]) -> None:
        """
        Args:
            plan: the process.
            label: what it is called in the output.
            show: takes the label and each line of output.
        """
        self.plan = plan
        self.label = label
        self.child: Child | None = None
        self.ended: asyncio.Task[int] | None = None
        self.exit_code: int | None = None
        """Of the last child, once it has ended."""
        self.ready = False
        self.asked_to_stop = False
        self.restarting = False
        """Whether it has ended and will be started again."""
        self.on_ready: Callable[[], None] = lambda: None
        self._restarts: deque[float] = deque()
        self._show = partial(show, label)
        self._pattern = re.compile(plan.ready.pattern or "") if plan.ready.when == "log" else None

    @property
    def waiting(self) -> bool:
        """Whether it has never been started."""
        return self.child is None

    @property
    def running(self) -> bool:
        """Whether a child of it runs."""
        return self.child is not None and self.child.running

    @property
    def failed(self) -> bool:
        """Whether it ended by itself and badly."""
        return not self.running and self.exit_code not in (None, 0) and not self.asked_to_stop

    def reached(self, until: Until) -> bool:
        """Whether it has come as far as another process needs it."""
        if until == "started":
            return self.child is not None
        if until == "completed":
            return not self.running and self.exit_code == 0 and not self.restarting
        return self.ready

    def may_reach(self, until: Until) -> bool:
        """Whether a started process can still come so far."""
        return self.reached(until) or self.running or self.restarting

    async def start(self, environment: dict[str, str]) -> str | None:
        """Start a child.

        Returns:
            Why it could not be started.
        """
        self.child = Child(self.label, self._on_line)
        self.ready = self.restarting = False
        self.exit_code = None
        try:
            await self.child.start(self.plan.command, environment, cwd=self.plan.cwd)
        except OSError as error:
            self.ended = asyncio.create_task(_at_once(CANNOT_START))
            place = f" in {self.plan.cwd}" if self.plan.cwd else ""
            return f"{self.label} cannot be started{place}: {error.strerror}: {error.filename or self.plan.command[0]}"
        problem = self._settle(self.child.pid)
        self.ended = asyncio.create_task(self.child.wait())
        if self.plan.ready.when == "started":
            self._become_ready()
        return problem

    def _settle(self, pid: int | None) -> str | None:
        """Give the new process its priority and its processors, before it has a second thread."""
        if self.plan.priority is None and not self.plan.cpus:
            return None
        try:
            process = psutil.Process(pid)
            if self.plan.priority is not None:
                process.nice(self.plan.priority)
            if self.plan.cpus:
                process.cpu_affinity(list(self.plan.cpus))
        except psutil.NoSuchProcess:
            return None  # it has ended already
        except (psutil.Error, OSError, ValueError, AttributeError) as error:
            # macOS has no affinity, and a lower nice value needs rights that most users lack.
            wish = f"priority {self.plan.priority}" if self.plan.priority is not None else ""
            wish += f" cpus {list(self.plan.cpus)}" if self.plan.cpus else ""
            return f"{self.label} runs without {wish.strip()}: {error}"
        return None

    def owns(self, pid: int) -> bool:
        """Whether a process is the child, or was started by it: a debugger or a script in between."""
        if self.child is None or self.child.pid is None:
            return False
        if pid == self.child.pid:
            return True
        try:
            return os.getpgid(pid) == self.child.pid or any(
                p.pid == self.child.pid for p in psutil.Process(pid).parents()
            )
        except (psutil.Error, ProcessLookupError):
            return False

    def notice_token(self) -> None:
        """The node's liveliness token shows."""
        if self.plan.ready.when == "node":
            self._become_ready()

    def wants_restart(self) -> bool:
        """Whether the policy starts it again after its end; counts the restart."""
        policy = self.plan.restart
        if self.asked_to_stop or policy.policy == "never" or (policy.policy == "on-failure" and self.exit_code == 0):
            return False
        now = time.monotonic()
        while self._restarts and now - self._restarts[0] > policy.window:
            self._restarts.popleft()
        if len(self._restarts) >= policy.max:
            return False
        self._restarts.append(now)
        return True

    @property
    def restarts(self) -> int:
        """How often it has been restarted within the window."""
        return len(self._restarts)

    def _become_ready(self) -> None:
        if not self.ready:
            self.ready = True
            self.on_ready()

    def _on_line(self, text: str) -> None:
        self._show(text)
        if self._pattern is not None and not self.ready and self._pattern.search(text):
            self._become_ready()


async def _at_once(code: int) -> int:
    return code
