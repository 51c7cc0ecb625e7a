"""How far a batch is. Pure."""

import msgspec

from robo.text.durations import duration


class Progress(msgspec.Struct):
    """What has been done of a batch."""

    total: int
    begun: float
    """By a clock that only grows, s."""
    there: int = 0
    """Results that were there before."""
    done: int = 0
    """Runs that have ended since."""
    failed: int = 0
    """Of all of those."""
    again: int = 0
    """Runs whose process had died, and that were begun anew."""

    @property
    def left(self) -> int:
        """Runs that have no result yet."""
        return self.total - self.there - self.done

    def time_left(self, now: float) -> float | None:
        """How long the others will take, as those did that have ended, s; None while none has."""
        return (now - self.begun) / self.done * self.left if self.done else None

    def sentence(self, now: float) -> str:
        """How far it is, for a line of a terminal."""
        words = [f"{self.there + self.done} of {self.total} done", f"{self.failed} failed", f"{self.left} left"]
        words += [f"{self.again} begun anew"] if self.again else []
        remaining = self.time_left(now)
        words += [f"{duration(remaining)} to go"] if remaining is not None and self.left else []
        return ", ".join(words)
