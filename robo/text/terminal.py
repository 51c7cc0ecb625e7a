r"""What reaches a terminal: text of nodes and strangers holds no control characters there, robo's own colours do.

A terminal obeys control characters, whoever wrote them: they clear the screen, set the clipboard, or make one line look
like another. So `robo` prints through a `Door`, which shows them as text (`\x1b`), and JSON that it prints has them
escaped. Robo's own control characters carry a mark that nobody outside of this process can know.
"""

import os
import re
import sys
from collections.abc import Sequence
from typing import Any, TextIO, cast

_MARK = f"\x1b{os.urandom(8).hex()};"
"""Stands before a control character that is robo's own."""

# C0 and C1 controls, delete; line and paragraph separators; characters that turn the direction of text; surrogates,
# which no encoding has.
_CONTROLS = "\\x00-\\x1f\\x7f-\\x9f\\u2028-\\u202e\\u2066-\\u2069\\ud800-\\udfff"
_CONTROL = re.compile(f"{re.escape(_MARK)}.|[{_CONTROLS}]")
_OWN_COLOUR = re.compile(re.escape(_MARK) + r"\x1b\[[0-9;]*m")
_ESCAPED_IN_JSON = re.compile("[\\x7f-\\x9f\\u2028-\\u202e\\u2066-\\u2069]")
_NOT_ASCII = re.compile("[^\\x00-\\x7e]")

# Colours, bold, faint, italic, underlined, inverse and crossed out; neither hidden nor blinking text.
_STYLE = r"(?:0?[0-479]|2[1-9]|[34][0-79]|(?:9|10)[0-7]|[345]8[;:](?:5[;:]\d{1,3}|2(?:[;:]\d{1,3}){3}))"
_COLOUR = re.compile(rf"\x1b\[(?:{_STYLE}(?:;{_STYLE})*)?m")


def visible(text: str, keep: str = "") -> str:
    r"""Text whose control characters are shown: ESC as `\x1b`, a right-to-left override as `\u202e`.

    Args:
        text: may hold what `own` has made; that stays.
        keep: characters that stay too, for example newlines.
    """

    def shown(match: "re.Match[str]") -> str:
        found = match[0]
        return found if len(found) > 1 or found in keep else found.encode("unicode_escape").decode()

    rest = text
    for character in keep:
        rest = rest.replace(character, "")
    return text if rest.isprintable() else _CONTROL.sub(shown, text)  # most text has nothing to be shown


def visible_but_colours(text: str, *, colour: bool) -> str:
    """A line that a process has printed: its colours stay, or go where none are shown; all else is visible.

    Tabs stay. What is coloured ends with the line.
    """
    if "\x1b" not in text:
        return visible(text, keep="\t")
    plain = [visible(part, keep="\t") for part in _COLOUR.split(text)]
    colours = _COLOUR.findall(text) if colour else []
    if not colours:
        return "".join(plain)
    return "".join(map("".join, zip(plain, [*colours, "\x1b[0m"], strict=True)))


def own(text: str) -> str:
    """Text of robo's own: a door lets its escape characters and carriage returns through."""
    return re.sub("[\x1b\r]", lambda match: _MARK + match[0], text)


def width(text: str) -> int:
    """How many columns a text takes where it is printed: colours of `own` take none."""
    return len(visible(_OWN_COLOUR.sub("", text)))


def escaped_json(text: str, encoding: str = "utf-8") -> str:
    r"""JSON in which control characters, and those that an encoding may not have, are written `\u202e`."""
    pattern = _ESCAPED_IN_JSON if encoding.lower().replace("-", "") == "utf8" else _NOT_ASCII
    return pattern.sub(lambda match: _json_escape(match[0]), text) if pattern.search(text) is not None else text


def _json_escape(character: str) -> str:
    units = character.encode("utf-16-be").hex()
    return "".join(f"\\u{units[i : i + 4]}" for i in range(0, len(units), 4))


class Door:
    """A stream to which control characters come as text, but for newlines, tabs and robo's own."""

    def __init__(self, stream: TextIO) -> None:
        self.behind = stream
        """What is written to it comes out as it is."""

    def write(self, text: str) -> int:
        """Write text."""
        self.behind.write(visible(text, keep="\n\t").replace(_MARK, ""))
        return len(text)

    def writelines(self, lines: Sequence[str]) -> None:
        """Write one text after the other."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.behind, name)


def guard() -> None:
    """Put a door before this process's stdout and stderr; what their encoding lacks is shown as an escape too."""
    sys.stdout, sys.stderr = _guarded(sys.stdout), _guarded(sys.stderr)


def _guarded(stream: TextIO) -> TextIO:
    if isinstance(stream, Door) or stream is None:  # None where the process was started with it closed
        return stream
    lenient(stream)
    return cast(TextIO, Door(stream))


def lenient(stream: TextIO) -> None:
    """Have a stream show what its encoding lacks as an escape."""
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors="backslashreplace")


def behind_the_door(stream: TextIO) -> TextIO:
    """The stream itself, for what makes all of its text visible by itself."""
    return stream.behind if isinstance(stream, Door) else stream
