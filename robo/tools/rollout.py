"""One after another is started again, and the next one only when those before are healthy. Pure: no network, no clock.

Of each one a `Gate` knows how far it has come, and a `Rollout` whose turn it is. Each event is a method, which is told
the time, s, of any clock that does not step back; an event that means nothing in a stage is ignored there.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import msgspec

Stage = Literal["untouched", "restarting", "waiting", "settling", "done", "failed"]


class Terms(NamedTuple):
    """What is asked of each."""

    batch: int = 1
    """How many may be under way at the same time."""
    settle: float = 5.0
    """How long it has to be healthy, without a break, s."""
    timeout: float = 60.0
    """How long it may take until it is, from when it is told to start again, s."""


class Gate:
    """How far one has come.

    | stage | what is known | until |
    |---|---|---|
    | untouched | nothing was asked | its turn comes: restarting |
    | restarting | it is told to start again | that is done: waiting; it is refused, or takes too long: failed |
    | waiting | it is not healthy | it is: settling; it has failed for good, or time is up: failed |
    | settling | it is healthy since then | for long enough: done; it is not any more: waiting, or failed |
    | done, failed | it is decided | |

    What is healthy when its time is up may settle.
    """

    def __init__(self, terms: Terms) -> None:
        self.stage: Stage = "untouched"
        self.reason = ""
        """What it lacks, or why it has failed; empty where nothing is to be said."""
        self._terms = terms
        self._begun = self._healthy_since = 0.0

    def begin(self, now: float) -> None:
        """Its turn has come."""
        if self.stage == "untouched":
            self.stage, self._begun = "restarting", now

    def carried_out(self, now: float) -> None:
        """It was started again."""
        if self.stage == "restarting":
            self.stage, self.reason = "waiting", "nothing is known of it yet"
            self.elapsed(now)

    def refused(self, reason: str) -> None:
        """It was not started again."""
        if self.stage == "restarting":
            self._fail(reason)

    def healthy(self, now: float) -> None:
        """A look has shown that nothing is wrong with it."""
        if self.stage == "waiting":
            self.stage, self.reason, self._healthy_since = "settling", "", now
        self.elapsed(now)

    def ill(self, trouble: str, now: float) -> None:
        """A look has shown that something is wrong."""
        if self.stage in ("waiting", "settling"):
            self.stage, self.reason = "waiting", trouble
            self.elapsed(now)

    def lost(self, trouble: str) -> None:
        """A look has shown that it does not become healthy by itself any more."""
        if self.stage in ("waiting", "settling"):
            self._fail(trouble)

    def elapsed(self, now: float) -> None:
        """Time has passed."""
        late = now - self._begun >= self._terms.timeout
        if self.stage == "settling" and now - self._healthy_since >= self._terms.settle:
            self.stage = "done"
        elif self.stage == "restarting" and late:
            self._fail(f"it was not started again within {self._terms.timeout:g} s")
        elif self.stage == "waiting" and late:
            self._fail(f"it did not become healthy within {self._terms.timeout:g} s: {self.reason}")

    def _fail(self, reason: str) -> None:
        self.stage, self.reason = "failed", reason


class Account(msgspec.Struct, frozen=True):
    """What has become of each."""

    outcome: Literal["done", "stopped", "interrupted"]
    done: list[str]
    """Started again, and healthy."""
    failed: dict[str, str]
    """Started again, or told to, and not healthy: why."""
    under_way: list[str]
    """Started again, or told to, and not known to be healthy: something else came before."""
    untouched: list[str]
    """Left as they were."""


class Rollout:
    """Whose turn it is."""

    def __init__(self, names: Sequence[str], terms: Terms) -> None:
        """`names` is whom it is about, in their order."""
        self.gates = {name: Gate(terms) for name in names}
        self._batch = terms.batch

    @property
    def over(self) -> bool:
        """Whether all are done, or one has failed: then nothing is begun any more."""
        stages = [gate.stage for gate in self.gates.values()]
        return "failed" in stages or all(stage == "done" for stage in stages)

    def due(self, now: float) -> list[str]:
        """Whose turn has come: they are told to start again, now. Those of a batch begin when all before are done."""
        if self.over or self._in(("restarting", "waiting", "settling")):
            return []
        found = self._in(("untouched",))[: self._batch]
        for name in found:
            self.gates[name].begin(now)
        return found

    @property
    def looked_after(self) -> list[str]:
        """Who is to be looked at."""
        return self._in(("waiting", "settling"))

    def elapsed(self, now: float) -> None:
        """Time has passed."""
        for gate in self.gates.values():
            gate.elapsed(now)

    def account(self) -> Account:
        """What has become of each; where it is not over, somebody has interrupted it."""
        failed = {name: self.gates[name].reason for name in self._in(("failed",))}
        return Account(
            "stopped" if failed else "done" if self.over else "interrupted",
            self._in(("done",)),
            failed,
            self._in(("restarting", "waiting", "settling")),
            self._in(("untouched",)),
        )

    def _in(self, stages: Sequence[Stage]) -> list[str]:
        return [name for name, gate in self.gates.items() if gate.stage in stages]
