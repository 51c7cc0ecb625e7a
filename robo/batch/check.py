"""What can be known of a plan before anything is started: whether all that it names is there, and fits.

Nodes and functions are imported in processes of their own.
"""

from __future__ import annotations

import glob
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from robo import bag as bags
from robo.bag.of_robot import robot_of
from robo.bag.regression.tolerances import load as load_tolerances
from robo.batch.plan import Plan
from robo.batch.points import points
from robo.batch.reader import Places
from robo.errors import BagError, ManifestError, UsageError
from robo.launch.contracts import Question, examine_apart
from robo.launch.find import find_manifest
from robo.launch.meant import nodes_meant, parameters_at
from robo.launch.resolve import Resolution, resolve
from robo.launch.substitution import Word
from robo.text.suggestions import suggest
from robo.text.tree import Problem
from robo.wire import names

_MANIFEST = "robot.yaml"
"""That nodes are found in where none is named."""
_IMPORT = 60.0
"""How long the import of a function may take, s."""


class Checked(NamedTuple):
    """What was found."""

    recordings: list[str]
    """Paths, from the work's folder, each once, in the order of the patterns and then of names."""
    files: list[str]
    """What results follow from beside recordings and code: manifests, files of parameters and of tolerances."""
    modules: list[str]
    """Of nodes and functions."""


class _Node(NamedTuple):
    name: str
    full_name: str
    service: str
    values: Mapping[str, Any]


def check(plan: Plan, places: Places, problems: list[Problem]) -> Checked:
    """Look at what a plan names, from the current folder, which is the work's.

    Args:
        plan: what is to be run.
        places: where things are said.
        problems: gets what is wrong.
    """
    checker = _Checker(plan, places, problems)
    recordings = checker.recordings()
    files = checker.tolerances()
    modules = checker.functions()
    if plan.work.nodes:
        more, services = checker.nodes(recordings)
        files, modules = files + more, modules + services
    return Checked(recordings, files, list(dict.fromkeys(module.partition(":")[0] for module in modules)))


