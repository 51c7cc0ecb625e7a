"""The mistakes of a manifest, as people and as programs read them."""

from collections.abc import Iterable, Sequence
from functools import lru_cache

from robo.errors import ManifestError, UnreadableFile
from robo.launch.arguments import COMMAND_LINE
from robo.text.brief import marked
from robo.text.files import read_bytes
from robo.text.tree import Problem
from robo.text.yaml_tree import lines_of

MOST_SHOWN = 100
"""People are shown no more than so many mistakes at once."""


class ManifestFaults(ManifestError):
    """A manifest, its includes or its parameter files have mistakes."""

    def __init__(self, faults: Iterable[Problem]) -> None:
        self.faults = in_order(faults)
        """By file and line, each once."""
        self.of_command_line = exit_code(self.faults) == 2
        super().__init__("\n".join(map(str, self.faults)))


def in_order(problems: Iterable[Problem]) -> tuple[Problem, ...]:
    """Problems by file, in the order in which the files first come up, then by line; each once."""
    each = dict.fromkeys(problems)
    files = {file: index for index, file in enumerate(dict.fromkeys(p.position.file for p in each))}
    return tuple(sorted(each, key=lambda p: (files[p.position.file], p.position.line, p.position.column)))


def exit_code(problems: Iterable[Problem]) -> int:
    """2 where nothing but words of the command line makes no sense; else 1."""
    return 2 if all(problem.position == COMMAND_LINE for problem in problems) else 1


def as_text(problems: Iterable[Problem]) -> str:
    """Problems for people: place, text, and the line with a mark below."""
    read = lru_cache(_lines)  # for this report: the files may be others the next time
    found = list(problems)
    texts = [_with_excerpt(problem, read(problem.position.file)) for problem in found[:MOST_SHOWN]]
    more = [f"… and {len(found) - MOST_SHOWN:,} more"] if len(found) > MOST_SHOWN else []
    return "\n".join([*texts, *more])


def as_notes(problems: Iterable[Problem], label: str) -> str:
    """What is worth a line and no more."""
    return "\n".join(f"{problem.position}: {label}: {problem.message}" for problem in problems)


def as_data(problems: Iterable[Problem]) -> list[dict[str, object]]:
    """Problems for programs."""
    return [
        {
            "file": problem.position.file,
            "line": problem.position.line,
            "column": problem.position.column,
            "message": problem.message,
        }
        for problem in problems
    ]


def _with_excerpt(problem: Problem, lines: Sequence[str]) -> str:
    _, number, column = problem.position
    head = str(problem)
    if not 0 < number <= len(lines):
        return head
    excerpt, mark = marked(lines[number - 1], column - 1)
    return f"{head}\n{number:5} | {excerpt}\n      | {mark}"


def _lines(file: str) -> list[str]:
    try:
        return lines_of(read_bytes(file).decode("utf-8", errors="replace"))
    except UnreadableFile:
        return []
