"""The files of the sample package, filled in for a user's.

`_sample/` holds a whole package, `sample_robot`, in its own languages: tools read, check and format it as it stands.
Two things are done to a file of it, and no more:

- The sample's own words (`sample_robot`, `SampleNode`, …) stand for the user's.
- A line `# each NAME` and the next `# end` of the same depth hold lines that are there once for each thing of that
  name, `# if NAME` lines that are there where that holds. Such lines themselves are left out.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

FOLDER = Path(__file__).parent / "_sample"

_BEGIN = re.compile(r"\s*# (each|if) (\w+)$")
_END = re.compile(r"\s*# end$")
_SKIPPED = {"__pycache__", ".ruff_cache", ".mypy_cache", ".pytest_cache"}


class Filling(msgspec.Struct, frozen=True, kw_only=True):
    """What a part of the sample is filled with."""

    words: Mapping[str, str]
    """From a text of the sample to what stands there instead."""
    true: frozenset[str] = frozenset()
    """The conditions that hold."""
    each: Mapping[str, Sequence["Filling"]] = msgspec.field(default_factory=dict)
    """By name, what is there several times; each has its own words beside those around it."""

    def within(self, inner: "Filling") -> "Filling":
        """The filling of a block, which knows what is around it."""
        return Filling(
            words={**self.words, **inner.words}, true=self.true | inner.true, each={**self.each, **inner.each}
        )


def sample(path: str) -> str:
    """The text of a file of the sample package."""
    return (FOLDER / path).read_text(encoding="utf-8")


def sample_files() -> list[str]:
    """The paths of all files of the sample package, sorted."""
    files = (file.relative_to(FOLDER) for file in FOLDER.rglob("*") if file.is_file())
    return sorted(file.as_posix() for file in files if not _SKIPPED.intersection(file.parts))


def filled(text: str, filling: Filling) -> str:
    """A text of the sample, filled in."""
    return "".join(_lines(text.splitlines(keepends=True), filling))


def _lines(lines: Sequence[str], filling: Filling) -> Iterator[str]:
    number = 0
    while number < len(lines):
        begin = _BEGIN.match(lines[number].rstrip("\n"))
        if begin is None:
            yield _substituted(lines[number], filling.words)
            number += 1
            continue
        end = _end_of(lines, number)
        block = lines[number + 1 : end]
        if begin[1] == "each":
            for inner in filling.each.get(begin[2], ()):
                yield from _lines(block, filling.within(inner))
        elif begin[2] in filling.true:
            yield from _lines(block, filling)
        number = end + 1


def _end_of(lines: Sequence[str], begin: int) -> int:
    """The line that ends a block: marks nest."""
    depth = 0
    for number in range(begin, len(lines)):
        line = lines[number].rstrip("\n")
        depth += bool(_BEGIN.match(line)) - bool(_END.match(line))
        if depth == 0:
            return number
    raise ValueError(f"the block that begins with {lines[begin].strip()!r} has no end")


def _substituted(line: str, words: Mapping[str, str]) -> str:
    """A line with all words at once: what was put in is not looked at again."""
    if not words:
        return line
    longest_first = sorted(words, key=len, reverse=True)
    pattern = "|".join(_pattern(word) for word in longest_first)
    return re.sub(pattern, lambda found: words[found[0]], line)


def _pattern(word: str) -> str:
    """Only the sample's own words may stand within longer ones: `next_sample_output`."""
    text = re.escape(word)
    if word.lower().startswith("sample"):
        return text
    return (r"(?<!\w)" if word[0].isalnum() else "") + text + (r"(?!\w)" if word[-1].isalnum() else "")
