"""A plan by words of a command line: `--sweep NODE.NAME=10,20,50`, `--metric NAME=TOPIC:FIELD:TAKE`. Pure."""

import re
from collections.abc import Sequence
from typing import Any

from robo.batch.plan import TAKES, Metric
from robo.errors import ParameterError, UsageError
from robo.interfaces.parts import Field
from robo.parameters.words import parse_value
from robo.text.brief import shown
from robo.text.choices import choice_of
from robo.text.suggestions import suggest

_OPEN, _CLOSED = "[{", "]}"


def parameters(words: Sequence[str]) -> dict[str, Any]:
    """Values by name, of words `NAME=VALUE`.

    Raises:
        UsageError: a word is no such thing.
    """
    return {name: _value("--set", value) for name, value in _sides("--set", "NODE.PARAMETER=VALUE", words)}


def sweep(words: Sequence[str]) -> dict[str, tuple[Any, ...]]:
    """Several values by name, of words `NAME=VALUE,VALUE`; a comma within brackets, braces or quotes separates none.

    Raises:
        UsageError: a word is no such thing, or has a value twice.
    """
    found: dict[str, tuple[Any, ...]] = {}
    for name, text in _sides("--sweep", "NODE.PARAMETER=VALUE,VALUE", words):
        values = [_value("--sweep", part) for part in split(text)]
        twice = [value for number, value in enumerate(values) if repr(value) in map(repr, values[:number])]
        if twice:
            raise UsageError(f"--sweep {name}: {shown(twice[0])} stands twice")
        found[name] = tuple(values)
    return found


def seeds(text: str) -> tuple[int, ...]:
    """Seeds, of `1,2,5` or `1-20`.

    Raises:
        UsageError: it is no such thing.
    """
    found: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,9})(?:\s*-\s*(\d{1,9}))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match is not None else (1, 0)
        if not 0 <= last - first < 1_000_000:
            raise UsageError(f"--seeds {shown(text)}: write whole numbers, for example 1,2,5 or 1-20")
        found += range(first, last + 1)
    return tuple(dict.fromkeys(found))


def metrics(words: Sequence[str]) -> dict[str, Metric]:
    """Numbers that are taken of topics, of words `NAME=TOPIC:FIELD` or `NAME=TOPIC:FIELD:TAKE`.

    Raises:
        UsageError: a word is no such thing.
    """
    found: dict[str, Metric] = {}
    for name, text in _sides("--metric", "NAME=TOPIC:FIELD[:TAKE]", words):
        topic, _, rest = text.partition(":")
        field, colon, word = rest.partition(":")
        take = choice_of(word, TAKES) if colon else "last"
        if not topic or not field:
            raise UsageError(f"--metric {name}: write NAME=TOPIC:FIELD, for example x=odom:pose.pose.position.x")
        if take is None:
            raise UsageError(f"--metric {name}: there is no {shown(word)}; {suggest(word, TAKES)}")
        Field(field)
        found[name] = Metric(topic, field, take)
    return found


def split(text: str) -> list[str]:
    """The parts of a text between its commas, but for those within brackets, braces and quotes."""
    parts, depth, quote = [""], 0, ""
    for character in text:
        if character == "," and not depth and not quote:
            parts.append("")
            continue
        parts[-1] += character
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        else:
            depth = max(0, depth + (character in _OPEN) - (character in _CLOSED))
    return parts


def _sides(option: str, form: str, words: Sequence[str]) -> list[tuple[str, str]]:
    found: dict[str, str] = {}
    for word in words:
        name, sign, value = word.partition("=")
        name = name.removesuffix(":")  # as in a launch: NAME:=VALUE
        if not name or not sign or not value:
            raise UsageError(f"{option} {shown(word)}: write {form}")
        if name in found:
            raise UsageError(f"{option}: {name} is said twice")
        found[name] = value
    return list(found.items())


def _value(option: str, text: str) -> object:
    if not text.strip():
        raise UsageError(f"{option}: a value is missing between two commas")
    try:
        return parse_value(text)
    except ParameterError as error:
        raise UsageError(f"{option}: {error}") from None
