"""From a manifest and arguments to a plan: conditions decided, loops unrolled, includes followed.

Nothing is started and no network is touched. All mistakes are collected; a part with a mistake is
left out, or taken as if it were fine, so that the rest is checked too.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import msgspec

from robo.launch import arguments as args
from robo.launch.draft import Origin
from robo.launch.faults import ManifestFaults, in_order
from robo.launch.plan import Plan
from robo.launch.settle import settle
from robo.launch.substitution import Broken, Environment, of_process
from robo.launch.unfold import Unfolding
from robo.launch.values import Assignment
from robo.node.contract_data import ContractData
from robo.parameters.files import ParameterEntry
from robo.text.tree import Position, Problem


class Resolution(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a manifest."""

    plan: Plan
    problems: tuple[Problem, ...]
    """Mistakes; a plan with any is not to be started."""
    loose: tuple[Problem, ...]
    """What is said and reaches nobody."""
    warnings: tuple[Problem, ...]
    """Where parameter files contradict themselves."""
    contracts: dict[str, ContractData]
    """By full name, what a node's class promises, where that is known."""
    lacking: dict[str, tuple[str, ...]]
    """By full name, what a node needs and this machine does not have, a sentence each."""
    positions: dict[str, Position]
    """By full name, where the node is written."""
    remaps: dict[str, dict[str, Origin]]
    """By full name and left side, where a remapping is written."""
    unmatched: tuple[ParameterEntry, ...]
    """Entries of parameter files that mean no node, not even one that a condition leaves out."""
    paths: tuple[args.PathArgument, ...]
    """What paths the arguments of the manifest and of its includes name."""
    stood_in: tuple[str, ...]
    """Arguments that have to be given and were not."""


def load(
    file: Path,
    arguments: Mapping[str, object],
    *,
    robot: str | None = None,
    groups: Collection[str] = (),
    parameters: Sequence[Assignment] = (),
    host: str | None = None,
) -> Plan:
    """Read a manifest and work out what it starts.

    Args:
        file: the manifest.
        arguments: values for its args; relative paths among them count from the current folder.
        robot: the value of `robot_name`.
        groups: start only these groups; all where empty.
        parameters: values that come before all others.
        host: start only what runs on this host; all where None.

    Raises:
        ManifestFaults: the manifest, its includes or its parameter files have mistakes; has all.
    """
    found = resolve(file, arguments, robot=robot, groups=groups, parameters=parameters, host=host)
    if found.problems:
        raise ManifestFaults(found.problems)
    return found.plan


def resolve(
    file: Path,
    arguments: Mapping[str, object],
    *,
    robot: str | None = None,
    groups: Collection[str] = (),
    parameters: Sequence[Assignment] = (),
    host: str | None = None,
    stand_ins: bool = False,
    environment: Environment = of_process,
) -> Resolution:
    """Like `load`, with the mistakes beside a plan of what could be understood.

    Args:
        file, arguments, robot, groups, parameters, host: as for `load`.
        stand_ins: an argument that has to be given and is not gets a value of its type.
        environment: what variables of the environment are.
    """
    unfolded = Unfolding(environment)
    given = dict(arguments) | ({} if robot is None else {args.ROBOT_NAME: robot})
    manifest = unfolded.manifests.read(file)
    found: dict[str, object] = {args.ROBOT_NAME: given.get(args.ROBOT_NAME, args.DEFAULT_ROBOT)}
    if manifest is not None:
        found = unfolded.arguments(manifest, args.Given(given, Path.cwd(), args.COMMAND_LINE), stand_ins=stand_ins)
        unfolded.unfold(manifest, found)
    settled = settle(unfolded, file, groups, parameters, host)
    return Resolution(
        plan=Plan(
            manifest=str(file),
            description=manifest.description if manifest is not None else "",
            robot=str(found[args.ROBOT_NAME]),
            arguments={name: value for name, value in found.items() if not isinstance(value, Broken)},
            host=host or "",
            processes=tuple(settled.processes),
            topics=tuple(unfolded.topics),
            files=(*unfolded.manifests.paths(), *unfolded.files.paths()),
        ),
        problems=in_order(unfolded.problems),
        loose=in_order(settled.loose),
        warnings=in_order(unfolded.files.warnings()),
        contracts=settled.contracts,
        lacking=settled.lacking,
        positions={draft.plan.full_name: draft.position for draft in settled.drafts},
        remaps={draft.plan.full_name: draft.remap_at for draft in settled.drafts},
        unmatched=tuple(
            entry for entry in unfolded.files.unmatched() if entry.pattern.rpartition("/")[2] not in unfolded.left_out
        ),
        paths=tuple(unfolded.paths),
        stood_in=tuple(args.missing(manifest, given) if manifest is not None else ()),
    )
