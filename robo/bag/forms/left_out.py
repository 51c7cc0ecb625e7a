"""What of a log of CARMEN is left out. Pure."""

from robo.bag.forms import carmen

_MOST_NAMED = 20
"""Lines that are left out and named."""


class LeftOut:
    """Counts it."""

    def __init__(self) -> None:
        self._rewritten, self._malformed = _Lines(), _Lines()

    @property
    def malformed(self) -> int:
        """Lines that make no sense."""
        return self._malformed.count

    def takes(self, record: carmen.Record) -> bool:
        """Whether a record is left out; it is counted then."""
        match record:
            case carmen.Rewritten(line):
                self._rewritten.add(line)
            case carmen.MalformedLog(line, reason):
                self._malformed.add(line, reason)
            case _:
                return False
        return True

    def add(self, line: int, reason: str) -> None:
        """A line makes no sense."""
        self._malformed.add(line, reason)

    def notes(self) -> list[str]:
        """What is left out, in words."""
        found = []
        if self._rewritten.count:
            found.append(f"odometry of time 0, which a mapping tool wrote, is left out: {self._rewritten}")
        if self._malformed.count:
            found.append(f"what makes no sense is left out: {self._malformed}; the first: {self._malformed.reason}")
        return found


class _Lines:
    """Lines that are left out: how many, and which the first of them are."""

    def __init__(self) -> None:
        self.count = 0
        self.reason = ""
        """Of the first one."""
        self._first: list[int] = []

    def add(self, line: int, reason: str = "") -> None:
        self.count += 1
        self.reason = self.reason or reason
        if len(self._first) < _MOST_NAMED:
            self._first.append(line)

    def __str__(self) -> str:
        more = self.count - len(self._first)
        first = ", ".join(map(str, self._first))
        return f"line{'s' if self.count > 1 else ''} {first}{f' and {more:,} more' if more else ''}"
