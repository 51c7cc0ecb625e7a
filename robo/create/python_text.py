"""Python source as the usual formatters and linters want it: imports, long lines, blank lines. Pure.

Only what the sample package needs: imports of a line each at the head of a file, and long lines that are a call or a
`def` within a bracket.
"""

import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence

import robo_messages

WIDTH = 120
"""The longest line, as the `pyproject.toml` of a package says, letters."""

_IMPORT = re.compile(r"(?:from (\S+) )?import (.+)$")
_PAIRS = {"(": ")", "[": "]", "{": "}"}


def tidy(text: str, names: Mapping[str, Iterable[str]], own: str) -> str:
    """A Python file with the imports that it uses, and none that it does not.

    Args:
        text: of the file; each import stands in one line of its head. Imports of messages and of one's own package
            are the sample's, and make room for `names`.
        names: by module, what else there is to import: `Name` or `Name as Other`.
        own: the package whose imports stand apart, below all others.
    """
    head, found, body = _parted(text.splitlines())
    kept = [(module, name) for module, name in found if module.partition(".")[0] not in (robo_messages.__name__, own)]
    every = {*kept, *((module, name) for module, several in names.items() for name in several)}
    # What strings and comments say is no use of a name.
    words = set(re.findall(r"\w+", re.sub(r'"[^"\n]*"|#.*', "", "\n".join(body))))
    used = [(module, name) for module, name in every if (name or module).rpartition(" ")[2] in words]
    lines = [*head, *_import_lines(used, own), *body]
    return "\n".join([*_spaced(short for line in lines for short in _short(line)), ""])


def _parted(lines: Sequence[str]) -> tuple[list[str], list[tuple[str, str]], list[str]]:
    """What stands above the imports; each import as module and name, the name empty for `import module`; the rest."""
    numbers = [number for number, line in enumerate(lines) if _IMPORT.match(line)]
    found = []
    for number in numbers:
        match = _IMPORT.match(lines[number])
        assert match is not None
        several = match[2].split(", ") if match[1] else [""]
        found += [(match[1] or match[2], name) for name in several]
    return list(lines[: numbers[0]]), found, list(lines[numbers[-1] + 1 :])


def _import_lines(imports: Iterable[tuple[str, str]], own: str) -> Iterator[str]:
    """Imports in three parts: the standard library, packages, one's own; blank lines between them."""
    together: dict[str, list[str]] = {}
    statements: list[tuple[tuple[object, ...], str, str]] = []
    for module, name in imports:
        if not name:
            statements.append(((0, _order(module)), module, f"import {module}"))
        elif " as " in name:
            statements.append(((1, _order(module), _member_order(name)), module, f"from {module} import {name}"))
        else:
            together.setdefault(module, []).append(name)
    for module, several in together.items():
        several.sort(key=_member_order)
        key = (1, _order(module), _member_order(several[0]))
        statements.append((key, module, f"from {module} import {', '.join(several)}"))
    parts: list[list[str]] = [[], [], []]
    for _, module, statement in sorted(statements):
        first = module.partition(".")[0]
        parts[0 if first in sys.stdlib_module_names else 2 if first == own else 1].append(statement)
    yield from "\n\n".join("\n".join(part) for part in parts if part).split("\n")


def _order(name: str) -> tuple[object, ...]:
    """Alphabetical, with the numbers in names as numbers: `Int8` before `Int16`."""
    return tuple(
        (0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.findall(r"\d+|\D+", name.lower())
    )


def _member_order(name: str) -> tuple[object, ...]:
    """CONSTANTS, then Classes, then functions."""
    first = name.partition(" ")[0]
    kind = 0 if first.isupper() and len(first) > 1 else 1 if first[:1].isupper() else 2
    return (kind, _order(first), first)


def _short(line: str) -> Iterator[str]:
    """A line, or where it is too long the same with each item of its first bracket in a line of its own."""
    if len(line) <= WIDTH:
        yield line
        return
    indent = line[: len(line) - len(line.lstrip())]
    imported = re.match(r"from \S+ import (?!\()", line)
    if imported is not None:
        line = f"{imported[0]}({line[imported.end() :]})"
    begin = line.index("(")
    end = _closing(line, begin)
    yield line[: begin + 1]
    for item in _items(line[begin + 1 : end]):
        yield f"{indent}    {item},"
    yield f"{indent}{line[end:]}"


def _closing(line: str, begin: int) -> int:
    """Where the bracket that opens at `begin` closes."""
    open_: list[str] = []
    for place in range(begin, len(line)):
        if line[place] in _PAIRS:
            open_.append(_PAIRS[line[place]])
        elif open_ and line[place] == open_[-1]:
            open_.pop()
            if not open_:
                return place
    raise ValueError(f"a bracket is not closed: {line}")


def _items(text: str) -> Iterator[str]:
    """What stands between the commas of a bracket, those of inner ones left alone."""
    depth, begin = 0, 0
    for place, character in enumerate(text):
        depth += (character in _PAIRS) - (character in _PAIRS.values())
        if character == "," and depth == 0:
            yield text[begin:place].strip()
            begin = place + 1
    if text[begin:].strip():
        yield text[begin:].strip()


def _spaced(lines: Iterable[str]) -> Iterator[str]:
    """Lines with at most one blank line above what is indented, at most two elsewhere, and none at the end."""
    blank = 0
    for line in lines:
        if not line.strip():
            blank += 1
            continue
        yield from [""] * min(blank, 1 if line.startswith(" ") else 2)
        blank = 0
        yield line
