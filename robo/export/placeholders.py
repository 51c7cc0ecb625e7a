"""Names that are known only when the exported file is used: the robot's name, variables of the environment.

While a plan is worked out a word stands in for each of them; in the exported text it becomes `${NAME:-default}`.
"""

import re
from collections.abc import Collection, Sequence
from typing import NamedTuple

_WORD = re.compile(r"zz_robo_(\d+)_zz")


class Variable(NamedTuple):
    """What is known only when the exported file is used."""

    name: str
    default: str | None


class Placeholders:
    """The words that stand in for variables."""

    def __init__(self, always: Collection[str] = ()) -> None:
        """
        Args:
            always: variables that are words even where their default is no text, since nobody may see it.
        """
        self._always = always
        self._variables: list[Variable] = []

    @property
    def variables(self) -> Sequence[Variable]:
        """All variables that there is a word for."""
        return tuple(self._variables)

    def word(self, variable: str, default: str | None) -> str:
        """A word for a variable: a valid name, so that it may stand wherever the value may."""
        known = Variable(variable, default)
        if known not in self._variables:
            self._variables.append(known)
        return f"zz_robo_{self._variables.index(known)}_zz"

    def environment(self, variable: str, default: str | None) -> str | None:
        """What `${env:NAME}` in a manifest is: a word, or the default where that is no text."""
        from robo.parameters.words import parse_value

        if default is not None and variable not in self._always and not isinstance(parse_value(default), str):
            return default
        return self.word(variable, default)

    def holds(self, text: str) -> bool:
        """Whether a text has a word in it."""
        return _WORD.search(text) is not None

    def shown(self, text: str) -> str:
        """A text for a file in which `$` begins a variable: words are variables, other dollars are kept."""
        return "".join(
            part.replace("$", "$$") if isinstance(part, str) else _of_compose(part) for part in self.parts(text)
        )

    def parts(self, text: str) -> list[str | Variable]:
        """What a text consists of: texts, and variables between them."""
        parts = _WORD.split(text)
        return [part if i % 2 == 0 else self._variables[int(part)] for i, part in enumerate(parts)]

    def without(self, text: str) -> str:
        """A text with the words left out."""
        return _WORD.sub("", text)

    def parted(self, path: str) -> tuple[str, str]:
        """The folder that a manifest has put before a path's first word, and the path from that word on."""
        match = _WORD.search(path)
        return (path, "") if match is None else (path[: match.start()], path[match.start() :])


def _of_compose(variable: Variable) -> str:
    name, default = variable
    return f"${{{name}}}" if default is None else f"${{{name}:-{default}}}"
