"""What the files of the folder that one works in are to Python's import."""

import os

from robo.errors import UsageError


def module_of(path: str) -> str:
    """The module as which a file of this folder is imported: `arm/grip.py` to `arm.grip`.

    Raises:
        UsageError: there is no such file, or it does not lie in this folder.
    """
    if not os.path.isfile(path):
        raise UsageError(f"there is no file {path}")
    inside = os.path.relpath(path)
    if inside.startswith(os.pardir):
        folder, name = os.path.split(os.path.abspath(path))
        raise UsageError(f"{path} is not in this folder: cd {folder} and write {name.removesuffix('.py')}")
    return inside.removesuffix(".py").replace(os.sep, ".")


def check_nothing_hides_robo() -> None:
    """Refuse a folder with a `robo.py`: Python looks there first, and no node could import robo.

    A checkout of robo hides nothing: its nodes run from there.

    Raises:
        UsageError: there is one.
    """
    if os.path.isfile(os.path.join("robo", "process", "node.py")):
        return
    for path in ("robo.py", os.path.join("robo", "__init__.py")):
        if os.path.isfile(path):
            raise UsageError(f"{path} in this folder hides the package robo from every node; give it another name")
