"""From a plan to its jobs, once all that it names is there and fits."""

import os
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

from robo.batch import fingerprint
from robo.batch.check import check
from robo.batch.plan import Job, Plan
from robo.batch.points import jobs
from robo.batch.reader import Places, read
from robo.batch.shelf import RECORDINGS
from robo.errors import UnreadableFile, UsageError
from robo.launch.faults import ManifestFaults
from robo.text.files import read_text
from robo.text.tree import Problem

Tell = Callable[[int, int], None]
"""Takes how many recordings have been looked at, and how many there are."""


def load(file: Path) -> tuple[Plan, Places]:
    """The plan of a file; its runs take place in the file's folder.

    Raises:
        UsageError: it cannot be read.
        ManifestFaults: it has mistakes; has all of them.
    """
    try:
        text = read_text(file)
    except UnreadableFile as error:
        raise UsageError(f"{file}: {error}") from None
    problems: list[Problem] = []
    found = read(text, str(file), str(file.resolve().parent), problems)
    if found is None:
        raise ManifestFaults(problems)
    return found


def prepare(plan: Plan, places: Places, output: Path, tell: Tell = lambda _done, _all: None) -> list[Job]:
    """The jobs of a plan.

    Args:
        plan: what is run.
        places: where things are said.
        output: the folder of results.
        tell: is told how far it is.

    Raises:
        ManifestFaults: what it names is not there, or does not fit; has all mistakes.
    """
    kept = (output / RECORDINGS).resolve()
    problems: list[Problem] = []
    here = os.getcwd()
    with chdir(plan.work.folder):
        checked = check(plan, places, problems)
        if problems:
            raise ManifestFaults(_seen_from(here, problems, places.otherwise.file))
        common = fingerprint.of_work(plan.work, checked.files, checked.modules)
        done = 0

        def determined(recording: str) -> object:
            nonlocal done
            tell(done, len(checked.recordings))
            done += 1
            return [common, recording, fingerprint.of_file(Path(recording)) if recording else ""]

        return jobs(plan, checked.recordings, determined, lambda key: str(kept / f"{key}.mcap"))


def _seen_from(folder: str, problems: list[Problem], own: str) -> list[Problem]:
    """Problems with the names that files have from another folder; the plan's `own` has it already."""
    found = []
    for position, text in problems:
        is_file = position.file != own and os.path.isfile(position.file)
        file = os.path.relpath(position.file, folder) if is_file else position.file
        found.append(Problem(position._replace(file=file), text))
    return found
