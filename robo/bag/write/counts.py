"""How many messages of each topic came, and how many did not: exact, by the whole sequence numbers. Pure."""

from collections.abc import Hashable

import msgspec

from robo.samples.meters import Sequences

_MOST_PUBLISHERS = 10_000
"""That are remembered: they come and go."""


class Counts(msgspec.Struct):
    """Of one topic."""

    received: int = 0
    lost: int = 0
    """By gaps in the sequence numbers."""
    malformed: int = 0
    """That came and could not be written down."""


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
        lost = 0
        if sequence is not None:
            if source is not None:
                key = topic, source
                last = self._last.get(key)
                if last is None:
                    self._forget_one()
                elif sequence > last + 1:
                    lost = sequence - last - 1
                # One that came late has been counted as lost; those that follow it are not.
                self._last[key] = sequence if last is None else max(sequence, last)
            else:
                series = self._unnamed.get(topic)
                if series is None:
                    series = self._unnamed[topic] = Sequences(several=True)
                lost = series.gap(sequence, published)
        for counts in (self._of(self.total, topic), self._of(self.file, topic)):
            counts.received += 1
            counts.lost += lost

    def count_malformed(self, topic: str) -> None:
        """A message has come that could not be written down."""
        self._of(self.total, topic).malformed += 1
        self._of(self.file, topic).malformed += 1

    def take_file(self) -> dict[str, Counts]:
        """The counts since the last file began; a new one begins."""
        found, self.file = self.file, {}
        return found

    def _forget_one(self) -> None:
        if len(self._last) >= _MOST_PUBLISHERS:
            del self._last[next(iter(self._last))]

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
            found[topic] = msgspec.json.decode(text, type=Counts)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            continue
    return found
