"""Words as a unit of systemd takes them."""

import re
from collections.abc import Iterable

_PLAIN = re.compile(r"[A-Za-z0-9_@:/.,+=^~\[\]-]+")


def command(words: Iterable[str]) -> str:
    """A command line: neither a `$` nor a `%` in it stands for anything else."""
    return " ".join(quoted(word.replace("$", "$$")) for word in words)


def quoted(word: str) -> str:
    """A word of a list: within quotes where it would not be one word, or not the same."""
    plain = word.replace("%", "%%")
    if _PLAIN.fullmatch(word.replace("%", "").replace("$", "")) and word:
        return plain
    # systemd takes escapes as C has them.
    text = plain.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return f'"{text}"'


def path(text: str) -> str:
    """A path that stands alone, as `WorkingDirectory=` takes it: no quotes."""
    return text.replace("%", "%%")
