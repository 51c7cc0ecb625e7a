"""Running the handler of an action for one goal after the other: at once, step by step, or on the loop."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from contextlib import suppress
from functools import partial
from typing import Any

import msgspec
import zenoh

from robo.node.actions import GoalCanceled, Policy
from robo.node.callables import AsyncRun
from robo.node.clock import Clock
from robo.node.goals import Goal, Goals
from robo.node.topics import Publish
from robo.node.turn import Turn, name_of, taking
from robo.wire.actions import ActionTypes
from robo_messages import Message
from robo_messages.action import UUID


class Handling(msgspec.Struct, frozen=True):
    """How the goals of an action are handled."""

    handler: Callable[[Any], Any]
    """Takes the goal and returns the result, or yields feedback before."""
    yields: bool
    """Whether it does."""
    tells: bool
    """Whether it takes beside the goal a function that tells feedback; an async one may."""
    period: Callable[[], float]
    """How long to wait from one step to the next, s."""
    policy: Policy
    accept: Callable[[Any], object] | None
    """Raises ValueError for a goal that is not to be taken."""
    why_not: Callable[[], str] = str
    """Says why no goals are handled just now; empty while they are."""
    begin: Callable[..., AsyncRun] | None = None
    """Begins to run the handler, if it is async."""


class Handler:
    """Runs the handler in the thread of its action, and has it stop from any other one."""

    def __init__(
        self,
        handling: Handling,
        types: ActionTypes,
        goals: Goals,
        turn: Turn,
        clock: Clock,
        woken: threading.Event,
        publish_feedback: Publish[Any],
    ) -> None:
        """
        Args:
            handling: what is done with goals.
            types: of the action.
            goals: of the action.
            turn: which each step takes.
            clock: by which it goes on.
            woken: set when a goal is to stop.
            publish_feedback: where progress is told.
        """
        self._handling = handling
        self._types = types
        self._goals = goals
        self._turn = turn
        self._clock = clock
        self._woken = woken
        self._feedback = publish_feedback
        self._name = name_of(handling.handler)
        self._given_up = False
        self._running: tuple[Goal, AsyncRun] | None = None
        """What an async handler is at."""

    def give_up(self) -> None:
        """Let a handler that has not come back in time take no further step."""
        self._given_up = True

    def interrupt(self) -> None:
        """Cancel an async handler that is to stop."""
        running = self._running
        if running is not None and running[0].is_to_be_told:
            self._goals.told(running[0])
            running[1].cancel()

    def handle(self, goal: Goal) -> object:
        """Run the handler to its end. Returns what it does, and raises what it does.

        Raises:
            GoalCanceled: it was to stop, and did.
        """
        with taking(self._turn, self._name):
            self._goals.interrupt(self._handling.why_not())
            if goal.is_to_be_told:
                raise GoalCanceled(self._goals.told(goal))
            if self._handling.begin is not None:
                return self._await(goal, self._handling.begin)
            outcome = self._handling.handler(goal.request)
        if not self._handling.yields:
            return outcome
        steps: Generator[Message | None, None, object] = outcome
        due = self._clock.monotonic()
        try:
            while (end := self._step(goal, steps)) is None:
                due = max(due + self._handling.period(), self._clock.monotonic())
                self._pause(goal, due)
            return end.value
        except BaseException:
            with taking(self._turn, self._name):  # what it has to put in order
                steps.close()
            raise

    def _step(self, goal: Goal, steps: Generator[Message | None, None, object]) -> StopIteration | None:
        """Let the handler go on to its next `yield`, and tell what it yields there. Returns its end, if it came."""
        if self._given_up:
            raise GoalCanceled
        with taking(self._turn, self._name):
            self._goals.interrupt(self._handling.why_not())
            try:
                told = goal.is_to_be_told
                feedback = steps.throw(GoalCanceled(self._goals.told(goal))) if told else next(steps)
            except StopIteration as end:
                return end
        if feedback is not None:
            self._tell(goal, "yielded", feedback)
        return None

    def _await(self, goal: Goal, begin: Callable[..., AsyncRun]) -> object:
        """Run an async handler to its end."""
        from asyncio import CancelledError  # which who has an async handler has loaded

        tell = [partial(self._tell, goal, "tells")] if self._handling.tells else []
        run = begin(goal.request, *tell)
        self._running = goal, run
        self.interrupt()  # where it was canceled just before
        try:
            return run.wait()
        except CancelledError:
            raise GoalCanceled from None
        finally:
            self._running = None

    def _tell(self, goal: Goal, verb: str, feedback: object) -> None:
        """Tell how far a goal has come."""
        if not isinstance(feedback, self._types.feedback):
            raise TypeError(f"the handler {verb} {type(feedback).__name__}, not {self._types.feedback.__name__}")
        if goal.state.is_terminal:  # whoever tells of it is late
            return
        with suppress(zenoh.ZError):  # the network has gone: who stops the node stops this
            self._feedback(self._types.feedback_message(UUID(goal.id), feedback))

    def _pause(self, goal: Goal, due: float) -> None:
        """Wait until a time, or until the handler is to stop."""
        while True:
            jumps = self._clock.jumps
            self._woken.clear()
            if goal.is_to_be_told or self._given_up:
                return
            if not self._clock.wait(self._woken, due, jumps) or jumps != self._clock.jumps:
                return
