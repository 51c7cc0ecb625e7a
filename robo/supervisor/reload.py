"""Which files a run depends on, and which of them have changed."""

import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from importlib.machinery import PathFinder

import msgspec

from robo.launch.plan import Plan, ProcessPlan
from robo.text.tree import Position


class FileWatch:
    """Notices changed files by the time of their last change."""

    def __init__(self) -> None:
        self._times: dict[str, int | None] = {}

    def changed(self, files: Mapping[str, Iterable[str]]) -> dict[str, set[str]]:
        """Whose files have changed since the last call, and which; a file that is new here has not."""
        found: dict[str, set[str]] = {}
        seen: dict[str, int | None] = {}
        for owner, paths in files.items():
            for path in paths:
                if path not in seen:
                    seen[path] = _time_of(path)
                if path in self._times and seen[path] is not None and self._times[path] != seen[path]:
                    found.setdefault(owner, set()).add(path)
        # A file that is gone for a moment, while an editor replaces it, is not forgotten.
        self._times = {path: at if at is not None else self._times.get(path) for path, at in seen.items()}
        return found


def files_of(plan: Plan | ProcessPlan) -> list[str]:
    """The files that a plan was made of; for a process, its module, and what it is given in parameters or as words."""
    if isinstance(plan, Plan):
        return sorted(plan.files)
    given = [*plan.parameters.values(), *(plan.command() if plan.service is None else ())]
    folder = plan.cwd or os.getcwd()
    paths = {os.path.join(folder, text) for text in given if isinstance(text, str) and text}
    if plan.service is not None:
        paths |= {_module_file(plan.service.partition(":")[0]) or ""}
    return sorted(path for path in paths if os.path.isfile(path) and os.access(path, os.R_OK))


@lru_cache
def _module_file(name: str) -> str | None:
    """Where a module is, found without importing anything: one that cannot be imported is watched too."""
    places: Sequence[str] | None = [os.getcwd(), *sys.path]
    spec = None
    parts = name.split(".")
    for end in range(1, len(parts) + 1):
        spec = PathFinder.find_spec(".".join(parts[:end]), places) if places else None
        places = spec.submodule_search_locations if spec is not None else None
    return spec.origin if spec is not None and not str(spec.origin).startswith((sys.prefix, sys.base_prefix)) else None


def same(one: ProcessPlan, other: ProcessPlan) -> bool:
    """Whether two plans of a process do the same, wherever it is written."""
    return _essence(one) == _essence(other)


def _essence(plan: ProcessPlan) -> object:
    return msgspec.structs.replace(plan, source=Position("", 0, 0), sources={}, settings={}), plan.parameters


def _time_of(path: str) -> int | None:
    try:
        return os.stat(path).st_mtime_ns
    except OSError:
        return None
