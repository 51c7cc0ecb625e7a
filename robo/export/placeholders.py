"""Names that are known only when the exported file is used: the robot's name, variables of the environment.

While a plan is worked out a word stands in for each of them; in the exported text it becomes `${NAME:-default}`.
"""

import re

_WORD = re.compile(r"zz_robo_(\d+)_zz")


class Placeholders:
    """The words that stand in for variables."""

    def __init__(self) -> None:
        self._variables: list[tuple[str, str | None]] = []

    def word(self, variable: str, default: str | None) -> str:
        """A word for a variable: a valid name, so that it may stand wherever the value may."""
        known = (variable, default)
        if known not in self._variables:
            self._variables.append(known)
        return f"zz_robo_{self._variables.index(known)}_zz"

    def environment(self, variable: str, default: str | None) -> str | None:
        """What `${env:NAME}` in a manifest is: a word, or the default where that is no text."""
        from robo.parameters.words import parse_value

        if default is not None and not isinstance(parse_value(default), str):
            return default
        return self.word(variable, default)

    def holds(self, text: str) -> bool:
        """Whether a text has a word in it."""
        return _WORD.search(text) is not None

    def shown(self, text: str) -> str:
        """A text for a file in which `$` begins a variable: words are variables, other dollars are kept."""
        parts = _WORD.split(text.replace("$", "$$"))
        return "".join(part if i % 2 == 0 else self._variable(int(part)) for i, part in enumerate(parts))

    def without(self, text: str) -> str:
        """A text with the words left out."""
        return _WORD.sub("", text)

    def parted(self, path: str) -> tuple[str, str]:
        """The folder that a manifest has put before a path's first word, and the path from that word on."""
        match = _WORD.search(path)
        return (path, "") if match is None else (path[: match.start()], path[match.start() :])

    def _variable(self, number: int) -> str:
        variable, default = self._variables[number]
        return f"${{{variable}}}" if default is None else f"${{{variable}:-{default}}}"
