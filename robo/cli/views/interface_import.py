"""`robo interface import`: ROS's definitions as Python, printed or written."""

import ast
import os
from collections.abc import Sequence
from pathlib import Path

import msgspec

from robo.cli.printing import amount, note, print_json, print_text, write_file
from robo.errors import UnreadableFile, UsageError
from robo.interfaces.ros_import.made import Made, make
from robo.interfaces.ros_import.module import MADE
from robo.text.files import read_text


def import_types(paths: Sequence[Path], *, output: Path | None, package: str | None, json: bool) -> None:
    """Make message types of ROS's definitions.

    Args:
        paths: of files, of packages, of workspaces.
        output: a file that ends with `.py`, or the folder of a package; None to print.
        package: of files that are in none.
        json: whether to print what is made as JSON Lines; without `output` nothing else is done.

    Raises:
        InterfaceError: all that is wrong with the definitions.
        UsageError: there is another file in the place of one that is to be written.
    """
    as_folder = output is not None and output.suffix != ".py"
    made = make(paths, package, as_folder=as_folder)
    for sentence in made.differing:
        note(sentence)
    if output is not None:
        _write(made, output)
    if json:
        for type_ in made.types:
            print_json(msgspec.to_builtins(type_) | {"file": _file_of(type_.file, output)})
    elif output is None and made.files:
        print_text(made.files[""].removesuffix("\n"))
    note(_summary(made, output))


def _file_of(name: str, output: Path | None) -> str | None:
    return None if output is None else str(output / name)


def _write(made: Made, output: Path) -> None:
    files = {output / name: text for name, text in made.files.items()}
    in_the_way = [str(file) for file in files if not _is_made(file)]
    if in_the_way:
        fix = "write elsewhere, or remove what is there"
        raise UsageError(f"{', '.join(in_the_way)}: it was not {MADE} and is not written over; {fix}")
    for file, text in files.items():
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"{file.parent} cannot be made: {error.strerror}") from None
        write_file(text, file)


def _is_made(file: Path) -> bool:
    """Whether a file may be written: there is none, it was made like this, or it says nothing but what it is for."""
    if not os.path.exists(file) or file.name == "py.typed":  # one that may not be looked for is told by the writing
        return True
    try:
        tree = ast.parse(read_text(file))
    except (UnreadableFile, SyntaxError, ValueError):
        return False
    about = ast.get_docstring(tree)
    if about is None:
        return not tree.body
    return len(tree.body) == 1 or MADE in " ".join(about.split())


def _summary(made: Made, output: Path | None) -> str:
    own = amount(len(made.types), "type")
    there = f" in {output}" if output is not None and made.files else ""
    shipped = f"; robo has {', '.join(made.shipped)} already" if made.shipped else ""
    return f"{own}{there}{shipped}"
