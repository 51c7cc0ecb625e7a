"""The code blocks of the documentation, with what a comment before a block says of how it is tried.

<!-- not run: why -->          it stays untried
<!-- file: where_am_i.py -->   the reader is told to save it under this name
<!-- Ctrl-C after each -->     each of its commands ends before the next one
<!-- beside: COMMAND -->       what the page takes to be running; on a line of its own, anywhere

Below a command of a `console` block stands what it prints: each line comes, in this order. `…` and all numbers stand
for what varies. A line `cd FOLDER` holds for the rest of the page.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import msgspec

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), ROOT / "examples" / "README.md"]

_MARK = re.compile(r"<!-- (not run|file|beside)?(?:: )?(.*?) -->")


class Block(msgspec.Struct, frozen=True):
    """A block of code."""

    line: int
    """Of its first line in the page."""
    language: str
    text: str
    mark: str = ""
    """`not run`, `file`, `beside`, `Ctrl-C after each`, or nothing."""
    about: str = ""
    """What the mark says more."""

    def commands(self) -> Iterator[tuple[str, list[str]]]:
        """Each command of a shell, with the output that is printed below it."""
        if self.language == "console":
            for part in re.split(r"^\$ ", self.text, flags=re.MULTILINE)[1:]:
                command, *output = part.splitlines()
                yield command, output
        elif self.language == "sh":
            for line in self.text.splitlines():
                if line and not line.startswith("#"):
                    yield re.sub(r"\s+# .*$", "", line), []


def blocks(page: Path) -> Iterator[Block]:
    """The blocks of a page, and its marks of what runs beside it, in order."""
    lines = page.read_text(encoding="utf-8").splitlines()
    begin, mark, about = 0, "", ""
    for number, line in enumerate(lines, start=1):
        if begin and line.strip() == "```":
            opening = lines[begin - 1].strip().removeprefix("```")
            yield Block(begin + 1, opening, "".join(f"{one}\n" for one in lines[begin : number - 1]), mark, about)
            begin, mark, about = 0, "", ""
        elif not begin and line.startswith("```"):
            begin = number
        elif not begin and (found := _MARK.fullmatch(line)):
            mark, about = (found[1], found[2]) if found[1] else (found[2], "")
            if mark == "beside":
                yield Block(number, "sh", f"{about}\n", mark, about)
                mark, about = "", ""
        elif not begin and line.strip():
            mark, about = "", ""
