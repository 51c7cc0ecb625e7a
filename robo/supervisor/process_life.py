"""How far one process has come, as a state machine. It has no process, no clock and no loop of its own.

Each event is a method: it says what it means in which phase; in the others it is ignored, or `Impossible`. All
changes go through `_transition`, which replaces the deadline too: at most one time limit runs, and none is stale.

| phase | child | until |
|---|---|---|
| waiting | | what it needs is there: spawning |
| spawning | on its way | it is there: starting; it cannot be started: as if it had ended |
| starting | runs | all that tells of readiness has come: ready; it takes too long: failing; or as for ready |
| ready | runs | it hangs: failing; it ends: its policy decides; a managed node is not active: standing by |
| standby | runs | a managed node is active: ready; it hangs: failing; it ends: its policy decides |
| failing | is being ended | it has ended: its policy decides |
| restarting | is being ended, or on its way | it has ended: waiting |
| stopping | is being ended, or on its way | it has ended: stopped |
| backing off | | the delay is over: waiting |
| stopped, failed, completed | | a command starts it: waiting |

A command to stop leads to stopping where there is a child, else to stopped; one to restart leads to restarting, else
to waiting. What has failed or completed is still shown so after a command to stop; it is only not wanted any more.
"""

import math
from collections.abc import Callable, Sequence
from enum import Enum, auto
from signal import Signals
from typing import NamedTuple, Protocol

from robo.launch.plan import ProcessPlan, StopPlan
from robo.supervisor.restart import Restarts
from robo.wire.reports import State

CANNOT_START = 127
"""The exit code of a process that could not even be started, as shells have it."""

STARTING_AGAIN = "starting again as asked"
"""Why a process is ended that somebody wants to run anew."""


class Phase(Enum):
    """How far a process has come."""

    WAITING = auto()
    SPAWNING = auto()
    STARTING = auto()
    READY = auto()
    STANDBY = auto()
    FAILING = auto()
    RESTARTING = auto()
    STOPPING = auto()
    BACKING_OFF = auto()
    STOPPED = auto()
    FAILED = auto()
    COMPLETED = auto()


UP = frozenset({Phase.STARTING, Phase.READY, Phase.STANDBY})
"""Where a child runs that nobody has told to end."""

FINISHED = frozenset({Phase.STOPPED, Phase.FAILED, Phase.COMPLETED})
"""Where nothing but a command starts it again."""


class Wish(Enum):
    """What was last asked."""

    RUN = auto()
    STOP = auto()
    """Not to run, until a command asks otherwise."""
    END = auto()
    """The run ends: nothing is started any more. What runs goes on until it is told to stop."""


class Impossible(RuntimeError):
    """An event that cannot come in this phase: whoever owns the process has made a mistake."""

    def __init__(self, event: str, phase: Phase) -> None:
        super().__init__(f"{event}, while {phase.name.lower()}")


class Notice(NamedTuple):
    """A signal to a child that is to end."""

    number: Signals
    patience: float
    """How long it is given until the next one, s."""


ASK_WHERE = (Notice(Signals.SIGABRT, 1.0), Notice(Signals.SIGKILL, math.inf))
"""For a child that hangs: a Python process writes the stacks of all its threads to stderr and ends."""


class Body(Protocol):
    """What a life acts on: the process, and those who look at it."""

    def send(self, number: Signals) -> None:
        """Send a signal to the process."""

    def lacks(self) -> str:
        """What its readiness still waits for, in words."""

    def moved(self) -> None:
        """It is in another phase, or has another deadline."""

    def changed(self, before: State) -> None:
        """It has come to another state, or to another reason for it."""


