"""Parts of messages as plain data: `pose.pose.position.x`, `ranges[0]`; conditions on them; short forms. Pure."""

import re
from collections.abc import Iterator

import msgspec

from robo.errors import UsageError
from robo.launch.expression import Condition, ExpressionError
from robo.text.brief import marked
from robo.text.paths import unnested
from robo.text.suggestions import suggest
from robo.wire.codec import jsonable

_NAME, _INDEX = r"[A-Za-z_]\w*", r"\[-?\d{1,9}\]"
_PATH = re.compile(rf"(?:{_NAME}|{_INDEX})(?:\.{_NAME}|{_INDEX})*\Z")
_STEP = re.compile(rf"{_NAME}|{_INDEX}")

TRUNCATE_ITEMS = 16
"""Items of a list that a truncated message keeps."""
TRUNCATE_TEXT = 128
"""Characters of a text that a truncated message keeps."""


class Missing(LookupError):
    """A message has no such part; the text tells what it has."""


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
        so_far = ""
        for step in self._steps:
            if isinstance(step, str):
                if not isinstance(value, dict):
                    raise Missing(f"{so_far or 'the message'} has no fields")
                if step not in value:
                    raise Missing(f"{so_far or 'it'} has no field {step!r}; {suggest(step, map(str, value), 'it has')}")
                value = value[step]
                so_far += f".{step}" if so_far else step
            else:
                if not isinstance(value, (list, tuple)):
                    raise Missing(f"{so_far or 'the message'} is no list")
                if not -len(value) <= step < len(value):
                    raise Missing(f"{so_far} has {len(value)} items, no [{step}]")
                value = value[step]
                so_far += f"[{step}]"
        return value


class FieldFilter:
    """A condition on messages: `linear.x > 0.1 and header.frame_id == 'odom'`."""

    def __init__(self, text: str) -> None:
        """
        Raises:
            UsageError: it is no condition.
        """
        self._text = text
        try:
            self._condition = Condition(text)
        except ExpressionError as error:
            raise self._mistake(error) from None

    def holds(self, message: object) -> bool:
        """Whether a message fulfils it.

        Raises:
            UsageError: the condition makes no sense for this message: it lacks a field, or a text has no order
                among numbers.
        """

        def look_up(name: str) -> object:
            # ROS's filters call the message m.
            path = name[2:] if name.startswith("m.") and not (isinstance(message, dict) and "m" in message) else name
            try:
                return Field(path).of(message)
            except (Missing, UsageError) as error:
                raise KeyError(str(error)) from None

        try:
            return self._condition.holds(look_up)
        except ExpressionError as error:
            raise self._mistake(error) from None

    def _mistake(self, error: ExpressionError) -> UsageError:
        excerpt, mark = marked(self._text, error.offset)
        return UsageError(f"--filter: {error}\n  {excerpt}\n  {mark}")


def flattened(message: object) -> Iterator[tuple[str, object]]:
    """The single values of a message by their paths; a list is one value."""
    return unnested(message, ".") if isinstance(message, dict) and message else iter([("value", message)])


def cell(value: object) -> str:
    """A value as a cell of a table: a number or a text as it is, a list as JSON, bytes as base64."""
    if isinstance(value, (dict, list, tuple)):
        return msgspec.json.encode(jsonable(value)).decode()
    plain = jsonable(value)
    if plain is None:
        return ""
    return str(plain).lower() if isinstance(plain, bool) else str(plain)


def truncated(value: object) -> object:
    """A message with long lists, texts and bytes cut short; what is left out is told in their place."""
    if isinstance(value, dict):
        return {key: truncated(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        items: list[object] = [truncated(item) for item in value[:TRUNCATE_ITEMS]]
        more = len(value) - TRUNCATE_ITEMS
        return [*items, f"… {more} more"] if more > 0 else items
    if isinstance(value, str) and len(value) > TRUNCATE_TEXT:
        return f"{value[:TRUNCATE_TEXT]}… {len(value) - TRUNCATE_TEXT} more"
    if isinstance(value, (bytes, memoryview)):
        return f"<{len(value)} bytes>"
    return value
