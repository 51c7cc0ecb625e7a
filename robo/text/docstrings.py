"""What source code says of its names: the strings below assignments, which Python reads and forgets."""

import ast
import inspect
import re
import textwrap
from collections.abc import Sequence
from itertools import pairwise


def attribute_docs(cls: type[object]) -> dict[str, str]:
    """The strings below the attributes of a class, by attribute; none where its source is not there."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(cls)))
    except (OSError, TypeError, SyntaxError):
        return {}
    return assigned_docs(tree.body[0].body) if tree.body and isinstance(tree.body[0], ast.ClassDef) else {}


def assigned_docs(body: Sequence[ast.stmt]) -> dict[str, str]:
    """The strings below the assignments of a module or class, each as one line, by the name that is assigned."""
    docs = {}
    for said, after in pairwise(body):
        name = assigned_name(said)
        if name and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            text = after.value.value
            if isinstance(text, str):
                docs[name] = " ".join(text.split())
    return docs


def assigned_name(statement: ast.stmt) -> str:
    """The name that a statement assigns; empty where it does something else."""
    targets = statement.targets if isinstance(statement, ast.Assign) else ()
    target = statement.target if isinstance(statement, ast.AnnAssign) else targets[0] if len(targets) == 1 else None
    return target.id if isinstance(target, ast.Name) else ""


def first_sentence(text: str) -> str:
    """The first sentence of a docstring, as one line."""
    paragraph = " ".join(inspect.cleandoc(text).partition("\n\n")[0].split())
    end = re.search(r"\.(?=\s|$)", paragraph)
    return paragraph[: end.end()] if end is not None else paragraph
