"""Variables in commands of containers: `$(NAME)`, and `"$NAME"` where a shell reads them."""

import shlex

from robo.export.placeholders import Placeholders, Variable

SETTINGS = "settings"
"""The ConfigMap with the values of variables, and the Secret with those that are one's own secret."""


class Variables:
    """The variables of one export; those that a container uses are in its environment."""

    def __init__(self, names: Placeholders, secrets: frozenset[str]) -> None:
        """
        Args:
            names: the words that stand for them.
            secrets: those that come from a Secret.
        """
        self._names = names
        self._secrets = secrets
        self.used: dict[str, Variable] = {}
        """By name."""
        self._here: set[str] = set()

    def shown(self, text: str) -> str:
        """A text of a command or of the environment: Kubernetes fills in variables, and other dollars are kept."""
        return "".join(
            part.replace("$", "$$") if isinstance(part, str) else f"$({self._use(part)})"
            for part in self._names.parts(text)
        )

    def probe(self, commands: list[list[str]]) -> list[str]:
        """Commands of which each has to end well, in which Kubernetes fills in nothing: a shell does where it has to.

        Args:
            commands: one or several, their words as `shown` gives them.
        """
        *first, last = commands
        if not first and not any("$(" in word.replace("$$", "") for word in last):
            return [word.replace("$$", "$") for word in last]
        lines = [" ".join(map(self._for_shell, words)) for words in commands]
        return ["sh", "-c", " && ".join([*lines[:-1], f"exec {lines[-1]}"])]

    @property
    def here(self) -> frozenset[str]:
        """The variables that have been used since `environment` was asked last."""
        return frozenset(self._here)

    def environment(self) -> list[dict[str, object]]:
        """The variables that have been used since this was asked last: those of a container. They come first in it."""
        here, self._here = sorted(self._here), set()
        return [{"name": name, "valueFrom": self._from(name)} for name in here]

    @property
    def settings(self) -> dict[str, str]:
        """The values that are known, for the ConfigMap."""
        return {
            name: one.default
            for name, one in sorted(self.used.items())
            if one.default is not None and name not in self._secrets
        }

    @property
    def unknown(self) -> list[str]:
        """Variables of which somebody has to say what they are."""
        return sorted(name for name, one in self.used.items() if one.default is None and name not in self._secrets)

    @property
    def secret(self) -> list[str]:
        """Variables that have to be in the Secret."""
        return sorted(self.used.keys() & self._secrets)

    def _use(self, variable: Variable) -> str:
        known = self.used.get(variable.name)
        if known is None or known.default is None:
            self.used[variable.name] = variable
        self._here.add(variable.name)
        return variable.name

    def _from(self, name: str) -> dict[str, object]:
        kind = "secretKeyRef" if name in self._secrets else "configMapKeyRef"
        return {kind: {"name": SETTINGS, "key": name}}

    def _for_shell(self, word: str) -> str:
        found: list[str] = []
        rest = word
        while rest:
            if rest.startswith("$$"):
                found.append(shlex.quote("$"))
                rest = rest[2:]
            elif rest.startswith("$("):
                name, _, rest = rest[2:].partition(")")
                found.append(f'"${name}"')
            else:
                text, dollar, behind = rest.partition("$")
                found.append(shlex.quote(text))
                rest = dollar + behind
        return "".join(found) or "''"
