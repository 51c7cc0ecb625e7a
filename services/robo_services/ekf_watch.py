"""Whether somebody says, and is believed, how far the base drives and how it turns. Pure: no network, no clock.

A message alone is no sign of life: its numbers may be refused, come too late, or be too far away to be believed. Where
only such come of the wheels, nobody knows how the base moves, as where the wheels are silent.
"""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from robo_services.ekf import QUANTITIES, Measurement
from robo_services.ekf_parameters import HEADING, WAY

NEEDED = ((WAY, "how far it drives"), (HEADING, "how it turns"))
"""What the filter does not go on without."""


class Source(NamedTuple):
    """Who may say something."""

    topic: str
    """In full."""
    use: frozenset[str]
    """The quantities that are taken of it."""


class Watch:
    """Keeps when what was heard, and when it was believed. All times are s, by one clock, which may step back."""

    def __init__(self, sources: Mapping[str, Source]) -> None:
        """`sources`: by name."""
        self._sources = sources
        self._said: dict[str, float] = {}  # by source
        self._heard: dict[str, float] = {}  # by quantity, as is what was believed
        self._believed: dict[str, float] = {}

    def hear(self, name: str, found: Iterable[Measurement], sent: float, now: float) -> None:
        """A source has measured something, that is finite, in a message that was sent at a time."""
        measured = {QUANTITIES[i] for one in found if not one.assumed for i in one.indices}
        if measured:
            _note(self._said, (name,), sent, now)
            _note(self._heard, measured, sent, now)

    def believe(self, indices: Iterable[int], now: float) -> None:
        """Measurements of these quantities were taken."""
        _note(self._believed, (QUANTITIES[i] for i in indices), now, now)

    def trust(self, now: float) -> None:
        """It begins, or goes on after a gap: what is heard has as long as ever to be believed."""
        self.believe(range(len(QUANTITIES)), now)

    def silent(self, now: float, timeout: float) -> list[str]:
        """The sources that have said nothing for so long, s."""
        return [name for name in self._sources if not _age(self._said, name, now) <= timeout]

    def unheard(self, now: float, timeout: float) -> str:
        """What nobody has said for so long, s; empty where all is heard that it takes."""
        for needed, what in NEEDED:
            if not _is_known(self._heard, needed, now, timeout):
                asked = [source.topic for source in self._sources.values() if needed & source.use]
                return f"nothing new of {what} on {', '.join(asked) or 'any topic: no source has it'}"
        return ""

    def doubted(self, now: float, timeout: float) -> str:
        """What nobody was believed for so long, s; empty where all is believed that it takes."""
        for needed, what in NEEDED:
            if not _is_known(self._believed, needed, now, timeout):
                return f"what is heard of {what} is not believed"
        return ""


def _note(times: dict[str, float], names: Iterable[str], time: float, now: float) -> None:
    for name in names:
        before = times.get(name, -math.inf)
        if time >= before or before > now:  # the latter where simulated time has stepped back
            times[name] = time


def _age(times: Mapping[str, float], name: str, now: float) -> float:
    time = times.get(name, -math.inf)
    return now - time if time <= now else math.inf


def _is_known(times: Mapping[str, float], needed: Iterable[str], now: float, timeout: float) -> bool:
    return any(_age(times, one, now) <= timeout for one in needed)
