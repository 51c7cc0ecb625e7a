"""One more key in a map of a YAML file, as text: every line that is there stays as it is. Pure.

What follows the file's own habits: how far it indents, whether a blank line stands between keys, how lines end. The new
text is read again and compared, so that what cannot be done safely is refused and not done badly.
"""

import json
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import yaml

from robo.errors import CreateError
from robo.text.tree import Map, Problem, plain
from robo.text.yaml_tree import masked, parse


class Style(NamedTuple):
    """How a map is written."""

    step: int
    """Columns by which a map within one of its keys is indented."""
    inline: bool
    """Whether the value of its last key is a map in braces."""


Entry = Callable[[Style], Sequence[str]]
"""Makes the lines of a new entry, each without the indentation of the map that it comes into."""


def inserted(text: str, file: str, path: Sequence[str], key: str, entry: Entry) -> str:
    """The text with one key more at the end of a map.

    Args:
        text: of the whole file, its line ends as they are.
        file: what to call it.
        path: the keys that lead to the map; none for the outermost.
        key: the new one.
        entry: makes its lines.

    Raises:
        CreateError: the map is not there, has the key, or is written in a way that cannot be added to safely.
    """
    before = _data(text, file)
    there: Any = before
    for step in path:
        there = there.get(step) if isinstance(there, dict) else None
    if isinstance(there, dict) and key in there:
        raise CreateError(f"{file}: {'.'.join([*path, key])} is there already")
    root = yaml.compose(masked(text), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # as it was just read
    if root is None:
        new = _at_end(text, "\n".join(entry(Style(2, inline=False))), file)
    else:
        new = _in_map(text, _map_at(root, path, file), file, entry)
    wanted = json.loads(json.dumps(before))
    inner = wanted
    for step in path:
        inner = inner[step]
    after = _data(new, file)
    given: Any = after
    for step in path:
        given = given.get(step, {})
    inner[key] = given.get(key)
    if inner[key] is None or json.dumps(wanted, sort_keys=True) != json.dumps(after, sort_keys=True):
        raise CreateError(f"{file}: {key} cannot be added without changing what is there; add it by hand")
    return new


def _data(text: str, file: str) -> dict[str, object]:
    """What a file says, as plain data.

    Raises:
        CreateError: it has mistakes, or is no map.
    """
    problems: list[Problem] = []
    tree = parse(text, file, problems, placeholders=True)
    if problems or not isinstance(tree, Map):
        said = "\n".join(map(str, problems)) or f"{file} holds no map"
        raise CreateError(said)
    data = plain(tree)
    assert isinstance(data, dict)
    return data


def _map_at(node: yaml.Node, path: Sequence[str], file: str) -> yaml.MappingNode:
    """The map that keys lead to.

    Raises:
        CreateError: it is not there, or is not written as lines of their own.
    """
    where = file
    for step in path:
        pairs = node.value if isinstance(node, yaml.MappingNode) else []
        found = next(((key, value) for key, value in pairs if key.value == step), None)
        if found is None:
            raise CreateError(f"{where} has no {step}; add it by hand")
        key, node = found
        where = f"{file}:{key.start_mark.line + 1}: {step}"
        if node.start_mark.index < key.end_mark.index:
            raise CreateError(f"{where} is an alias of something else; add to it by hand")
    if not isinstance(node, yaml.MappingNode):
        raise CreateError(f"{where} is no map; add to it by hand")
    if node.flow_style or not node.value:
        raise CreateError(f"{where} is written in braces; write each of its keys in a line of its own, and call again")
    return node


def _in_map(text: str, node: yaml.MappingNode, file: str, entry: Entry) -> str:
    first, (last_key, last_value) = node.value[0][0], node.value[-1]
    column = first.start_mark.column
    children = [value for _, value in node.value if isinstance(value, yaml.MappingNode) and value.value]
    steps = [child.value[0][0].start_mark.column - column for child in children if not child.flow_style]
    inline = isinstance(last_value, yaml.MappingNode) and bool(last_value.flow_style)
    lines = entry(Style(max(steps[-1:] or [2]), inline))
    block = "\n".join(f"{' ' * column}{line}" if line else "" for line in lines)
    own_line = _line_start(text, last_key.start_mark.index)
    own_indent = text[own_line : last_key.start_mark.index]
    above = _above_comments(text, own_line)
    spaced = len(node.value) > 1 and bool(re.search(r"\n[ \t]*\r?\n\Z", text[:above]))
    end = _below_comments(text, _line_end(text, _end(last_value, last_key.end_mark.index, text)), column)
    if end < len(text) or text.endswith("\n"):
        return _put(text, end, ("\n" if spaced else "") + block + "\n")
    # The file's last line has no end, and would be another one if it got one: the new key goes above the last one.
    if own_indent.strip():
        raise CreateError(f"{file} does not end with a newline; add one, and call again")
    return _put(text, above, block + "\n" + ("\n" if spaced else ""))


def _at_end(text: str, block: str, file: str) -> str:
    """A first key in a file that has none, below its comments."""
    if text and not text.endswith("\n"):
        raise CreateError(f"{file} does not end with a newline; add one, and call again")
    return _put(text, len(text), block + "\n")


def _put(text: str, place: int, block: str) -> str:
    """Whole lines at the start of a line; they end as the others do."""
    ends = "\r\n" if "\r\n" in text else "\n"
    return text[:place] + block.replace("\n", ends) + text[place:]


def _end(node: yaml.Node, begin: int, text: str) -> int:
    """Where the text of a value ends; the end of a whole block has blank lines and comments in it, its parts' not.

    Args:
        node: the value.
        begin: where it begins at the earliest; an alias stands there for something further above.
        text: of the file.
    """
    if node.start_mark.index < begin:
        return begin
    if not isinstance(node, yaml.CollectionNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    if isinstance(last, tuple):
        return _end(last[1], last[0].end_mark.index, text)
    if last.start_mark.index < node.start_mark.index:
        return len(text[: node.end_mark.index].rstrip())
    return _end(last, node.start_mark.index, text)


def _line_start(text: str, index: int) -> int:
    return text.rfind("\n", 0, index) + 1


def _line_end(text: str, index: int) -> int:
    """The start of the line below; a block of text ends in the line above its end mark."""
    if index > 0 and text[index - 1] == "\n":
        index -= 1
    end = text.find("\n", index)
    return len(text) if end < 0 else end + 1


def _below_comments(text: str, start: int, column: int) -> int:
    """Past the comments that stand directly below, as far in as the map's keys or further."""
    while (found := re.compile(r"([ ]*)#[^\n]*(\n|\Z)").match(text, start)) and len(found[1]) >= column:
        start = found.end()
        if not found[2]:
            break
    return start


def _above_comments(text: str, start: int) -> int:
    """The start of the comments that stand directly above a line."""
    while start > 0:
        above = _line_start(text, start - 1)
        if not text[above:start].lstrip(" ").startswith("#"):
            break
        start = above
    return start
