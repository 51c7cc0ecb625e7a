"""Messages as plain data: conditions on their parts; their single values; short forms. Pure."""

from collections.abc import Iterator

import msgspec

from robo.errors import UsageError
from robo.interfaces.parts import Field, Missing
from robo.launch.expression import Condition, ExpressionError
from robo.text.brief import marked
from robo.text.paths import unnested
from robo.wire.codec import jsonable

TRUNCATE_ITEMS = 16
"""Items of a list that a truncated message keeps."""
TRUNCATE_TEXT = 128
"""Characters of a text that a truncated message keeps."""


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
