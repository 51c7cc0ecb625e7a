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

from robo_services.ekf import VX, Estimate, Measurement, Unusable, after_gap, check, correct, predict

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
        self.late = 0
        """Measurements that came too late."""
        self.replayed = 0
        """Measurements that were taken again, because an older one came later."""
        self.refused: Counter[str] = Counter()
        """Measurements that said nothing, by source."""
        self.rejected: Counter[str] = Counter()
        """Measurements that were further away than their threshold, by source."""
        self.complaint = ""
        """Why the last one was refused."""
        self._initial = [estimate.variance(i) for i in range(VX, len(estimate.mean))]
        self._before = estimate._replace(time=math.nan)
        self._steps: deque[_Step] = deque()

    @property
    def now(self) -> Estimate:
        """What is known as of the newest measurement; its time is NaN before the first."""
        return self._steps[-1].after if self._steps else self._before

    def begin_anew(self, estimate: Estimate) -> None:
        """Forget what was: this is known, and older measurements come too late."""
        self._steps.clear()
        self._before = estimate

    def take(self, measurements: Iterable[Measurement]) -> None:
        """Take measurements, in whatever order they came. What says nothing is counted and left out."""
        new = sorted((one for one in measurements if self._is_usable(one)), key=lambda one: one.time)
        if not new:
            return
        if math.isnan(self._before.time):
            self._before = self._before._replace(time=new[0].time)
        earliest = self._before.time
        self.late += sum(one.time < earliest for one in new)
        new = [one for one in new if one.time >= earliest]
        again: list[Measurement] = []
        while new and self._steps and self._steps[-1].after.time > new[0].time:
            again.append(self._steps.pop().measured)
        self.replayed += len(again)
        known = {id(one) for one in again}
        for one in sorted([*reversed(again), *new], key=lambda one: one.time):
            self._step(one, is_new=id(one) not in known)
        self._forget()

    def lose(self, time: float) -> None:
        """Nobody has known until now how it moves: it begins anew from where it was, less sure."""
        now = self.now
        if time > now.time:
            self.begin_anew(after_gap(now, time - now.time, self._initial))

    def _step(self, measured: Measurement, *, is_new: bool) -> None:
        before = self.now
        dt = measured.time - before.time
        there = after_gap(before, dt, self._initial) if dt > self.longest_step else predict(before, dt, self.noise)
        there = there._replace(time=measured.time)
        try:
            after, distance = correct(there, measured)
        except Unusable as error:
            if is_new:
                self._refuse(measured, error)
            return
        if is_new and distance > measured.threshold:
            self.rejected[measured.source] += 1
        self._steps.append(_Step(measured, after))

    def _is_usable(self, measured: Measurement) -> bool:
        try:
            check(measured)
        except Unusable as error:
            self._refuse(measured, error)
            return False
        return True

    def _refuse(self, measured: Measurement, error: Unusable) -> None:
        self.refused[measured.source] += 1
        self.complaint = f"{measured.source}: {error}"

    def _forget(self) -> None:
        oldest = self.now.time - self.history
        while self._steps and (self._steps[0].after.time < oldest or len(self._steps) > MOST):
            self._before = self._steps.popleft().after
