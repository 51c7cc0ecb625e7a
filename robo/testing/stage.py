"""Where nodes under test meet the loop of their async callbacks: it is one more thread that is stepped."""

from __future__ import annotations

import selectors
from contextlib import AbstractContextManager
from typing import Any

from robo.node import stage
from robo.testing.stepper import Call, Stepper


class Stage(stage.Stage):
    """The stage of one test, which has a loop of its own."""

    def __init__(self, stepper: Stepper) -> None:
        super().__init__()
        self._stepper = stepper

    def selector(self) -> selectors.BaseSelector:
        """One that parks the loop while it waits."""
        return _Selector(self._stepper)

    def posted(self) -> None:
        """Nobody else is let run before the loop has begun with it."""
        self._stepper.hand_to_loop()

    def taken(self) -> None:
        """The loop runs."""
        self._stepper.begin_in_loop()

    def question(self) -> Call | None:
        """A call with the loop in the place of a service."""
        call = self._stepper.call()
        if call is not None:
            call.open = 1
        return call

    def waiting(self, question: Any) -> AbstractContextManager[None]:
        """Others run meanwhile."""
        return self._stepper.asking(question)

    def answered(self, question: Any) -> None:
        """Who waits goes on before anything else happens."""
        self._stepper.answered(question)


class _Selector(selectors.DefaultSelector):
    """What the loop waits with."""

    def __init__(self, stepper: Stepper) -> None:
        super().__init__()
        self._stepper = stepper

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for files, or for what other threads hand over."""
        if timeout is not None and timeout <= 0:
            return super().select(timeout)
        with self._stepper.parked():
            return super().select(timeout)
