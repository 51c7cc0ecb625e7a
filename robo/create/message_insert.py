"""One more message type in a Python module, as text: every line that is there stays as it is. Pure."""

import ast
import re
import sys
from collections.abc import Sequence

from robo.create.render import message_text
from robo.errors import CreateError

_SHORT = "from robo_messages import Message, message"
_LONG = "import robo_messages"


def with_message(text: str, file: str, package: str, name: str) -> str:
    """The text of a module with one message more, at its end.

    Where the module imports other things than a message needs, `import robo_messages` is added, and the class says
    `robo_messages.Message`: for anything shorter a line that is there would have to change.

    Raises:
        CreateError: the module cannot be read, or has something of this name.
    """
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError) as error:
        raise CreateError(f"{file}:{getattr(error, 'lineno', None) or 1}: this is no Python: {error}") from None
    if text and not text.endswith("\n"):
        raise CreateError(f"{file} does not end with a newline; add one, and call again")
    taken = _defined(tree).get(name)
    if taken is not None:
        raise CreateError(f"{file}:{taken}: {name} is there already")
    block = message_text(package, name)
    imports = [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]
    lines = text.splitlines(keepends=True) if text.strip() else []
    below: list[str] = []
    if not imports:
        below = ["", _SHORT] if lines else [_SHORT]
    elif not _has_short(imports):
        block = block.replace("@message(", "@robo_messages.message(").replace("(Message)", "(robo_messages.Message)")
        if not _has_long(imports):
            place, added = _place(imports, package)
            lines[place:place] = [f"{line}\n" for line in added]
    whole = "".join([*lines, *(f"{line}\n" for line in (*below, "", "")), block])
    return whole.replace("\r\n", "\n").replace("\n", "\r\n") if "\r\n" in text else whole


def _defined(tree: ast.Module) -> dict[str, int]:
    """The names at the top of a module, and of the types that it registers, each with its line."""
    found: dict[str, int] = {}
    for node in tree.body:
        if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
            found.setdefault(node.name, node.lineno)
            for decorator in node.decorator_list:
                said = re.search(r"message\(['\"]\w+/(\w+)['\"]\)", ast.unparse(decorator))
                if said is not None:
                    found.setdefault(said[1], decorator.lineno)
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            for alias in node.names:
                found.setdefault((alias.asname or alias.name).partition(".")[0], node.lineno)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                if isinstance(target, ast.Name):
                    found.setdefault(target.id, node.lineno)
    return found


def _has_short(imports: Sequence[ast.stmt]) -> bool:
    names = {
        alias.name
        for node in imports
        if isinstance(node, ast.ImportFrom) and node.module == "robo_messages" and not node.level
        for alias in node.names
        if alias.asname in (None, alias.name)
    }
    return {"Message", "message"} <= names


def _has_long(imports: Sequence[ast.stmt]) -> bool:
    return any(
        alias.name == "robo_messages" and alias.asname is None
        for node in imports
        if isinstance(node, ast.Import)
        for alias in node.names
    )


def _place(imports: Sequence[ast.Import | ast.ImportFrom], package: str) -> tuple[int, list[str]]:
    """Above which line `import robo_messages` comes, and the lines: among other packages, in the usual order."""
    parts: list[list[ast.Import | ast.ImportFrom]] = [[], [], []]
    for node in imports:
        module = node.names[0].name if isinstance(node, ast.Import) else node.module or ""
        first = module.partition(".")[0]
        own = first == package or (isinstance(node, ast.ImportFrom) and node.level > 0)
        parts[2 if own else 0 if first in sys.stdlib_module_names else 1].append(node)
    before = [node for node in parts[1] if isinstance(node, ast.Import) and node.names[0].name < "robo_messages"]
    if before:
        return before[-1].end_lineno or before[-1].lineno, [_LONG]
    if parts[1]:
        return parts[1][0].lineno - 1, [_LONG]
    if parts[0]:
        return parts[0][-1].end_lineno or parts[0][-1].lineno, ["", _LONG]
    return parts[2][0].lineno - 1, [_LONG, ""]
