"""How many messages of each topic came, and how many did not: exact, by the whole sequence numbers. Pure."""

from collections.abc import Hashable

import msgspec

from robo.samples.meters import Sequences
from robo.text.readable import readable

_MOST_PUBLISHERS = 10_000
"""That are remembered: they come and go."""


class Counts(msgspec.Struct):
    """Of one topic."""

    received: int = 0
    lost: int = 0
    """By gaps in the sequence numbers."""
    malformed: int = 0
    """That came and could not be written down."""
    left_out: int = 0
    """That came while too many waited to be written down; those that had a number are among the lost, too."""


class Counter:
    """Counts messages, in all and since the last file began."""

    def __init__(self) -> None:
        self.total: dict[str, Counts] = {}
        """By topic."""
        self.file: dict[str, Counts] = {}
        self._last: dict[tuple[str, Hashable], int] = {}
        self._unnamed: dict[str, Sequences] = {}

    def count(self, topic: str, sequence: int | None, published: int, source: Hashable) -> None:
        """A message has come.

        Args:
            topic: its topic.
            sequence: its whole number; None where its publisher does not count.
            published: ns since the epoch.
            source: its publisher; None where that is not known.
        """
        total = self.total.get(topic) or self._of(self.total, topic)
        file = self.file.get(topic) or self._of(self.file, topic)
        total.received += 1
        file.received += 1
        if sequence is None:
            return
        key = topic, source
        if self._last.get(key) == sequence - 1:  # as nearly always
            self._last[key] = sequence
        elif lost := self._gap(topic, sequence, published, source):
            total.lost += lost
            file.lost += lost

    def count_malformed(
        self, topic: str, sequence: int | None = None, published: int = 0, source: Hashable = None
    ) -> None:
        """A message has come that could not be written down: it is not lost. Arguments as those of `count`."""
        lost = self._gap(topic, sequence, published, source) if sequence is not None else 0
        for counts in (self._of(self.total, topic), self._of(self.file, topic)):
            counts.malformed += 1
            counts.lost += lost

    def take_file(self) -> dict[str, Counts]:
        """The counts since the last file began; a new one begins."""
        found, self.file = self.file, {}
        return found

    def count_left_out(self, topic: str, count: int) -> None:
        """Messages have come that were not looked at."""
        self._of(self.total, topic).left_out += count
        self._of(self.file, topic).left_out += count

    def _gap(self, topic: str, sequence: int, published: int, source: Hashable) -> int:
        """How many messages are missing between the last one and this one."""
        if source is None:
            series = self._unnamed.get(topic)
            if series is None:
                series = self._unnamed[topic] = Sequences(several=True)
            return series.gap(sequence, published)
        key = topic, source
        last = self._last.get(key)
        if last is None:
            if len(self._last) >= _MOST_PUBLISHERS:
                del self._last[next(iter(self._last))]
            self._last[key] = sequence
            return 0
        # One that came late has been counted as lost; those that follow it are not.
        self._last[key] = max(sequence, last)
        return max(sequence - last - 1, 0)

    @staticmethod
    def _of(counts: dict[str, Counts], topic: str) -> Counts:
        found = counts.get(topic)
        if found is None:
            found = counts[topic] = Counts()
        return found


def words_of(counts: dict[str, Counts]) -> dict[str, str]:
    """As metadata of a file have them."""
    return {topic: msgspec.json.encode(of_topic).decode() for topic, of_topic in counts.items()}


def counts_of(words: dict[str, str]) -> dict[str, Counts]:
    """From metadata of a file; what cannot be read is left out."""
    found = {}
    for topic, text in words.items():
        try:
            found[topic] = msgspec.json.decode(text, type=readable(Counts))
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            continue
    return found
