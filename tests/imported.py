"""Types that `robo interface import` makes, as modules that are there while a test lasts."""

import importlib
import itertools
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from robo.interfaces.ros_import.made import Made, make
from robo_messages import Message, _registry

_number = itertools.count()


def write(folder: Path, files: Mapping[str, str]) -> Path:
    """Files with their texts, by their paths below a folder."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@contextmanager
def imported(folder: Path, made: Made) -> Iterator[list[ModuleType]]:
    """The modules of what was made, imported; their types are unknown again afterwards."""
    name = f"imported_{next(_number)}"
    names, types = dict(_registry._by_name), dict(_registry._by_type)
    files = (
        {f"{name}.py": made.files[""]} if "" in made.files else {f"{name}/{key}": made.files[key] for key in made.files}
    )
    write(folder, files)
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    try:
        parts = [file[:-3] for file in made.files if file.endswith(".py") and file != "__init__.py"]
        yield [importlib.import_module(f"{name}.{part}" if part else name) for part in parts or [""]]
    finally:
        sys.path.remove(str(folder))
        for module in [one for one in sys.modules if one.partition(".")[0] == name]:
            del sys.modules[module]
        for known in _registry._by_name.keys() - names.keys():
            del _registry._by_name[known]
        for type_ in _registry._by_type.keys() - types.keys():
            del _registry._by_type[type_]


def made_of(folder: Path, files: Mapping[str, str], *, as_folder: bool = False) -> Made:
    """What is made of files."""
    return make([write(folder, files)], None, as_folder=as_folder)


def types_of(modules: Iterable[ModuleType]) -> dict[str, type[Message]]:
    """The registered types of modules, by name."""
    names = {module.__name__ for module in modules}
    return {name: type_ for name, type_ in _registry._by_name.items() if type_.__module__ in names}
