"""Comments of ROS's files as docstrings of Python. Pure."""

import re
import textwrap
from collections.abc import Iterable

from robo.interfaces.ros_import.imports import WIDTH


def cleaned(lines: Iterable[str]) -> list[str]:
    """Comments without the blank lines around them and without what all lines are indented by."""
    text = textwrap.dedent("\n".join(re.sub(r"[^\x20-\U0010ffff]", " ", line.expandtabs(4)) for line in lines))
    return [line.rstrip() for line in text.strip("\n").split("\n")] if text.strip() else []


def docstring(lines: list[str], indent: str) -> list[str]:
    """A docstring.

    Args:
        lines: what it says, at least one.
        indent: of the line in which it begins.
    """
    lines = [line.replace('"""', "'''") for line in lines]
    mark = 'r"""' if any("\\" in line for line in lines) else '"""'
    wide = WIDTH - len(indent)
    # The marks of one line alone stand in it, however long it is; a quote at its begin has a space before it.
    gap = " " if lines[0].lstrip().startswith(_QUOTE) else ""
    alone = len(gap) + (len(mark) + 3 if len(lines) == 1 else len(mark))
    first, *rest = [
        *_wrapped(lines[0].lstrip(), wide - alone),
        *(part for line in lines[1:] for part in _wrapped(line, wide)),
    ]
    first = gap + first
    if rest:
        # Formatters take away what all lines but the first are indented by.
        rest = textwrap.dedent("\n".join(rest)).split("\n")
        return [f"{indent}{mark}{first}", *(f"{indent}{line}".rstrip() for line in rest), f'{indent}"""']
    return [f'{indent}{mark}{first}{"." if first.endswith((_QUOTE, _BACKSLASH)) else ""}"""']


_QUOTE, _BACKSLASH = '"', "\\"
"""What must not stand right before the marks at the end."""


def _wrapped(line: str, wide: int) -> list[str]:
    if len(line) <= wide:
        return [line]
    inner = line[: len(line) - len(line.lstrip())]
    kept = textwrap.wrap(
        line, wide, subsequent_indent=inner, break_long_words=False, break_on_hyphens=False, drop_whitespace=True
    )
    return [one.rstrip() for one in kept]
