"""What a launch shows: one line per event, with time, node and colour.

Nothing that a process prints reaches the terminal as a control character, but for its colours where there are colours.
"""

import sys
import time
from collections.abc import Iterable
from typing import TextIO

from robo.text import colours
from robo.text.terminal import behind_the_door, visible, visible_but_colours

_NODE_COLOURS = (
    *(colours.CYAN, colours.GREEN, colours.MAGENTA, colours.BLUE, colours.YELLOW),
    *(colours.BRIGHT_CYAN, colours.BRIGHT_GREEN, colours.BRIGHT_MAGENTA, colours.BRIGHT_BLUE, colours.BRIGHT_YELLOW),
)
SELF = "robo"


class Console:
    """Writes the lines of all nodes to one stream. Colour only on a terminal, and never with NO_COLOR."""

    def __init__(self, nodes: Iterable[str], stream: TextIO | None = None, *, colour: bool | None = None) -> None:
        self._stream = stream if stream is not None else behind_the_door(sys.stdout)
        self._colour = colours.shown_on(self._stream) if colour is None else colour
        names = list(nodes)
        self._width = max(map(len, [SELF, *names]))
        self._colours = {name: _NODE_COLOURS[i % len(_NODE_COLOURS)] for i, name in enumerate(names)}
        self._colours[SELF] = colours.BOLD
        self._open = True

    def line(self, node: str, text: str, *, at: float | None = None) -> None:
        """Show one line of a node's output; `at` is its time, s since the epoch, by default now."""
        self._write(node, self._with_level(visible_but_colours(text, colour=self._colour)), at)

    def say(self, text: str) -> None:
        """Show what the supervisor itself has to say."""
        for line in text.split("\n"):
            self._write(SELF, visible(line, keep="\t"))

    def warn(self, text: str) -> None:
        """Show what went wrong."""
        for line in text.split("\n"):
            self._write(SELF, self._painted(visible(line, keep="\t"), colours.LEVELS["ERROR"]))

    def close(self) -> None:
        """Write no more: nobody reads it."""
        self._open = False

    def _write(self, node: str, text: str, at: float | None = None) -> None:
        if not self._open:
            return
        now = time.time() if at is None else at
        stamp = time.strftime("%H:%M:%S", time.localtime(now)) + f".{int(now * 1000) % 1000:03d}"
        name = self._painted(f"{visible(node):{self._width}} |", self._colours.get(node, "0"))
        try:
            self._stream.write(f"{self._painted(stamp, colours.FAINT)} {name} {text}\n")
            self._stream.flush()
        except OSError:
            # Whoever read us is gone, or the terminal is closed; the robot is looked after all the same.
            self._open = False

    def _with_level(self, text: str) -> str:
        level = text[:5].rstrip()
        colour = colours.LEVELS.get(level)
        return text if colour is None else self._painted(text[:5], colour) + text[5:]

    def _painted(self, text: str, colour: str) -> str:
        return colours.painted(text, colour) if self._colour else text
