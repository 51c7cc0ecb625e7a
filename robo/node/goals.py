"""The goals of one action server: which it takes, in what order, how far each has come, and what became of it.

It knows no network, no thread and no handler. Any thread may call any method.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable

from robo.node.actions import Policy
from robo.wire.goals import GoalEvent, GoalState, after, id_text
from robo_messages import Message
from robo_messages.action import UUID, CancelGoal, GoalInfo, GoalStatus, GoalStatusArray
from robo_messages.std import Time

RESULT_TIMEOUT = 60.0
"""For how long a result is kept, s."""

MOST_KEPT = 1_000
"""Goals that have ended and are kept; of more the oldest are forgotten sooner."""

MOST_QUEUED = 100
"""Goals that may wait for their turn; more are refused."""

MOST_WAITING = 1_000
"""Clients that may wait for results of goals under way; more are refused."""

SHOWN = 10
"""Goals that have ended and are still told of."""

_NO_ID, _NO_TIME = bytes(16), Time()


class Refused(Exception):
    """A goal is not taken; the text says why."""


class Goal:
    """One goal, from the moment in which it was taken."""

    def __init__(self, info: GoalInfo, request: Message) -> None:
        self.info = info
        self.request = request
        self.state = GoalState.ACCEPTED
        self.result: Message | None = None
        """What its handler came to; None before the end, and where there is none."""
        self.message = ""
        """Why it was aborted."""
        self.interruption: str | None = None
        """Why its handler is to stop: empty for a client that asked to cancel it; None while it may go on."""
        self.told = False
        """Whether its handler has been told to stop."""
        self.ended_at = 0.0
        self.waiting: list[Callable[[Goal], None]] = []
        """Who is told of its end."""

    @property
    def id(self) -> bytes:
        """What it is known by."""
        return self.info.goal_id.uuid

    @property
    def is_to_be_told(self) -> bool:
        """Whether its handler is to stop and does not know it."""
        return self.interruption is not None and not self.told


class Goals:
    """All goals of one action: those under way and, for a time, those that have ended."""

    def __init__(self, policy: Policy, *, cancelable: bool, now: Callable[[], float]) -> None:
        """
        Args:
            policy: what becomes of a goal that comes while another one is under way.
            cancelable: whether the handler can be told to stop in the middle.
            now: the time, s.
        """
        self._policy = policy
        self._cancelable = cancelable
        self._now = now
        self._lock = threading.RLock()
        self._goals: dict[bytes, Goal] = {}
        """All that are known, in the order in which they were taken."""
        self._queue: deque[Goal] = deque()
        self._running: Goal | None = None
        self._ended: deque[Goal] = deque()
        self._waiters = 0
        self._closed: str | None = None
        self.taken = 0
        """Goals taken so far."""

    # -- what clients ask --------------------------------------------------------------------------------------------

    def check(self, goal_id: bytes) -> None:
        """Look whether a goal would be taken.

        Raises:
            Refused: it would not.
        """
        with self._lock:
            if self._closed is not None:
                raise Refused(self._closed)
            if goal_id == _NO_ID:
                raise Refused("its id is nothing but zeros; choose a random one")
            if goal_id in self._goals:
                raise Refused(f"there is a goal {id_text(goal_id)} already; each has an id of its own")
            busy = self._running or (self._queue[0] if self._queue else None)
            if self._policy == "refuse" and busy is not None:
                raise Refused(f"goal {id_text(busy.id)} is under way, and this action takes one at a time")
            if len(self._queue) >= MOST_QUEUED:
                raise Refused(f"{MOST_QUEUED} goals wait already")

    def take(self, goal_id: bytes, request: Message, stamp: Time) -> tuple[Goal, list[Goal]]:
        """Take a goal.

        Returns:
            It, and those that have ended thereby.

        Raises:
            Refused: it is not taken.
        """
        with self._lock:
            self.check(goal_id)
            goal = Goal(GoalInfo(UUID(goal_id), stamp), request)
            ended: list[Goal] = []
            if self._policy == "preempt":
                reason = f"preempted by goal {id_text(goal_id)}"
                ended = self._abort_queued(reason)
                self._interrupt(self._running, reason)
            self._forget_old()
            self._goals[goal_id] = goal
            self._queue.append(goal)
            self.taken += 1
            return goal, ended

    def cancel(self, wanted: GoalInfo) -> tuple[CancelGoal.Response, list[Goal]]:
        """Cancel those that are meant, as ROS 2 reads it: by an id, by a stamp, by both, or all.

        Returns:
            The answer, and those that have ended thereby.
        """
        response = CancelGoal.Response
        with self._lock:
            meant = [goal for goal in self._goals.values() if _is_meant(goal, wanted)]
            alive = [goal for goal in meant if not goal.state.is_terminal]
            if not alive and wanted.goal_id.uuid != _NO_ID:
                return response(response.ERROR_GOAL_TERMINATED if meant else response.ERROR_UNKNOWN_GOAL_ID), []
            canceling = [goal for goal in alive if self._cancelable or goal is not self._running]
            ended = []
            for goal in canceling:
                if goal.state != GoalState.CANCELING:
                    goal.state = after(goal.state, GoalEvent.CANCEL_GOAL)
                if goal is self._running:
                    self._interrupt(goal, "")
                else:
                    self._queue.remove(goal)
                    self._end(goal, GoalEvent.CANCELED)
                    ended.append(goal)
            code = response.ERROR_REJECTED if alive and not canceling else response.ERROR_NONE
            return response(code, [goal.info for goal in canceling]), ended

    def find(self, goal_id: bytes) -> Goal | None:
        """The goal of an id; None for one that is not known, or no longer."""
        with self._lock:
            self._forget_old()
            return self._goals.get(goal_id)

    def wait_for(self, goal: Goal, tell: Callable[[Goal], None]) -> bool:
        """Have the end of a goal told, once. Returns whether it is still to come.

        Raises:
            Refused: too many wait already.
        """
        with self._lock:
            if goal.state.is_terminal:
                return False
            if self._waiters >= MOST_WAITING:
                raise Refused(f"{MOST_WAITING} clients wait for results already")
            self._waiters += 1
            goal.waiting.append(tell)
            return True

    def status(self) -> GoalStatusArray:
        """Those under way, and the last that have ended."""
        with self._lock:
            shown = {id(goal) for goal in list(self._ended)[-SHOWN:]}
            told = [goal for goal in self._goals.values() if not goal.state.is_terminal or id(goal) in shown]
            return GoalStatusArray([GoalStatus(goal.info, goal.state) for goal in told])

    # -- what the server does ----------------------------------------------------------------------------------------

    def next(self) -> Goal | None:
        """The goal whose turn it is, which now executes; None where none waits."""
        with self._lock:
            if not self._queue:
                return None
            goal = self._running = self._queue.popleft()
            goal.state = after(goal.state, GoalEvent.EXECUTE)
            return goal

    def interrupt(self, reason: str) -> None:
        """Have the handler of the goal under way stop, for a reason; empty for none."""
        if reason:
            with self._lock:
                self._interrupt(self._running, reason)

    def told(self, goal: Goal) -> str:
        """Note that its handler knows that it is to stop. Returns why."""
        with self._lock:
            goal.told = True
            return goal.interruption or ""

    def finish(self, goal: Goal, result: Message | None, failure: str | None = None) -> bool:
        """Note that the handler of a goal has come back.

        Args:
            goal: which.
            result: what it came to, if it came to anything.
            failure: what went wrong; None where nothing did.

        Returns:
            Whether the goal has ended with that; False where it had been given up before.
        """
        with self._lock:
            if goal.state.is_terminal:
                return False
            goal.result = result
            if failure is not None:
                self._end(goal, GoalEvent.ABORT, failure)
            elif goal.told and goal.interruption:
                self._end(goal, GoalEvent.ABORT, goal.interruption)
            else:
                self._end(goal, GoalEvent.CANCELED if goal.told else GoalEvent.SUCCEED)
            return True

    def close(self, reason: str) -> list[Goal]:
        """Take no more, abort those that wait, and have the handler of the one under way stop.

        Returns:
            Those that have ended thereby.
        """
        with self._lock:
            self._closed = reason
            self._interrupt(self._running, reason)
            return self._abort_queued(reason)

    def give_up(self, reason: str) -> Goal | None:
        """Abort the one under way, whatever its handler does. Returns it, if there was one."""
        with self._lock:
            goal = self._running
            if goal is None:
                return None
            self._end(goal, GoalEvent.ABORT, reason)
            return goal

    def take_waiting(self, ended: Iterable[Goal]) -> list[tuple[Goal, Callable[[Goal], None]]]:
        """Who is to be told of the end of some goals: each once."""
        with self._lock:
            found = [(goal, tell) for goal in ended for tell in goal.waiting]
            for goal, _ in found:
                goal.waiting = []
            self._waiters -= len(found)
            return found

    # -- with the lock -----------------------------------------------------------------------------------------------

    def _interrupt(self, goal: Goal | None, reason: str) -> None:
        if goal is not None and goal.interruption is None:
            goal.interruption = reason

    def _abort_queued(self, reason: str) -> list[Goal]:
        ended = list(self._queue)
        self._queue.clear()
        for goal in ended:
            goal.state = after(goal.state, GoalEvent.CANCEL_GOAL)
            self._end(goal, GoalEvent.ABORT, reason)
        return ended

    def _end(self, goal: Goal, event: GoalEvent, message: str = "") -> None:
        goal.state = after(goal.state, event)
        goal.message = message
        goal.ended_at = self._now()
        self._ended.append(goal)
        if goal is self._running:
            self._running = None

    def _forget_old(self) -> None:
        oldest = self._now() - RESULT_TIMEOUT
        while self._ended and (len(self._ended) > MOST_KEPT or self._ended[0].ended_at < oldest):
            del self._goals[self._ended.popleft().id]


def _is_meant(goal: Goal, wanted: GoalInfo) -> bool:
    if wanted.goal_id.uuid == goal.id:
        return True
    if wanted.stamp != _NO_TIME:
        return goal.info.stamp.to_nanoseconds() <= wanted.stamp.to_nanoseconds()
    return wanted.goal_id.uuid == _NO_ID
