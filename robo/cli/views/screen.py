"""The terminal of views that are drawn: tables and charts in place."""

import sys
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from robo.text.terminal import behind_the_door, visible


class Screen(Console):
    """Rich's console; what it draws holds no control characters but those that Rich itself moves the cursor with."""

    def __init__(self) -> None:
        super().__init__(file=behind_the_door(sys.stdout))

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """The segments of what is drawn, each with visible text."""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                yield Segment(visible(segment.text, keep="\n"), segment.style)
