"""Messages that can be read, where those that cannot be are no reason to tell nothing of the others. Pure."""

from collections.abc import Iterable, Iterator

from robo.bag.read.topics import BagMessage
from robo.errors import BagError
from robo_messages import Message


class Readable:
    """Leaves out what is no message of its type, and counts it."""

    def __init__(self) -> None:
        self.left_out = 0
        self.reason = ""
        """Of the first one."""

    def of(self, messages: Iterable[BagMessage]) -> Iterator[tuple[BagMessage, Message]]:
        """Messages of known types, each with its value."""
        for message in messages:
            try:
                value = message.value
            except BagError as error:
                self.left_out += 1
                self.reason = self.reason or str(error)
                continue
            if isinstance(value, Message):
                yield message, value

    def notes(self) -> list[str]:
        """What is left out, in words."""
        if not self.left_out:
            return []
        what = "1 message" if self.left_out == 1 else f"{self.left_out:,} messages"
        return [f"{what} could not be read; the first: {self.reason}"]
