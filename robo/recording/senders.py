"""Whose each message is, so that what is lost is counted by publisher. Pure.

A publisher signs its messages, but in a flood it leaves that out: those that follow its last one are its own.
"""

from collections.abc import Callable, Sequence

_MOST_SENDERS = 256
"""Of a topic that are told apart, the newest."""
_MOST_TOPICS = 20_000


class Senders:
    """Tells publishers apart by what they sign, and by their sequence numbers where they do not."""

    def __init__(self, announced: Callable[[str], Sequence[str]]) -> None:
        """`announced` has Zenoh's ids of the publishers of a topic that nodes tell of."""
        self._announced = announced
        self._last: dict[str, dict[str, int]] = {}
        """The last number of each sender, by topic."""
        self._unnamed = 0

    def sender(self, topic: str, signed: str | None, number: int) -> str:
        """Whose a message is.

        Args:
            topic: on which it came.
            signed: the id of its publisher; None where it does not say.
            number: of the message.
        """
        last = self._last.get(topic)
        if last is None:
            if len(self._last) >= _MOST_TOPICS:
                del self._last[next(iter(self._last))]
            last = self._last[topic] = {}
        sender = signed if signed is not None else self._guessed(topic, last, number)
        if sender not in last and len(last) >= _MOST_SENDERS:
            del last[next(iter(last))]
        last[sender] = number
        return sender

    def has(self, topic: str, signed: str | None, number: int) -> bool:
        """Whether a message of a publisher that signs has come already, or one that is newer."""
        return signed is not None and self._last.get(topic, {}).get(signed, number - 1) >= number

    def _guessed(self, topic: str, last: dict[str, int], number: int) -> str:
        """The one whose last number this one follows, or comes closest behind."""
        nearest, nearest_number = "", -1
        for sender, before in last.items():
            if nearest_number < before < number:
                nearest, nearest_number = sender, before
        announced = self._announced(topic)
        if nearest and (number == nearest_number + 1 or len(announced) < 2):
            return nearest
        quiet = [one for one in announced if one not in last]
        if quiet:
            return quiet[0] if len(quiet) == 1 else self._new()
        return nearest or self._new()

    def _new(self) -> str:
        self._unnamed += 1
        return f"unnamed {self._unnamed}"
