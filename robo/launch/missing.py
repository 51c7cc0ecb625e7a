"""What a launch needs of this machine and is not there: programs, what nodes ask for, and files that arguments name."""

import importlib.util
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from robo.launch.resolve import Resolution
from robo.text.tree import Problem

_EXTRAS = {
    ("view", "rerun"): ("rerun", "Rerun is not installed: pip install 'robo-zenoh[rerun]'"),
}
"""Verbs of robo that need more than it has: a module, and what to say where it is not there."""


def programs(found: Resolution, search: str) -> list[Problem]:
    """Commands that are not there, or lack something: better said before the rest of the robot runs.

    Args:
        found: the launch.
        search: the folders of programs, as in `PATH`, for a process that has no `PATH` of its own.
    """
    absent = [
        Problem(found.positions[process.full_name], f"{process.full_name}: there is no program {program!r}")
        for process in found.plan.processes
        for program in process.command()[:1]
        if shutil.which(
            str(Path(process.cwd or ".") / program) if "/" in program else program,
            path=process.env.get("PATH", search),
        )
        is None
    ]
    return absent + [
        Problem(found.positions[process.full_name], f"{process.full_name}: {text}")
        for process in found.plan.processes
        for words, (module, text) in _EXTRAS.items()
        if _is_verb(process.command(), words) and importlib.util.find_spec(module) is None
    ]


def _is_verb(command: Sequence[str], words: Sequence[str]) -> bool:
    return bool(command) and Path(command[0]).name == "robo" and tuple(command[1 : 1 + len(words)]) == words


def for_nodes(found: Resolution) -> list[Problem]:
    """What nodes need that is not there, as their classes say."""
    return [
        Problem(found.positions[process.full_name], f"{process.full_name}: {text}")
        for process in found.plan.processes
        for text in found.lacking.get(process.full_name, ())
    ]


def files(found: Resolution) -> list[Problem]:
    """Paths that arguments name, processes are told of, and nothing is at."""
    told = [
        text
        for process in found.plan.processes
        for text in (
            *process.command(),
            *process.env.values(),
            *(value for value in process.parameters.values() if isinstance(value, str)),
        )
    ]
    missing = {
        argument.path: Problem(argument.position, f"argument {argument.name}: there is no file {argument.path}")
        for argument in reversed(found.paths)  # of one that is handed on, the place where it comes from
        if not os.path.exists(argument.path) and any(argument.path in text for text in told)
    }
    return list(missing.values())