class ProcessLife:
    """The life of one process, over all its starts."""

    def __init__(self, plan: ProcessPlan, restarts: Restarts, clock: Callable[[], float], body: Body) -> None:
        """
        Args:
            plan: its policies and limits; another one may be set, and holds from then on.
            restarts: its delays.
            clock: the time, s; it never steps back.
            body: what it acts on.
        """
        self.plan = plan
        self.restarts = restarts
        self.phase = Phase.WAITING
        self.wish = Wish.RUN
        self.state: State = "starting"
        """How it is shown, with a reason."""
        self.reason = ""
        self.deadline: float | None = None
        """When `elapsed` is to be called."""
        self.starts = 0
        """How many starts there were, successful or not."""
        self.started_at = self.ready_at = 0.0
        """When the present child was started and became ready."""
        self.blame = ""
        """Why the present child could not be started, or had to be ended: for its exit."""
        self._clock = clock
        self._body = body
        self._signals: list[Notice] = []
        """What is still to be sent to a child that is to end."""

    @property
    def wanted(self) -> bool:
        """Whether it is to run."""
        return self.wish is Wish.RUN

    @property
    def finished(self) -> bool:
        """Whether it has ended and nothing starts it again but a command."""
        return self.phase in FINISHED

    @property
    def down(self) -> bool:
        """Whether it has failed for good, or is in a storm and tried slowly."""
        return self.phase is Phase.FAILED or (self.phase is Phase.BACKING_OFF and self.restarts.storm)

    @property
    def unasked(self) -> bool:
        """Whether nobody here has asked the child to end."""
        return self.wanted and self.phase in UP

    def needs_are(self, unmet: Sequence[str]) -> None:
        """What it needs has changed; `unmet` is what it still waits for, in words."""
        if self.phase is not Phase.WAITING or not self.wanted:
            return
        if unmet:
            self._show("starting", f"waits for {', '.join(unmet)}")
        else:
            self.started_at = self._clock()
            self.blame = ""
            self._transition(Phase.SPAWNING, "starting", "")

    def spawned(self) -> None:
        """The child runs."""
        match self.phase:
            case Phase.SPAWNING:
                self.starts += 1
                limit = self.plan.ready.timeout
                self._transition(Phase.STARTING, "starting", "", self._clock() + limit if limit else None)
            case Phase.STOPPING | Phase.RESTARTING:  # asked for while it was on its way
                self._end(self.phase, self.state, self.reason, _in_turn(self.plan.stop))
            case _:
                raise Impossible("spawned", self.phase)

    def could_not_start(self, why: str) -> None:
        """There is no child: the program is not there, for example."""
        self.blame = why
        match self.phase:
            case Phase.SPAWNING:
                self.starts += 1
                self._settle(CANNOT_START, why)
            case Phase.STOPPING | Phase.RESTARTING:
                self._end_as_asked()
            case _:
                raise Impossible("could_not_start", self.phase)

    def became_ready(self) -> None:
        """All that tells of readiness has come."""
        if self.phase not in (Phase.STARTING, Phase.STANDBY):
            return  # too late: the child is being ended
        self.ready_at = self._clock()
        why = f"back, but not yet for {self.plan.restart.reset_after:g} s" if self.restarts.storm else ""
        self._transition(Phase.READY, "degraded" if why else "ready", why)

    def stands_by(self, state: str) -> None:
        """A managed node is in a state that is not active, as somebody wants it: that may last, and is no failure."""
        if self.phase in (Phase.STARTING, Phase.READY):
            self._transition(Phase.STANDBY, "standby", state)
        elif self.phase is Phase.STANDBY:  # one that ends goes through its states on the way
            self._show("standby", state)

    def checked(self, problem: str | None, hang: str | None = None) -> None:
        """It gives signs of life.

        Args:
            problem: which promise it does not keep.
            hang: why that means that it hangs.
        """
        if self.phase is not Phase.READY:
            return
        if self._clock() - self.ready_at >= self.plan.restart.reset_after:
            self.restarts.healthy()
        elif self.restarts.storm:
            return  # back, but not yet for long enough
        self._show("ready" if problem is None else "degraded", problem or "")
        if hang is not None:
            self.hung(hang)

    def hung(self, why: str) -> None:
        """It does not do its work. Where its policy would not start it again, it is left alone, and shown."""
        if self.phase not in (Phase.READY, Phase.STANDBY):
            return
        if self.plan.restart.policy == "never" and not self.plan.required:
            self._show("degraded", why)
        else:
            self._fail(why, ASK_WHERE)

    def elapsed(self) -> None:
        """The deadline is over."""
        if self.deadline is None:
            raise Impossible("elapsed", self.phase)
        match self.phase:
            case Phase.STARTING:
                why = f"not ready within {self.plan.ready.timeout:g} s: {self._body.lacks()}"
                self._fail(why, _in_turn(self.plan.stop))
            case Phase.BACKING_OFF:
                self._transition(Phase.WAITING, self.state, self.reason)
            case _:
                self._end(self.phase, self.state, self.reason, self._signals)

    def exited(self, code: int, words: str) -> None:
        """The child has ended: by its exit code, negative for a signal, and the same in words."""
        match self.phase:
            case Phase.STARTING | Phase.READY | Phase.STANDBY | Phase.FAILING:
                self._settle(code, self.blame or (f"was {words}" if code < 0 else f"ended with {words}"))
            case Phase.STOPPING | Phase.RESTARTING:
                self._end_as_asked()
            case _:
                raise Impossible("exited", self.phase)

    def start_asked(self) -> None:
        """It is to run."""
        if self.wish is Wish.END:
            return
        self.wish = Wish.RUN
        match self.phase:
            case Phase.STOPPED | Phase.FAILED | Phase.COMPLETED | Phase.BACKING_OFF:
                self._transition(Phase.WAITING, self.state, self.reason)
            case Phase.STOPPING:
                self._transition(Phase.RESTARTING, "restarting", STARTING_AGAIN, self.deadline)
            case _:
                pass  # it does, or will

    def restart_asked(self, why: str) -> None:
        """It is to run anew: a child that runs is ended first."""
        if self.wish is Wish.END:
            return
        if self.wanted and (self.phase in UP or self.phase is Phase.FAILING):
            self.restarts.count += 1
        self.wish = Wish.RUN
        match self.phase:
            case Phase.STOPPED | Phase.FAILED | Phase.COMPLETED | Phase.BACKING_OFF:
                self._transition(Phase.WAITING, self.state, self.reason)
            case Phase.SPAWNING | Phase.STOPPING | Phase.FAILING:
                self._transition(Phase.RESTARTING, "restarting", why, self.deadline)
            case Phase.STARTING | Phase.READY | Phase.STANDBY:
                self._end(Phase.RESTARTING, "restarting", why, _in_turn(self.plan.stop))
            case _:
                pass  # a new child is what comes next anyway

    def stop_asked(self) -> None:
        """It is not to run: a child that runs is ended."""
        if self.wish is Wish.RUN:
            self.wish = Wish.STOP
        match self.phase:
            case Phase.WAITING | Phase.BACKING_OFF:
                self._end_as_asked()
            case Phase.SPAWNING | Phase.RESTARTING | Phase.FAILING:
                self._transition(Phase.STOPPING, "stopping", "", self.deadline)
            case Phase.STARTING | Phase.READY | Phase.STANDBY:
                self._end(Phase.STOPPING, "stopping", "", _in_turn(self.plan.stop))
            case _:
                pass  # it does not, or will not

    def run_ends(self) -> None:
        """Nothing is started any more. What runs goes on until it is told to stop."""
        self.wish = Wish.END
        match self.phase:
            case Phase.BACKING_OFF:
                self._end_as_asked()
            case Phase.RESTARTING:
                self._transition(Phase.STOPPING, "stopping", "", self.deadline)
            case _:
                pass  # what waits was never started, and is shown so

    def _fail(self, why: str, signals: Sequence[Notice]) -> None:
        """End a child that does not do its work, so that its policy takes over."""
        self.blame = why
        self._end(Phase.FAILING, "degraded", why, signals)

    def _end(self, phase: Phase, state: State, reason: str, signals: Sequence[Notice]) -> None:
        """Send the first of some signals to the child, and the others as long as it does not end."""
        (number, patience), *self._signals = signals
        self._transition(phase, state, reason, self._clock() + patience if self._signals else None)
        self._body.send(number)
        self._body.send(Signals.SIGCONT)  # one that is stopped could not obey

    def _settle(self, code: int, why: str) -> None:
        """It has ended by itself, or because it did not do its work: its policy decides."""
        if not self.wanted:
            self._end_as_asked()
            return
        now, failed = self._clock(), code != 0 or self.phase is Phase.FAILING
        delay = self.restarts.after_end(now, failed=failed)
        if delay is not None:
            state, reason = self.restarts.in_words(delay)
            self._transition(Phase.BACKING_OFF, state, f"{why}{reason}", now + delay)
        elif failed:
            self._transition(Phase.FAILED, "failed", why)
        else:
            self._transition(Phase.COMPLETED, "completed", why)

    def _end_as_asked(self) -> None:
        if self.wanted:
            self._transition(Phase.WAITING, self.state, self.reason)
        else:
            self._transition(Phase.STOPPED, "stopped", "as asked")

    def _transition(self, phase: Phase, state: State, reason: str, deadline: float | None = None) -> None:
        """Every change of phase, and of the deadline."""
        self.phase, self.deadline = phase, deadline
        self._body.moved()
        self._show(state, reason)

    def _show(self, state: State, reason: str) -> None:
        if (state, reason) != (self.state, self.reason):
            before = self.state
            self.state, self.reason = state, reason
            self._body.changed(before)


def _in_turn(stop: StopPlan) -> list[Notice]:
    """What a child is told that is to end."""
    patience = stop.timeout
    return [
        Notice(Signals[f"SIG{stop.signal}"], patience),
        Notice(Signals.SIGTERM, patience / 2),
        Notice(Signals.SIGKILL, math.inf),
    ]
