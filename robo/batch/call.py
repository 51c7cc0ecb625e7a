"""`python -m robo.batch.call FOLDER`: a run that calls a function, or a command."""

import importlib
import math
import os
import random
import subprocess
import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import msgspec

from robo.batch.plan import Job, Outcome, Value
from robo.errors import UsageError
from robo.text.brief import brief, shown
from robo.text.import_errors import explained
from robo.text.suggestions import suggest
from robo.text.unreadable import UNREADABLE

PASSED = "passed"
"""A word of what a function returns, or a command prints: whether the run has passed."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """What a function is told of its run."""

    recording: Path | None
    """What is looked at; None where the plan has no recordings."""
    said: Path | None = None
    """A recording of what nodes have said in this run; None where none was replayed."""
    parameters: dict[str, Any] = {}
    seed: int | None = None
    folder: Path
    """For files of its own; it goes away with the run."""


def load(word: str) -> Any:
    """The function of `module:function`.

    Raises:
        UsageError: it is not there, or its module cannot be imported.
    """
    module_name, _, name = word.partition(":")
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())  # as nodes are found
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # a user's module may raise anything while it is imported
        raise UsageError(f"{word}: {module_name} cannot be imported: {explained(error)}") from None
    found = getattr(module, name, None)
    if not callable(found):
        known = [one for one, value in vars(module).items() if callable(value) and not one.startswith("_")]
        raise UsageError(f"{word}: {module_name} has no function {name}; {suggest(name, known, 'it has')}")
    return found


def tell_mistake(word: str) -> NoReturn:
    """Print what is wrong with the name of a function, as JSON on the last line, and end this process."""
    mistake = ""
    try:
        load(word)
    except UsageError as error:
        mistake = str(error)
    sys.stdout.write(f"\n{msgspec.json.encode(mistake).decode()}\n")
    sys.stdout.flush()
    os._exit(0)  # whatever the module has started


def call(word: str, run: Run) -> Outcome:
    """Call a function, and take what it returns: figures and words by name.

    A function that raises has failed. One that returns `passed` says by it whether the run has passed.
    """
    if run.seed is not None:
        random.seed(run.seed)
    try:
        returned = load(word)(run)
    except UsageError as error:
        return Outcome(passed=False, reason=str(error))
    except Exception as error:
        traceback.print_exc()
        return Outcome(passed=False, reason=brief(f"{word} raised {type(error).__name__}: {error}", 300))
    return outcome_of({} if returned is None else returned, word)


def outcome_of(returned: object, who: str) -> Outcome:
    """What a function has returned, or a command has printed, as an outcome."""
    if not isinstance(returned, Mapping):
        return Outcome(passed=False, reason=f"{who} returned {shown(returned)}; return a dict of numbers by name")
    metrics: dict[str, Value] = {}
    for name, value in returned.items():
        figure = figure_of(value)
        if not isinstance(name, str) or figure is None:
            return Outcome(passed=False, reason=f"{who}: {shown(name)} is {shown(value)}; use numbers and words")
        metrics[name] = figure
    passed = metrics.pop(PASSED, True)
    if not isinstance(passed, bool):
        return Outcome(passed=False, reason=f"{who}: {PASSED} is {shown(passed)}; use true or false", metrics=metrics)
    return Outcome(passed=passed, reason="" if passed else f"{who} says that it has not passed", metrics=metrics)


def figure_of(value: Any) -> Value | None:
    """A value as a table has it, numbers of numpy's too; None where it is neither a number nor a word."""
    if isinstance(value, (bool, str, int)):
        return value
    if hasattr(value, "item") and not isinstance(value, float):  # numpy's, which is not imported for that
        try:
            return figure_of(value.item())
        except ValueError:  # an array
            return None
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    return None


def run_of(job: Job, folder: Path, said: Path | None = None) -> Run:
    """What a job's function is told."""
    own = folder / "own"
    own.mkdir(exist_ok=True)
    recording = Path(job.work.folder, job.recording) if job.recording else None
    return Run(recording=recording, said=said, parameters=job.parameters, seed=job.seed, folder=own)


def filled(words: tuple[str, ...], job: Job) -> list[str]:
    """A command with what `${recording}`, `${seed}`, `${parameters}` (JSON) and `${NAME}` of a parameter stand for."""
    values = {name: _as_word(value) for name, value in job.parameters.items()}
    values |= {
        "recording": job.recording,
        "seed": "" if job.seed is None else str(job.seed),
        "parameters": msgspec.json.encode(job.parameters).decode(),
    }
    found = []
    for word in words:
        for name, value in values.items():
            word = word.replace(f"${{{name}}}", value)
        found.append(word)
    return found


def _as_word(value: object) -> str:
    return value if isinstance(value, str) else msgspec.json.encode(value).decode()


def _command(job: Job) -> Outcome:
    """Run a command. A last line that is an object of JSON has its figures."""
    command = filled(job.work.command, job)
    try:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
    except OSError as error:
        return Outcome(passed=False, reason=f"{command[0]} cannot be run: {error.strerror}")
    last = b""
    assert process.stdout is not None
    try:
        for line in process.stdout:
            sys.stdout.buffer.write(line)
            sys.stdout.buffer.flush()
            last = line if line.strip() else last
        code = process.wait()
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()
    try:
        outcome = (
            outcome_of(msgspec.json.decode(last), command[0]) if last.lstrip()[:1] == b"{" else Outcome(passed=True)
        )
    except UNREADABLE:
        outcome = Outcome(passed=True)
    if code:
        outcome.passed = False
        outcome.reason = f"{command[0]} ended with exit code {code}"
    return outcome


def _answer(job: Job, folder: Path) -> Outcome:
    return _command(job) if job.work.run == "command" else call(job.work.function, run_of(job, folder))


if __name__ == "__main__":
    from robo.batch.within import answer

    answer(_answer)
