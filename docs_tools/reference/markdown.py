"""Markdown that GitHub and a site generator read alike. Pure."""

import inspect
import re
from collections.abc import Iterable, Sequence


class Gap(Exception):
    """Something that the reference lists has no description, or no unit."""


def described(text: str, what: str) -> str:
    """A description.

    Raises:
        Gap: there is none.
    """
    if not text.strip():
        raise Gap(f"{what} has no description; say in the code what it is, and its unit where it has one")
    return text


def sentence(text: str) -> str:
    """A description that is no sentence as one: the first letter large, a full stop at the end."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith(('.', '…')) else '.'}"


def code(text: object) -> str:
    """Something literal, also within a table; nothing for nothing."""
    plain = str(text)
    if "|" in plain or "`" in plain:
        for sign, written in (("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ("|", "&#124;"), ("`", "&#96;")):
            plain = plain.replace(sign, written)
        return f"<code>{plain}</code>"
    return f"`{plain}`" if plain else ""


def prose(text: str) -> str:
    """A text of the code: what is between backticks stays, other signs that mean something in Markdown are shown."""
    parts = re.split(r"(`[^`]*`)", " ".join(text.split()))
    return "".join(part if part.startswith("`") else _plain(part) for part in parts)


def _plain(text: str) -> str:
    for sign, written in (("<", "&lt;"), (">", "&gt;"), ("*", "\\*"), ("|", "\\|")):
        text = text.replace(sign, written)
    return text


def paragraphs(docstring: str) -> list[str]:
    """A docstring's paragraphs; one that is set in by some spaces is shown as it is."""
    found: list[str] = []
    for part in inspect.cleandoc(docstring).split("\n\n"):
        lines = part.splitlines()
        if lines and all(line.startswith("    ") for line in lines):
            found += [block("\n".join(line[4:] for line in lines), "text"), ""]
        elif lines:
            found += [prose(part), ""]
    return found


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table, and an empty line; nothing where it has no rows. Columns in which nothing stands are left out."""
    whole = list(rows)
    used = [number for number in range(len(header)) if any(row[number] for row in whole)]
    kept = [[row[number] for number in used] for row in [header, *whole]]
    lines = [f"| {' | '.join(row)} |".replace("|  |", "| |").replace("|  |", "| |") for row in kept]
    return [lines[0], "|" + "---|" * len(used), *lines[1:], ""] if whole else []


def block(text: str, language: str) -> str:
    """A block of code."""
    return f"```{language}\n{text}\n```"


def anchor(heading: str) -> str:
    """What a heading is called in links."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def link(text: str, heading: str, page: str = "") -> str:
    """A link to a heading, of another page or of this one."""
    return f"[{text}]({page}#{anchor(heading)})"
