"""`robo batch`: many recordings and parameters at once."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli.batch_words import BatchWords, NodeWords, Recordings, Varied
from robo.cli.tree import group
from robo.cli.verb import verb

verbs = group()

_Score = Annotated[
    str | None,
    typer.Option(
        "--score", metavar="MODULE:FUNCTION", help="A function of yours that gives more numbers.", show_default=False
    ),
]


@verb(
    verbs,
    "run",
    "robo batch run batch.yaml -o results",
    "robo batch run batch.yaml -o results --dry-run",
    "robo batch run batch.yaml -o results --engine local --workers 1",
    short_help="Run what a plan says: a file in YAML.",
)
def batch_run(plan: Annotated[Path, typer.Argument(metavar="PLAN", help="The plan.")], how: BatchWords) -> int:
    """Run a plan: what is run, on which recordings, with which parameters and seeds.

    All mistakes in it are told with file, line and column before anything starts. Results that are in the folder
    already are not run again: each is kept under a hash of its recording, nodes, manifest, parameters and seed.
    Every run is a process of its own, in bounded time; one that dies is begun anew, three times at most.

    Exit code: 0 all passed, 1 a run failed, 2 a plan or words that make no sense, 130 Ctrl-C.
    """
    from robo.cli.views.batch import run_plan

    return run_plan(plan, how)


@verb(
    verbs,
    "replay",
    "robo batch replay 'recordings/*.mcap' --node position_tracker -o results",
    "robo batch replay drive.mcap --node position_tracker --sweep position_tracker.max_distance=10,20,50 -o results",
    "robo batch replay drive.mcap --node position_tracker --metric z=current_position:z -o results",
    short_help="Replay recordings to nodes, and measure what they say.",
)
def batch_replay(
    recordings: Recordings,
    how: BatchWords,
    nodes: NodeWords,
    varied: Varied,
    metric: Annotated[
        list[str] | None,
        typer.Option("--metric", metavar="NAME=TOPIC:FIELD[:TAKE]", help="A number: last, first, min, max, mean, …"),
    ] = None,
    score: _Score = None,
    keep: Annotated[bool, typer.Option("--keep", help="Keep what nodes said, as recordings.")] = False,
) -> int:
    """Replay each recording to nodes in lock step, as robo replay-test does, and put what came of it into one table.

    A result has how many messages went in and came out, and, where nodes or the recording say poses, distance (m), and
    the last x, y (m) and heading (rad). --metric takes a number of a topic, what nodes said before what was recorded;
    --score calls a function of yours with the run. A run fails where a node raises, hangs or dies.

    Exit code: 0 all passed, 1 a run failed, 2 words that make no sense, 130 Ctrl-C.
    """
    from robo.cli.views.batch import run_replays

    return run_replays(recordings, how, nodes, varied, metrics=metric or [], score=score or "", keep=keep)


@verb(
    verbs,
    "replay-test",
    "robo batch replay-test reference.mcap --node position_tracker -o results",
    "robo batch replay-test reference.mcap --node position_tracker --tolerances tolerances.yaml -o results",
    short_help="Replay recordings to nodes, and compare what they say now.",
)
def batch_replay_test(
    recordings: Recordings,
    how: BatchWords,
    nodes: NodeWords,
    varied: Varied,
    tolerances: Annotated[
        str | None, typer.Option("--tolerances", metavar="FILE", help="What may differ, and by how much, as YAML.")
    ] = None,
    ignore: Annotated[
        list[str] | None,
        typer.Option("--ignore", metavar="[TOPIC:]FIELD", help="A field that does not count: header.stamp."),
    ] = None,
) -> int:
    """Do what robo replay-test does with each recording, and put the verdicts into one table.

    Exit code: 0 all as recorded, 1 a run failed, 2 words that make no sense, 130 Ctrl-C.
    """
    from robo.cli.views.batch import run_tests

    return run_tests(recordings, how, nodes, varied, tolerances=tolerances, ignore=ignore or [])


@verb(
    verbs,
    "call",
    "robo batch call my_robot.scores:length 'recordings/*.mcap' -o results",
    "robo batch call my_robot.scores:length drive.mcap --sweep window=1,2,5 --seeds 1-3 -o results",
    short_help="Call a function of yours with recordings.",
)
def batch_call(
    function: Annotated[str, typer.Argument(metavar="MODULE:FUNCTION", help="It takes a robo.batch.Run.")],
    how: BatchWords,
    varied: Varied,
    recordings: Annotated[
        list[str] | None, typer.Argument(metavar="[RECORDING...]", help="Recordings, or patterns of them in quotes.")
    ] = None,
) -> int:
    """Call a function with each recording and each combination of values, in a process of its own.

    It gets a robo.batch.Run (recording, parameters, seed, a folder) and returns a dict of numbers and words; `passed`
    among them says whether the run has passed. What it starts has a port of its own: ROBO_LISTEN and ROBO_CONNECT.

    Exit code: 0 all passed, 1 a run failed, 2 words that make no sense, 130 Ctrl-C.
    """
    from robo.cli.views.batch import run_calls

    return run_calls(function, recordings or [], how, varied)
