"""Which nodes are meant, and with what they are made: from a manifest, or by the name of their service."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from robo.bag.of_robot import parameters_of, robot_of
from robo.bag.read.reader import Bag
from robo.errors import RoboError, UsageError
from robo.launch.contracts import Question, examine_apart
from robo.launch.faults import ManifestFaults
from robo.launch.find import find_manifest
from robo.launch.meant import nodes_meant, parameters_at
from robo.launch.plan import ProcessPlan
from robo.launch.resolve import Resolution, resolve
from robo.launch.substitution import Word
from robo.node.identity import Identity
from robo.testing.regression.order import NodeOrder
from robo.wire import names

DEFAULT_MANIFEST = "robot.yaml"


class Chosen(NamedTuple):
    """What is to be run."""

    nodes: list[NodeOrder]
    others: dict[str, list[str]] | None
    """By topic, other nodes of the manifest that publish it too; None where there is none."""


def choose(
    recording: Bag,
    words: Sequence[str],
    manifest: str | None,
    robot: str | None,
    arguments: Mapping[str, str],
    parameters: Mapping[str, Any],
    settings: Mapping[str, Any] | None = None,
) -> Chosen:
    """Find the nodes that words mean.

    Args:
        recording: what is replayed.
        words: names, full names, groups of the manifest, or services: `package.module`, `module:Class`; with a
            manifest, those of its nodes.
        manifest: a file, as for `robo up`; None for robot.yaml, of which only classes are taken then where the
            recording says parameters.
        robot: the robot's name; None for the one in the recording.
        arguments: of the manifest.
        parameters: values over all others, of all these nodes.
        settings: values over all others as `NODE.PARAMETER`.

    Raises:
        RoboError: there is no such node, or the manifest has mistakes.
    """
    if not words:
        raise UsageError("say which node: --node position_tracker, or --node my_package.my_module")
    robot = robot if robot is not None else _robot_of(recording)
    said = parameters_of(recording)
    services = [word for word in words if set(".:") & set(word)] if manifest is None else []
    named = [word for word in words if word not in services]
    nodes = [NodeOrder(service=word, namespace=robot or "", recorded=said) for word in services]
    if arguments and not named:
        raise UsageError(f"{next(iter(arguments))}:= is an argument of a manifest; --manifest names one")
    others = None
    if named:
        found = _resolved(manifest, robot, arguments)
        plans = nodes_meant(found.plan, named)
        nodes += [_of_plan(plan, said if manifest is None else {}) for plan in plans]
        others = _others(found, {plan.full_name for plan in plans})
    of_nodes = _of_nodes(nodes, settings or {})
    nodes = [
        msgspec.structs.replace(one, parameters={**one.parameters, **parameters, **own})
        for one, own in zip(nodes, of_nodes, strict=True)
    ]
    return Chosen(nodes, others)


def _of_nodes(nodes: Sequence[NodeOrder], settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What is said of each node by `NODE.PARAMETER`."""
    if not settings:
        return [{} for _ in nodes]
    answers = examine_apart([Question(one.service, {}) for one in nodes if one.name is None])
    unnamed = iter(answers)
    found: list[dict[str, Any]] = []
    taken: set[str] = set()
    for one in nodes:
        contract = None if one.name is not None else next(unnamed).contract
        name = one.name or (contract.name if contract is not None else "")
        own = parameters_at(settings, name, f"/{names.join(one.namespace, name)}")
        taken |= own.keys()
        found.append({parameter: settings[left] for left, parameter in own.items()})
    for left in settings:
        if left not in taken:
            raise UsageError(f"{left} is a parameter of none of these nodes; write NODE.PARAMETER")
    return found


def _robot_of(recording: Bag) -> str | None:
    """The robot of a recording: as it says, or what all its topics begin with."""
    said = robot_of(recording)
    if said is not None:
        return said
    begins = {name.partition("/")[0] for name in recording.topics if "/" in name}
    return begins.pop() if len(begins) == 1 else None


def _of_plan(plan: ProcessPlan, said: Mapping[str, dict[str, Any]]) -> NodeOrder:
    assert plan.service is not None
    recorded = said.get(plan.full_name.strip("/"), {})
    given = {name: value for name, value in plan.parameters.items() if name not in recorded}
    return NodeOrder(
        service=plan.service,
        name=plan.name,
        namespace=plan.namespace,
        parameters=given,
        recorded=dict(said),
        remappings=plan.remap,
        qos=plan.qos,
    )


def _resolved(manifest: str | None, robot: str | None, arguments: Mapping[str, str]) -> Resolution:
    try:
        file = find_manifest(manifest or DEFAULT_MANIFEST)
    except RoboError as error:
        instead = "" if manifest else "; --manifest names one, and --node package.module a node without one"
        raise UsageError(f"{error}{instead}") from None
    given = {name: Word(value) for name, value in arguments.items()}
    found = resolve(Path(file), given, robot=robot)
    if found.problems:
        raise ManifestFaults(found.problems)
    return found


def _others(found: Resolution, chosen: Collection[str]) -> dict[str, list[str]]:
    others: dict[str, list[str]] = {}
    for process in found.plan.processes:
        contract = found.contracts.get(process.full_name)
        if contract is None or process.full_name in chosen:
            continue
        identity = Identity.of(process.name, process.namespace, process.remap)
        for topic in contract.publishers:
            others.setdefault(identity.resolve(topic.topic), []).append(process.full_name)
    return others
