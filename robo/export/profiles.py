"""A manifest as other systems can hold it: what always runs, and what an argument adds that is switched on later."""

from collections.abc import Collection, Mapping
from pathlib import Path

import msgspec

from robo.export.placeholders import Placeholders
from robo.launch import resolve
from robo.launch.faults import ManifestFaults
from robo.launch.plan import Plan, ProcessPlan
from robo.launch.resolve import Resolution

ROBOT_VARIABLE = "ROBOT_NAME"
"""The variable that names the robot where the command that exports does not."""


class Profiles(msgspec.Struct, frozen=True):
    """What runs, by the profile that it runs with."""

    always: Plan
    more: dict[str, list[ProcessPlan]]
    """By argument, the processes that it adds."""
    names: Placeholders
    """The words in all of these plans that stand for variables."""
    types: dict[str, dict[str, str]]
    """By full name, the types of the parameters that a node class declares."""


def profiles_of(file: Path, given: Mapping[str, object], robot: str | None, secrets: Collection[str] = ()) -> Profiles:
    """The plan of a manifest, and what each argument that is false by default adds when it is true.

    An argument that changes anything else makes no profile: of its processes none can be switched on by itself.

    Args:
        file: the manifest.
        given: values of its arguments.
        robot: its name; None where it is to be a variable.
        secrets: variables of which no default is to stand in the export.

    Raises:
        ManifestError: the manifest has mistakes.
    """
    names = Placeholders(secrets)

    def read(arguments: Mapping[str, object], robot: str | None) -> Resolution:
        return resolve.resolve(file, arguments, robot=robot, environment=names.environment)

    if robot is None:
        robot = names.word(ROBOT_VARIABLE, _without_faults(read(given, None)).plan.robot)
    found = _without_faults(read(given, robot))
    always, contracts = found.plan, {**found.contracts}
    more: dict[str, list[ProcessPlan]] = {}
    known = {process.full_name: process for process in always.processes}
    for name, value in always.arguments.items():
        if value is not False or name in given:
            continue
        switched = read({**given, name: True}, robot)
        added = _added(always, switched)
        # One that another argument adds as well, and makes something else of, cannot be in both profiles.
        if added and all(known.get(process.full_name, process) == process for process in added):
            more[name] = added
            known |= {process.full_name: process for process in added}
            contracts |= switched.contracts
    types = {full_name: contract.parameter_types for full_name, contract in contracts.items()}
    return Profiles(always, more, names, types)


def _added(always: Plan, switched: Resolution) -> list[ProcessPlan]:
    """The processes that are there beside those of a plan; none where one of those is gone or another one."""
    processes = {process.full_name: process for process in switched.plan.processes}
    if switched.problems or any(processes.pop(process.full_name, None) != process for process in always.processes):
        return []
    return list(processes.values())


def _without_faults(found: Resolution) -> Resolution:
    if found.problems:
        raise ManifestFaults(found.problems)
    return found
