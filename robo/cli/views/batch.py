"""`robo batch`: having a plan run, showing how far it is, and printing what came of it."""

from __future__ import annotations

import os
import re
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robo.batch import table, words
from robo.batch.conduct import conduct, missing
from robo.batch.engine import Engine
from robo.batch.plan import Job, Plan, Result, Work
from robo.batch.prepare import load, prepare
from robo.batch.progress import Progress
from robo.batch.reader import FUNCTION, Places
from robo.batch.shelf import CSV, JSON_LINES, Shelf
from robo.cli.ending import ended_by_signals
from robo.cli.printing import amount, note, paint, print_json, print_line, print_table
from robo.errors import UsageError
from robo.launch.arguments import COMMAND_LINE
from robo.launch.faults import ManifestFaults, as_text
from robo.text import colours
from robo.text.terminal import own, visible

if TYPE_CHECKING:
    from robo.cli.batch_words import BatchWords, NodeWords, Varied

LOCAL = "local"
"""The engine without Ray."""
_PERIOD = 0.5
"""How often the line of progress is written anew, s."""


def run_plan(file: Path, how: BatchWords) -> int:
    """Run the plan of a file; the exit code.

    Raises:
        UsageError: it has mistakes, or words make no sense.
    """
    try:
        plan, places = load(file)
    except ManifestFaults as error:
        raise _mistakes(error) from None
    return _run(plan, places, how)


def run_replays(
    recordings: Sequence[str],
    how: BatchWords,
    nodes: NodeWords,
    varied: Varied,
    *,
    metrics: Sequence[str],
    score: str,
    keep: bool,
) -> int:
    """Replay recordings, and measure what nodes say; the exit code.

    Raises:
        UsageError: words make no sense.
    """
    more = {"metrics": words.metrics(metrics), "score": _function("--score", score), "keep": keep}
    return _run_words("replay", recordings, how, varied, {**_of_nodes(nodes), **more})


def run_tests(
    recordings: Sequence[str],
    how: BatchWords,
    nodes: NodeWords,
    varied: Varied,
    *,
    tolerances: str | None,
    ignore: Sequence[str],
) -> int:
    """Replay recordings, and compare what nodes say with them; the exit code.

    Raises:
        UsageError: words make no sense.
    """
    more = {"tolerances": tolerances, "ignore": tuple(ignore)}
    return _run_words("replay-test", recordings, how, varied, {**_of_nodes(nodes), **more})


def run_calls(function: str, recordings: Sequence[str], how: BatchWords, varied: Varied) -> int:
    """Call a function with recordings; the exit code.

    Raises:
        UsageError: words make no sense.
    """
    return _run_words("function", recordings, how, varied, {"function": _function("MODULE:FUNCTION", function)})


def _of_nodes(nodes: NodeWords) -> dict[str, Any]:
    if not nodes.node:
        raise UsageError("say which node: --node position_tracker, or --node my_package.my_module")
    return {
        "nodes": tuple(nodes.node),
        "manifest": nodes.manifest,
        "robot": nodes.robot_name,
        "patience": nodes.patience,
    }


def _function(option: str, word: str) -> str:
    if word and not re.fullmatch(FUNCTION, word):
        raise UsageError(f"{option} {word}: write package.module:function")
    return word


def _run_words(run: Any, recordings: Sequence[str], how: BatchWords, varied: Varied, more: Mapping[str, Any]) -> int:
    plan = Plan(
        work=Work(run=run, folder=os.getcwd(), timeout=varied.limit, **more),
        recordings=tuple(recordings),
        parameters=words.parameters(varied.sets or []),
        sweep=words.sweep(varied.sweep or []),
        seeds=words.seeds(varied.seeds) if varied.seeds is not None else (),
        attempts=varied.attempts,
    )
    twice = plan.parameters.keys() & plan.sweep.keys()
    if twice:
        raise UsageError(f"{min(twice)}: --set or --sweep, one of them")
    return _run(plan, Places({}, COMMAND_LINE), how)


