"""When a process that has ended is started again: delays that grow, and storms that are slowed down."""

import random
from collections import deque
from collections.abc import Callable

from robo.launch.plan import RestartPlan
from robo.wire.reports import State


class Restarts:
    """The restarts of one process by its policy. Times are of any clock that does not step back, s."""

    def __init__(self, plan: RestartPlan, chance: Callable[[], float] = random.random) -> None:
        """`chance` gives numbers from 0 to 1."""
        self.plan = plan
        self.count = 0
        """Restarts so far."""
        self.storm = False
        """Whether there were more within the window than the policy allows, and no healthy time since."""
        self._chance = chance
        self._in_a_row = 0
        self._recent: deque[float] = deque()

    def after_end(self, now: float, *, failed: bool) -> float | None:
        """The process has ended by itself: in how many seconds it is to be started again; None for never.

        The n-th delay in a row is `delay * backoff ** n`, at most `max_delay`, less up to `jitter` of it.
        """
        plan = self.plan
        if plan.policy == "never" or (plan.policy == "on-failure" and not failed):
            return None
        while self._recent and now - self._recent[0] > plan.window:
            self._recent.popleft()
        self._recent.append(now)
        self.storm = self.storm or len(self._recent) > plan.max
        longest = max(plan.delay, plan.max_delay)
        try:
            delay = longest if self.storm else min(plan.delay * plan.backoff**self._in_a_row, longest)
        except OverflowError:
            delay = longest
        self._in_a_row += 1
        self.count += 1
        return delay * (1 - plan.jitter * self._chance())

    def in_words(self, delay: float) -> tuple[State, str]:
        """How a process that has ended is shown until its next start, and the end of the reason for it."""
        plan = self.plan
        if self.storm:
            return "degraded", f", more than {plan.max} times in {plan.window:g} s; next try in {delay:.1f} s"
        return "restarting", f"; starting it again in {delay:.2g} s"

    def healthy(self) -> None:
        """The process has been ready for long enough: what was is forgotten."""
        self._in_a_row = 0
        self._recent.clear()
        self.storm = False
