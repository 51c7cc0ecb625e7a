"""Whether messages come as often as a subscription needs them; its node's log tells when they do not."""

from collections.abc import Callable


class Deadline:
    """Looks once in a deadline whether something has come since; a silence of twice as long is always found."""

    def __init__(self, received: Callable[[], int], tell: Callable[[bool], None]) -> None:
        """
        Args:
            received: how many messages have come so far.
            tell: is told once when none comes any more (False), and once when they come again (True).
        """
        self._received = received
        self._tell = tell
        self._before = 0
        self._silent = False

    def look(self) -> None:
        """See whether a message has come since the last time; before the first one nothing is late."""
        count = self._received()
        silent = count > 0 and count == self._before
        if silent != self._silent:
            self._silent = silent
            self._tell(not silent)
        self._before = count