class _Checker:
    def __init__(self, plan: Plan, places: Places, problems: list[Problem]) -> None:
        self._plan = plan
        self._work = plan.work
        self._places = places
        self._problems = problems

    def recordings(self) -> list[str]:
        found: dict[str, None] = {}
        for number, pattern in enumerate(self._plan.recordings):
            meant = sorted(glob.glob(os.path.expanduser(pattern), recursive=True))
            if not meant:
                self._complain(f"there is no recording {pattern}", "recordings", number)
            found |= dict.fromkeys(meant)
        return list(found)

    def tolerances(self) -> list[str]:
        work = self._work
        if work.tolerances is None and not work.ignore:
            return []
        try:
            load_tolerances(work.tolerances, work.ignore)
        except UsageError as error:
            self._complain(str(error), "tolerances" if work.tolerances is not None else "ignore")
        return [work.tolerances] if work.tolerances is not None else []

    def functions(self) -> list[str]:
        found = []
        for key, word in (("function", self._work.function), ("score", self._work.score)):
            if word:
                found.append(word)
                mistake = _import_apart(word)
                if mistake:
                    self._complain(mistake, key)
        return found

    def nodes(self, recordings: Sequence[str]) -> tuple[list[str], list[str]]:
        """The files that say how nodes are made, and their services."""
        work = self._work
        services = [word for word in work.nodes if set(".:") & set(word)] if work.manifest is None else []
        named = [word for word in work.nodes if word not in services]
        robot = work.robot if work.robot is not None else next(_robots(recordings), None)
        made: list[_Node] = []
        files: list[str] = []
        if named:
            resolution = self._resolved(robot)
            if resolution is None:
                return [], services
            files = [*resolution.plan.files]
            try:
                meant = nodes_meant(resolution.plan, named)
            except UsageError as error:
                self._complain(str(error), "nodes")
                return files, services
            made = [_Node(one.name, one.full_name, one.service or "", one.parameters) for one in meant]
        elif work.arguments:
            self._complain("arguments are those of a manifest; manifest: names one", "arguments")
        made += self._of_services(services, robot or "")
        self._check_values(made)
        return files, [one.service for one in made]

    def _resolved(self, robot: str | None) -> Resolution | None:
        work = self._work
        try:
            file = find_manifest(work.manifest or _MANIFEST)
        except ManifestError as error:
            self._complain(str(error), "manifest" if work.manifest is not None else "nodes")
            return None
        found = resolve(file, {name: Word(value) for name, value in work.arguments.items()}, robot=robot)
        self._problems += found.problems
        return None if found.problems else found

    def _of_services(self, services: Sequence[str], namespace: str) -> Iterator[_Node]:
        answers = examine_apart([Question(service, {}) for service in services])
        for service, answer in zip(services, answers, strict=True):
            if answer.contract is None:
                self._complain(answer.error or "", "nodes", self._work.nodes.index(service))
            else:
                name = answer.contract.name
                yield _Node(name, f"/{names.join(namespace, name)}", service, {})

    def _check_values(self, nodes: Sequence[_Node]) -> None:
        """Whether nodes have the parameters that are set, and take their values."""
        lefts = dict.fromkeys([*self._plan.parameters, *self._plan.sweep, *(n for p in self._plan.points for n in p)])
        own = [parameters_at(lefts, one.name, one.full_name) for one in nodes]
        unknown = [left for left in lefts if not any(left in one for one in own)]
        for left in unknown:
            known = suggest(left.partition(".")[0], [one.name for one in nodes], "they are")
            self._complain(f"{left} is a parameter of none of these nodes: {known}", *self._path(left))
        told: set[tuple[object, ...]] = set()
        for one, mine in zip(nodes, own, strict=True):
            asked = [{mine[left]: value} for left, value in self._values() if left in mine]
            meant = [(left, value) for left, value in self._values() if left in mine]
            answers = examine_apart([Question(one.service, {**one.values, **values}) for values in asked])
            for (left, value), values, answer in zip(meant, asked, answers, strict=True):
                (parameter,) = values
                mistake = answer.mistakes.get(parameter)
                if answer.contract is not None and mistake is None:
                    mistake = _unknown(parameter, answer.contract.parameter_types, one.name)
                if mistake is not None and (left, repr(value)) not in told:
                    told.add((left, repr(value)))
                    self._complain(mistake, *self._path(left, value))

    def _values(self) -> Iterator[tuple[str, Any]]:
        """All that parameters are set to, each once."""
        seen: set[tuple[str, str]] = set()
        for parameters, _ in points(self._plan):
            for left, value in parameters.items():
                if (left, repr(value)) not in seen:
                    seen.add((left, repr(value)))
                    yield left, value

    def _path(self, left: str, value: object = None) -> tuple[object, ...]:
        """Where a parameter is said, or one of its values."""
        if left in self._plan.sweep:
            values = list(map(repr, self._plan.sweep[left]))
            return ("sweep", left, values.index(repr(value))) if repr(value) in values else ("sweep", left)
        for number, point in enumerate(self._plan.points):
            if left in point and (value is None or repr(point[left]) == repr(value)):
                return ("points", number, left)
        return ("parameters", left)

    def _complain(self, text: str, *path: object) -> None:
        position = self._places.at(*path)
        self._problems += [Problem(position, line) for line in text.split("\n")]


def _unknown(parameter: str, types: Mapping[str, str], node: str) -> str | None:
    from robo.parameters.shape import declared_as

    if declared_as(parameter, types) is not None:
        return None
    return f"{node} has no parameter {parameter}; {suggest(parameter, types, 'it has')}"


def _robots(recordings: Sequence[str]) -> Iterator[str]:
    """The robots that recordings say."""
    for path in recordings:
        try:
            with bags.open(path) as recording:
                robot = robot_of(recording)
        except BagError:
            continue  # its runs will say so
        if robot is not None:
            yield robot


def _import_apart(word: str) -> str:
    """What is wrong with the name of a function; empty where nothing is."""
    code = "import sys; from robo.batch.call import tell_mistake; tell_mistake(sys.argv[1])"
    try:
        asked = subprocess.run(
            [sys.executable, "-c", code, word],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_IMPORT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"{word}: its module is not imported within {_IMPORT:g} s"
    if asked.returncode:
        return f"{word}: its module ends the process that imports it"
    return msgspec.json.decode(asked.stdout.splitlines()[-1], type=str)
