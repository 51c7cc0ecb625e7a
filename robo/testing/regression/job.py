"""`python -m robo.testing.regression.job FOLDER`: a run of a batch that replays a recording to nodes.

A `replay` runs them once, in this process, and measures what they have said. A `replay-test` judges it.
"""

import os
import random
import shutil
import sys
from pathlib import Path

from robo import bag as bags
from robo.bag.regression.report import ReplayReport, Trouble, lines, verdict_line
from robo.batch import call, measures
from robo.batch.plan import Job, Outcome
from robo.batch.within import answer
from robo.errors import RoboError
from robo.testing.regression.chosen import choose
from robo.testing.regression.judge import Request, judge
from robo.testing.regression.order import RunOrder, RunResult
from robo.testing.regression.run import run


def main() -> None:
    """Do what is asked."""
    answer(_done)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # a thread of a node that hangs holds nobody


def _done(job: Job, folder: Path) -> Outcome:
    try:
        return _judged(job) if job.work.run == "replay-test" else _replayed(job, folder)
    except RoboError as error:
        print(error)
        return Outcome(passed=False, reason=str(error))


def _replayed(job: Job, folder: Path) -> Outcome:
    work, said_file = job.work, folder / "said.mcap"
    with bags.open(job.recording) as recording:
        chosen = choose(recording, work.nodes, work.manifest, work.robot, work.arguments, {}, job.parameters)
    if job.seed is not None:
        random.seed(job.seed)
    order = RunOrder(
        bag=job.recording,
        nodes=chosen.nodes,
        output=str(said_file),
        others=chosen.others,
        patience=work.patience,
    )
    result = run(order, lambda _line: None)
    for note in result.notes:
        print(f"note: {note}")
    if result.troubles:
        return _failed(result.troubles)
    outcome = _measured(job, folder, said_file, result)
    if job.output:
        part = Path(job.output).with_name(f".{Path(job.output).name}.part")
        shutil.copyfile(said_file, part)
        part.replace(job.output)
    return outcome


def _measured(job: Job, folder: Path, said_file: Path, result: RunResult) -> Outcome:
    with bags.open(job.recording) as recording, bags.open(said_file) as said:
        metrics = {
            "messages": sum(one.count for one in result.inputs),
            "said": said.count,
            "duration": round(recording.duration, 9),
            **measures.standard(said, recording),
            **measures.asked(job.work.metrics, said, recording),
        }
    if not job.work.score:
        return Outcome(passed=True, metrics=metrics)
    scored = call.call(job.work.score, call.run_of(job, folder, said_file))
    scored.metrics = {**metrics, **scored.metrics}
    return scored


def _judged(job: Job) -> Outcome:
    work = job.work
    request = Request(
        bag=job.recording,
        nodes=[*work.nodes],
        manifest=work.manifest,
        robot=work.robot,
        arguments=work.arguments,
        settings=job.parameters,
        tolerances=work.tolerances,
        ignored=[*work.ignore],
        runs=work.runs,
        patience=work.patience,
    )
    report = judge(request)
    for line in lines(report):
        print(line)
    if report.verdict == "failed":
        return _failed(report.troubles)
    return Outcome(passed=report.fine, reason="" if report.fine else verdict_line(report), metrics=_figures(report))


def _figures(report: ReplayReport) -> dict[str, float | int | bool | str]:
    return {
        "verdict": report.verdict,
        "messages": sum(one.count for one in report.inputs),
        "compared": sum(one.compared for one in report.topics),
        "differing": sum(one.trouble for one in report.topics),
        "duration": round(report.duration, 9),
    }


def _failed(troubles: list[Trouble]) -> Outcome:
    for one in troubles:
        print(f"{one.node}: {one.text}")
    first = troubles[0]
    died = any(one.ended_by == "SIGKILL" for one in troubles)  # a node does other things to itself
    return Outcome(passed=False, reason=f"{first.node}: {next(iter(first.text.splitlines()), '')}", died=died)


if __name__ == "__main__":
    main()