def _run(plan: Plan, places: Places, how: BatchWords) -> int:
    line = _Line()
    try:
        jobs = prepare(plan, places, how.output, lambda done, total: line.show(f"recording {done + 1} of {total}"))
    except ManifestFaults as error:
        raise _mistakes(error) from None
    finally:
        line.clear()
    if how.dry_run:
        for job in jobs:
            print_json({"key": job.key, **_asked(job)}) if how.json else print_line(f"{job.key}  {job.label}")
        return 0
    shelf = Shelf(how.output)
    if how.address is not None and how.engine == LOCAL:
        raise UsageError("--address names a cluster of Ray's; --engine local is this machine")
    with shelf.held(), ended_by_signals():
        there = shelf.there(jobs)
        gone = [key for key, result in there.items() if how.again or (how.retry and not result.passed)]
        shelf.forget(gone)
        for key in gone:
            del there[key]
        rows = [*_conducted(jobs, there, shelf, plan.attempts, how).values()]
        shelf.write_table(rows)
    _print(rows, how)
    return 0 if all(row.passed for row in rows) else 1


def _conducted(
    jobs: Sequence[Job], there: Mapping[str, Result], shelf: Shelf, attempts: int, how: BatchWords
) -> dict[str, Result]:
    """The results of all jobs by key, in their order."""
    to_run = missing(jobs, there)
    found: dict[str, Result] = {}
    if to_run:
        teller = _Teller(len(jobs), there)
        with teller, closing(_engine(how, len(to_run))) as engine:
            found = conduct(to_run, engine, shelf, attempts, teller)
    every = {**there, **found}
    return {job.key: every[job.key] for job in jobs}


def _engine(how: BatchWords, count: int) -> Engine:
    workers = min(how.workers or os.cpu_count() or 1, count)
    if how.engine == LOCAL:
        from robo.batch.local import Local

        return Local(workers)
    from robo.batch.on_ray import Ray

    return Ray(workers, how.address)


def _print(rows: Sequence[Result], how: BatchWords) -> None:
    if how.json:
        for row in rows:
            print_json(row)
        return
    head, *lines = table.shown(rows)
    at = head.index("PASSED")
    painted = [[*one[:at], _painted(one[at]), *one[at + 1 :]] for one in lines]
    print_table([head, *painted])
    for text in table.as_lines(rows):
        print_line(text)
    failed = sum(not row.passed for row in rows)
    print_line(
        f"{amount(len(rows), 'run')}: {len(rows) - failed} passed, {failed} failed; "
        f"{how.output / CSV}, {how.output / JSON_LINES}"
    )


def _painted(word: str) -> str:
    return paint(word, colours.GREEN if word == "passed" else colours.RED)


def _asked(job: Job) -> dict[str, Any]:
    return {"recording": job.recording, "parameters": job.parameters, "seed": job.seed}


def _mistakes(error: ManifestFaults) -> UsageError:
    return UsageError(f"{as_text(error.faults)}\n{amount(len(error.faults), 'mistake')}; nothing is started")


class _Teller:
    """Tells how far it is: on a terminal by a line that is written anew, and elsewhere of what goes wrong."""

    def __init__(self, total: int, there: Mapping[str, Result]) -> None:
        failed = sum(not result.passed for result in there.values())
        self._progress = Progress(total, time.monotonic(), there=len(there), failed=failed)
        self._line = _Line()
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._tick, name="robo-batch-progress", daemon=True)

    def __enter__(self) -> _Teller:
        if there := self._progress.there:
            note(f"{amount(there, 'result')} there already, {self._progress.left} to run")
        if self._line.is_on:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._line.is_on:
            self._thread.join()
        self._line.clear()

    def ended(self, result: Result) -> None:
        """A run has a result, which is kept."""
        self._progress.done += 1
        if not result.passed:
            self._progress.failed += 1
            self._note(f"failed: {result.label}: {result.reason}")

    def again(self, job: Job, reason: str) -> None:
        """A run is begun anew."""
        self._progress.again += 1
        self._note(f"begun anew: {job.label}: {reason}")

    def _note(self, text: str) -> None:
        with self._lock:
            self._line.clear()
            note(visible(text.partition("\n")[0]))

    def _tick(self) -> None:
        while not self._over.wait(_PERIOD):
            with self._lock:
                self._line.show(self._progress.sentence(time.monotonic()))


class _Line:
    """The last line of a terminal, written anew; elsewhere nothing."""

    def __init__(self) -> None:
        self.is_on = sys.stderr.isatty()
        self._shown = ""

    def show(self, text: str) -> None:
        """Have it say something."""
        if self.is_on and text != self._shown:
            self._shown = text
            sys.stderr.write(own("\r\x1b[K") + text)
            sys.stderr.flush()

    def clear(self) -> None:
        """Have it say nothing."""
        if self._shown:
            self.show("")
