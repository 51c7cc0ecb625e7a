"""Messages that did not come: as the recorder counted them, or by the sequence numbers that a file holds.

A file has the last 32 bits of a number. They are continued to whole ones, so that a publisher that has sent more than
four billion messages loses none by that.
"""

from robo.bag.mcap.index import COUNTS
from robo.bag.read.reader import Bag
from robo.bag.write.counts import Counts, counts_of
from robo.samples.meters import Sequences

_TURN = 2**32


class Losses:
    """Counts what is missing of one topic, message by message."""

    def __init__(self) -> None:
        self.lost = 0
        self.counted = 0
        """Messages that had a number."""
        self._series = Sequences(several=True)
        self._last = 0

    def add(self, sequence: int, published: int) -> None:
        """A message: the last 32 bits of its number, 0 for none; when it was published, ns."""
        if not sequence and not self._last % _TURN:
            return  # nobody counts
        number = sequence
        if self.counted:
            turns = round((self._last - sequence) / _TURN)
            number += max(turns, 0) * _TURN
        self._last = number
        self.counted += 1
        self.lost += self._series.gap(number, published)


def recorder_counts(bag: Bag) -> dict[str, Counts]:
    """What the recorder counted, by topic; nothing where a file does not say so.

    Raises:
        DamagedBag: metadata cannot be read.
    """
    found: dict[str, Counts] = {}
    files = 0
    for words in bag.all_metadata():
        if words.name == COUNTS:
            files += 1
            for topic, counts in counts_of(words.words).items():
                so_far = found.setdefault(topic, Counts())
                so_far.received += counts.received
                so_far.lost += counts.lost
                so_far.malformed += counts.malformed
    return found if files == len(bag.files.indexes) else {}
