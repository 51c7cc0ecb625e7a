"""Measurements in any order: what comes late is put where it belongs, as long as that is not too long ago.

    filter = Ekf(begin(variances), noise)
    filter.take([measurement, another])     # of several sensors, as they come
    print(filter.now.mean, filter.late)

Sensors take different times to be heard. The filter keeps what it knew at each measurement for a while; one that comes
late takes it back to before that one, and all that came since is taken again. Pure, as `ekf` is.
"""

import math
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from robo_services.ekf import QUANTITIES, VX, Estimate, Measurement, Unusable, after_gap, correct, predict

MOST = 2000
"""Measurements that are kept at most: however long the history is, and however quick the sensors."""


class _Step(NamedTuple):
    measured: Measurement
    after: Estimate


class Ekf:
    """Follows a base by what sensors say."""

    def __init__(
        self, estimate: Estimate, noise: Sequence[float], *, history: float = 0.3, longest_step: float = 1.0
    ) -> None:
        """
        Args:
            estimate: what is known before the first measurement; its time is that of the first measurement.
            noise: what is added to the variance of each quantity in a second.
            history: how much older than the newest a measurement may be, s.
            longest_step: over a longer time without any measurement nothing is predicted, s: nobody knows how it moved.
        """
        self.noise, self.history, self.longest_step = noise, history, longest_step
        self.late: Counter[str] = Counter()
        """Measurements that came too late, by source."""
        self.replayed = 0
        """Measurements that were taken again, because an older one came later."""
        self.refused: Counter[str] = Counter()
        """Measurements that said nothing, by source."""
        self.rejected: Counter[str] = Counter()
        """Measurements that were further away than their threshold, by source."""
        self.complaints: dict[str, str] = {}
        """Why the last one that was left out was, by source."""
        self.unsure = [estimate.variance(i) for i in range(VX, len(estimate.mean))]
        """The variances of velocities and accelerations where nobody knows them."""
        self._before = estimate._replace(time=math.nan)
        self._steps: deque[_Step] = deque()

    @property
    def now(self) -> Estimate:
        """What is known as of the newest measurement; its time is NaN before the first."""
        return self._steps[-1].after if self._steps else self._before

    @property
    def left_out(self) -> Counter[str]:
        """All that was not taken, by source."""
        return self.refused + self.rejected + self.late

    def begin_anew(self, estimate: Estimate) -> None:
        """Forget what was: this is known, and older measurements come too late."""
        self._steps.clear()
        self._before = estimate

    def take(self, measurements: Iterable[Measurement], *, replay: bool = True) -> set[int]:
        """Take measurements, in whatever order they came. What says nothing is counted and left out.

        Args:
            measurements: of any sources.
            replay: whether what is late is put where it belongs, which takes all that came since once more; else it is
                left out.

        Returns:
            Which quantities were measured, and not only assumed, by those that were taken.
        """
        new = sorted((one for one in measurements if self._has_time(one)), key=lambda one: one.time)
        if not new:
            return set()
        if math.isnan(self._before.time):
            self._before = self._before._replace(time=new[0].time)
        earliest = self._before.time if replay else self.now.time
        new = [one for one in new if not self._is_late(one, earliest)]
        again: list[Measurement] = []
        while new and self._steps and self._steps[-1].after.time > new[0].time:
            again.append(self._steps.pop().measured)
        self.replayed += len(again)
        known = {id(one) for one in again}
        taken: set[int] = set()
        for one in sorted([*reversed(again), *new], key=lambda one: one.time):
            is_new = id(one) not in known
            if self._step(one, is_new=is_new) and is_new and not one.assumed:
                taken.update(one.indices)
        self._forget()
        return taken

    def lose(self, next_time: float = -math.inf) -> None:
        """Nobody has known how it moves, until `next_time`, s, or now: it begins anew where it was, less sure."""
        now = self.now
        if not math.isnan(now.time):
            self.begin_anew(after_gap(now, max(0.0, next_time - now.time), self.unsure))

    def _step(self, measured: Measurement, *, is_new: bool) -> bool:
        """Whether it was believed."""
        before = self.now
        dt = measured.time - before.time
        there = after_gap(before, dt, self.unsure) if dt > self.longest_step else predict(before, dt, self.noise)
        there = there._replace(time=measured.time)
        try:
            after, distance = correct(there, measured)
        except Unusable as error:
            if is_new:
                self.refuse(measured.source, error)
            return False
        self._steps.append(_Step(measured, after))
        if distance <= measured.threshold:
            return True
        if is_new:
            self.rejected[measured.source] += 1
            names = ", ".join(QUANTITIES[i] for i in measured.indices)
            self.complaints[measured.source] = f"{names}: {distance:.3g} standard deviations from what was expected"
        return False

    def _is_late(self, measured: Measurement, earliest: float) -> bool:
        if measured.time >= earliest:
            return False
        self.late[measured.source] += 1
        self.complaints[measured.source] = f"{self.now.time - measured.time:.3g} s late"
        return True

    def refuse(self, source: str, error: Unusable) -> None:
        """Count what says nothing."""
        self.refused[source] += 1
        self.complaints[source] = str(error)

    def _has_time(self, measured: Measurement) -> bool:
        if math.isfinite(measured.time):
            return True
        self.refuse(measured.source, Unusable("its time is not finite"))
        return False

    def _forget(self) -> None:
        oldest = self.now.time - self.history
        while self._steps and (self._steps[0].after.time < oldest or len(self._steps) > MOST):
            self._before = self._steps.popleft().after
