"""From a plan to its runs: each recording with each combination of values. Pure."""

import hashlib
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec

from robo.batch.plan import Job, Plan

KEY_LENGTH = 20
"""Hexadecimal digits: 80 bits, so that even of a million runs no two have one by chance."""


def points(plan: Plan) -> Iterator[tuple[dict[str, Any], int | None]]:
    """The values and the seed of each run of a recording: the later keys of `sweep` change first, seeds before all."""
    grid = [dict(zip(plan.sweep, values, strict=True)) for values in itertools.product(*plan.sweep.values())]
    for given in plan.points or ({},):
        for combination in grid:
            for seed in plan.seeds or (None,):
                yield {**plan.parameters, **given, **combination}, seed


def jobs(
    plan: Plan, recordings: Sequence[str], determined: Callable[[str], object], output: Callable[[str], str]
) -> list[Job]:
    """The runs of a plan, in the order of recordings and then of values, each once.

    Args:
        plan: what is run.
        recordings: paths; a plan without any runs once for each combination of values.
        determined: tells of a recording, by its path, all that its results follow from beside values and seed.
        output: by a key, where what nodes have said is kept; empty for nowhere.
    """
    found: dict[str, Job] = {}
    combinations = list(points(plan))
    for recording in recordings or ("",):
        about = determined(recording)
        for parameters, seed in combinations:
            key = key_of([about, parameters, seed])
            job = Job(
                key=key,
                work=plan.work,
                recording=recording,
                parameters=parameters,
                seed=seed,
                output=output(key) if plan.work.keep else "",
            )
            found.setdefault(key, job)
    return list(found.values())


def key_of(determined: object) -> str:
    """A hash of plain data, whatever the order of keys in its maps."""
    data = msgspec.msgpack.encode(determined, order="deterministic")
    return hashlib.blake2b(data).hexdigest()[:KEY_LENGTH]
