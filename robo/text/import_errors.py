"""What went wrong while a user's module was imported: where in his own files, and what to write instead."""

import ast
import os
import re
import sysconfig
import traceback
from types import TracebackType

import msgspec

import robo_messages
from robo.errors import UnreadableFile
from robo.text.brief import brief
from robo.text.files import read_text

_UNSAFE = re.compile(r"\((?P<value>.*)\) as a default value is unsafe", re.DOTALL)
"""What msgspec says of a default that all instances would share."""

_ROBO = os.path.dirname(os.path.dirname(__file__))
_OWN = tuple(
    folder + os.sep for folder in (_ROBO, *(os.path.dirname(str(m.__file__)) for m in (robo_messages, msgspec)))
)
_LIBRARY = sysconfig.get_path("stdlib") + os.sep


def explained(error: BaseException) -> str:
    """What an exception says that was raised while a module was imported, after the place in the user's files.

    For example `messages.py:7: header: Header = Header() would be one and the same object in all of them; …`.
    """
    if isinstance(error, SyntaxError) and error.filename and error.lineno:
        column = f":{error.offset}" if error.offset else ""
        return f"{_near(error.filename)}:{error.lineno}{column}: {error.msg}"
    place = _place(error.__traceback__)
    if isinstance(error, TypeError) and place is not None:
        default = _shared_default(*place, str(error))
        if default is not None:
            return default
    where = f"{_near(place[0])}:{place[1]}: " if place is not None else ""
    kind = "" if isinstance(error, (ImportError, msgspec.ValidationError)) else f"{type(error).__name__}: "
    return f"{where}{kind}{error}"


def place_of(error: BaseException) -> str | None:
    """Where in the user's files an exception comes from: `messages.py:7`; None where it comes from nowhere there."""
    place = _place(error.__traceback__)
    return f"{_near(place[0])}:{place[1]}" if place is not None else None


def _place(trace: TracebackType | None) -> tuple[str, int] | None:
    """File and line of the innermost frame that is the user's."""
    frames = [(frame.filename, frame.lineno or 1) for frame in traceback.extract_tb(trace)]
    foreign = [place for place in frames if not place[0].startswith("<") and not place[0].startswith(_OWN)]
    theirs = [place for place in foreign if "site-packages" in place[0] or not place[0].startswith(_LIBRARY)]
    # An installed library may raise what a line of the user has caused.
    nearest = [place for place in theirs if "site-packages" not in place[0]]
    return next(iter((nearest or theirs)[::-1]), None)


def _shared_default(file: str, line: int, text: str) -> str | None:
    """The field whose default msgspec refuses, with its line and what to write; None where it is not that."""
    unsafe = _UNSAFE.search(text)
    if unsafe is None:
        return None
    try:
        whole = read_text(file)
        tree = ast.parse(whole)
    except (UnreadableFile, ValueError, SyntaxError):
        return None
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef) and _holds(node, line)]
    for statement in max(classes, key=lambda node: node.lineno).body if classes else ():
        if isinstance(statement, ast.AnnAssign) and statement.value is not None:
            factory = _factory(statement.value, unsafe["value"])
            if factory is not None:
                return (
                    f"{_near(file)}:{statement.lineno}: {brief(ast.unparse(statement), 100)} would be one and the same "
                    f"object in all of them; write field(default_factory={factory}), with `from msgspec import field`"
                )
    return None


def _factory(written: ast.expr, value: str) -> str | None:
    """What makes a new default each time; None where what is written is not that value, given as Python shows it."""
    if isinstance(written, ast.Call):
        name = ast.unparse(written.func)
        if not value.startswith(f"{name.rpartition('.')[2]}("):
            return None
        return f"lambda: {ast.unparse(written)}" if written.args or written.keywords else name
    held = written.keys if isinstance(written, ast.Dict) else getattr(written, "elts", ())
    mutable = isinstance(written, (ast.List, ast.Dict, ast.Set)) and held and value[:1] in "[{"
    return f"lambda: {ast.unparse(written)}" if mutable else None


def _holds(node: ast.ClassDef, line: int) -> bool:
    first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
    return first <= line <= (node.end_lineno or line)


def _near(file: str) -> str:
    """A path as people want to read it: relative where it lies in the current folder."""
    inside = os.path.relpath(file)
    return file if inside.startswith(os.pardir) else inside
