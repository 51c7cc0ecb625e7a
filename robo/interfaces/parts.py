"""Parts of messages by their paths, `pose.pose.position.x`, `ranges[0]`: of messages and of plain data. Pure."""

import re

import msgspec

from robo.errors import UsageError
from robo.text.suggestions import suggest

_NAME, _INDEX = r"[A-Za-z_]\w*", r"\[-?\d{1,9}\]"
_PATH = re.compile(rf"(?:{_NAME}|{_INDEX})(?:\.{_NAME}|{_INDEX})*\Z")
_STEP = re.compile(rf"{_NAME}|{_INDEX}")
_LISTS = (list, tuple, bytes, memoryview)


class Missing(LookupError):
    """A message has no such part; the text tells what it has."""

    def __init__(self, where: str, step: str | int, value: object) -> None:
        """
        Args:
            where: how far it was found; empty for the message.
            step: what is not there.
            value: what is there.
        """
        super().__init__(where, step)
        self._where, self._step, self._value = where, step, value

    @property
    def may_come(self) -> bool:
        """Whether another message of the type may have it: a longer list, or something rather than nothing."""
        return self._value is None or isinstance(self._step, int)

    def __str__(self) -> str:  # made where somebody reads it: of a long recording each message may lack it
        where, step, value = self._where, self._step, self._value
        if isinstance(step, int):
            if not isinstance(value, _LISTS):
                return f"{where or 'the message'} is no list"
            return f"{where or 'it'} has {len(value)} items, no [{step}]"
        names = _names(value)
        if names is None:
            return f"{where or 'the message'} has no fields"
        return f"{where or 'it'} has no field {step!r}; {suggest(step, names, 'it has')}"


class Field:
    """A part of a message, by its path."""

    def __init__(self, path: str) -> None:
        """
        Raises:
            UsageError: it is no path.
        """
        self.path = path
        if not _PATH.match(path):
            raise UsageError(f"field {path!r}: write names and indexes, for example pose.pose.position.x or ranges[0]")
        self._steps = [int(step[1:-1]) if step[0] == "[" else step for step in _STEP.findall(path)]

    def of(self, message: object) -> object:
        """The part of a message.

        Raises:
            Missing: it has no such part.
        """
        value = message
        for number, step in enumerate(self._steps):
            if isinstance(step, int):
                if not isinstance(value, _LISTS) or not -len(value) <= step < len(value):
                    raise Missing(self._written(number), step, value)
                value = value[step]
            elif isinstance(value, dict) and step in value:
                value = value[step]
            elif isinstance(value, msgspec.Struct) and step in value.__struct_fields__:
                value = getattr(value, step)
            else:
                raise Missing(self._written(number), step, value)
        return value

    def _written(self, count: int) -> str:
        """The path of the first steps."""
        return "".join(f"[{one}]" if isinstance(one, int) else f".{one}" for one in self._steps[:count]).removeprefix(
            "."
        )


def _names(value: object) -> list[str] | None:
    if isinstance(value, dict):
        return list(map(str, value))
    return list(value.__struct_fields__) if isinstance(value, msgspec.Struct) else None
