"""`${name}`: values put into a manifest.

A scalar that is nothing but one `${name}` takes the value with its type, so `${use_sim}` stays a
bool; within longer text the value becomes text. `$${` stands for a literal `${`.
"""

import difflib
import re
from collections.abc import Mapping

from robo.yaml_tree import Entry, Items, Problem, Scalar, Tree

_PATTERN = re.compile(r"\$\$\{|\$\{([^}]*)\}|\$\{")


def substitute(tree: Tree, values: Mapping[str, object], problems: list[Problem]) -> object:
    """The tree as plain data with every `${name}` in its values replaced."""
    if isinstance(tree, Scalar):
        return substitute_scalar(tree, values, problems)
    if isinstance(tree, Items):
        return [substitute(item, values, problems) for item in tree.items]
    return {entry.key: substitute(entry.value, values, problems) for entry in tree}


def substitute_entries(
    entries: tuple[Entry, ...], values: Mapping[str, object], problems: list[Problem]
) -> dict[str, object]:
    """A map's entries as plain data with every `${name}` in its values replaced."""
    return {entry.key: substitute(entry.value, values, problems) for entry in entries}


def substitute_scalar(scalar: Scalar, values: Mapping[str, object], problems: list[Problem]) -> object:
    """The scalar's value with every `${name}` replaced; unknown names are mistakes."""
    text = scalar.value
    if not isinstance(text, str) or "${" not in text:
        return text

    def value_of(match: re.Match[str]) -> object:
        if match.group(0) == "$${":
            return "${"
        name = match.group(1)
        if name is None:
            problems.append(Problem(scalar.position, f"{text!r}: '${{' is never closed; write $${{ for a literal one"))
            return ""
        if name in values:
            return values[name]
        close = difflib.get_close_matches(name, values, n=1)
        known = f"did you mean ${{{close[0]}}}?" if close else f"known are {', '.join(sorted(values)) or 'none'}"
        problems.append(Problem(scalar.position, f"${{{name}}} is not defined; {known}"))
        return ""

    whole = _PATTERN.fullmatch(text)
    if whole is not None:
        return value_of(whole)
    return _PATTERN.sub(lambda match: _as_text(value_of(match)), text)


def _as_text(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else str(value)
