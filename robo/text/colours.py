"""Colours of a terminal, and where they are shown."""

import os
from typing import TextIO

BOLD, FAINT = "1", "2"
RED, GREEN, YELLOW, BLUE, MAGENTA, CYAN = "31", "32", "33", "34", "35", "36"
BRIGHT_GREEN, BRIGHT_YELLOW, BRIGHT_BLUE, BRIGHT_MAGENTA, BRIGHT_CYAN = "92", "93", "94", "95", "96"
END = "\x1b[0m"
"""After it all is as before."""

LEVELS = {"DEBUG": FAINT, "WARN": YELLOW, "ERROR": RED, "FATAL": f"{BOLD};{RED}"}
"""Of the names of log levels."""


def begin(colour: str) -> str:
    """What a terminal takes for the beginning of a colour."""
    return f"\x1b[{colour}m"


def painted(text: str, colour: str) -> str:
    """Text in a colour."""
    return begin(colour) + text + END


def shown_on(stream: TextIO) -> bool:
    """Whether a stream shows colours: a terminal does, unless NO_COLOR says anything (https://no-color.org)."""
    return stream.isatty() and not os.environ.get("NO_COLOR")
