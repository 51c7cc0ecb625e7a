"""What a node tells once a second of how well it does: its own checks, and those that every node has.

The report has a turn of its own, so that a callback that does not return is named in it, and holds back nothing but
the node's own checks, which take the node's turn.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence, Set
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

import msgspec

from robo.errors import ContractError
from robo.node.clock import Clock
from robo.node.diagnosis import ERROR, PERIOD, STALE, Diagnosis, Look, Promises, named
from robo.node.endpoints import Endpoints
from robo.node.loops import TimerLoop
from robo.node.part import found_in
from robo.node.troubles import Troubles
from robo.node.turn import Turn
from robo.node.turns import Turns
from robo.wire.reports import NodeStatus
from robo_messages import DiagnosticArray, DiagnosticStatus, Header

if TYPE_CHECKING:
    from robo.node.contract import Contract
    from robo.node.health import Health

OVERDUE = 3 * PERIOD
"""A check that has not been asked for so long is stale, s."""


_ASKING, _TELLING = "checks", "diagnostics"
THREADS = (f"robo-timer-{_ASKING}", f"robo-timer-{_TELLING}")
"""What the threads are called in which this happens."""


class Reporting(Protocol):
    """What diagnostics need of their node."""

    contract: Contract
    full_name: str
    clock: Clock

    @property
    def status(self) -> NodeStatus:
        """Its counters."""


class _Answer(msgspec.Struct, frozen=True):
    """What a check has said."""

    status: DiagnosticStatus
    at: float
    """When, by the wall's monotonic clock, s."""


class Diagnostics:
    """Asks the checks of one node, and reports, for as long as the node is on the network."""

    def __init__(self, node: Reporting, ends: Endpoints, turns: Turns, troubles: Troubles) -> None:
        """The arguments are the node's."""
        self._node = node
        self._ends = ends
        self._turns = turns
        self._troubles = troubles
        self._loops: list[TimerLoop] = []
        self._checks: list[tuple[str, Callable[[], Health]]] = []
        self._answers: dict[str, _Answer] = {}
        self._held_until = 0.0
        """When reports come although the checks have not been asked yet, by the wall's monotonic clock, s."""
        self._diagnosis: Diagnosis | None = None
        self._wall = node.clock.wall
        self.publish: Callable[[DiagnosticArray], None] = lambda _: None
        """Where reports go."""
        self.apart: Set[str] = frozenset()
        """Topics that every node publishes, of which a report says nothing."""
        self.last: Sequence[DiagnosticStatus] = ()
        """The last report; empty before the first."""

    def begin(self) -> None:
        """Report from now on; the first report comes after a period, and not before what checks say is known."""
        node = self._node
        self._wall = wall = node.clock.wall
        self._checks = [(one.name, found_in(node, one.method)) for one in node.contract.checks]
        self._held_until = wall.monotonic() + OVERDUE if self._checks else 0.0
        self._diagnosis = Diagnosis(self._look())
        if self._checks:  # before the report, which of two that are due at once is to tell what they say
            self._loop(_ASKING, self._turns.own, self._ask, wall)
        self._loop(_TELLING, Turn(self._turns.own.on_death), self._report, wall)
        self._ends.add_other(self)

    def stop(self, timeout: float) -> bool:
        """Report no more. Returns whether checks came back within `timeout` seconds."""
        end = time.monotonic() + timeout
        returned = [loop.stop(max(0.0, end - time.monotonic())) for loop in self._loops]
        return all(returned)

    def _loop(self, name: str, turn: Turn, work: Callable[[], None], wall: Clock) -> None:
        loop = TimerLoop(name, lambda: PERIOD, turn, work, self._troubles.handler(work), wall)
        self._loops.append(loop)
        loop.start()

    def _ask(self) -> None:
        """Ask each check."""
        node = self._node
        if node.contract.managed and node.status.lifecycle != "active":
            self._answers = {}
        else:
            for name, check in self._checks:
                self._turns.own.running = name
                status = named(node.full_name, name, self._said_by(name, check))
                self._answers[name] = _Answer(status, self._wall.monotonic())
        self._held_until = 0.0

    def _said_by(self, name: str, check: Callable[[], Health]) -> DiagnosticStatus:
        """What a check says; one that raises is an error of its own, and hides no other."""
        from robo.node.health import Health  # which nodes without checks do without

        try:
            health = check()
            if not isinstance(health, Health):
                raise TypeError(f"the check {name!r} returned {type(health).__name__}, not a robo.Health")
            return health.status()
        except BaseException as error:
            self._troubles.handler(check)(error)
            return DiagnosticStatus(ERROR, message=f"raised {type(error).__name__}{_words_of(error)}")

    def _report(self) -> None:
        assert self._diagnosis is not None
        now = self._wall.monotonic()
        if now < self._held_until:
            return  # without what the checks say it would tell that all is well
        own = self._diagnosis.of(self._look(), self._promises())
        full_name = self._node.full_name
        found = [named(full_name, one.name, one) for one in own]
        found += [_aged(answer, now) for answer in list(self._answers.values())]
        self.last = found
        self.publish(DiagnosticArray(Header(self._wall.now()), found))

    def _look(self) -> Look:
        clock, longest, longest_of = self._node.clock, 0.0, ""
        for turn in (self._turns.own, *self._turns.others.values()):
            if turn.longest > longest:
                longest, longest_of = turn.longest, turn.longest_of
            turn.longest = 0.0
        jumps = clock.jumps
        return Look(self._wall.monotonic(), clock.monotonic(), jumps, self._node.status, longest, longest_of)

    def _promises(self) -> Promises:
        publishers, subscriptions = list(self._ends.publishers), list(self._ends.subscriptions)
        return Promises(
            {p.topic: p.qos.deadline for p in publishers if p.qos.deadline is not None},
            {s.topic: s.qos.deadline for s in subscriptions if s.qos.deadline is not None},
            {s.topic for s in subscriptions if s.qos.depth == 1},
            self.apart,
            self._ticks(),
        )

    def _ticks(self) -> dict[str, float]:
        ticks: dict[str, float] = {}
        for timer in list(self._ends.timers):
            with suppress(ContractError):  # it has ended, and said why
                ticks[timer.name] = ticks.get(timer.name, 0.0) + 1.0 / timer.period()
        return ticks


def _words_of(error: BaseException) -> str:
    """What an exception says; one that cannot even say it says nothing."""
    with suppress(Exception):
        return f": {error}"
    return ""


def _aged(answer: _Answer, now: float) -> DiagnosticStatus:
    """What a check has said; that it is stale where it could not be asked for a while."""
    age = now - answer.at
    if age <= OVERDUE:
        return answer.status
    said = answer.status.message
    return msgspec.structs.replace(
        answer.status, level=STALE, message=f"not asked for {age:.1f} s{f', before that: {said}' if said else ''}"
    )
