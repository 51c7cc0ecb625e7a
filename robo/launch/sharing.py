"""Nodes that share a process: which one it is, and what they cannot have of their own."""

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from robo.launch.language import Written
from robo.launch.plan import ProcessPlan
from robo.launch.substitution import Complain
from robo.text.tree import Position
from robo.wire import names

_OWN = ("run", "prefix", "args", "cwd", "priority", "cpus")
"""What is said of a process as a whole: one of several nodes cannot say it."""


def process_name(word: str | None, namespace: str) -> str | None:
    """The full name of a process: each robot has its own, whatever the namespace of the node within the robot.

    Args:
        word: what the node says; None or empty for a process of its own.
        namespace: of the node.
    """
    return "/" + names.join(namespace.partition("/")[0], word) if word else None


def check_own(word: str | None, plain: Written, env: Mapping[str, Position], complain: Complain) -> None:
    """What a node says of its process, where that is not its own, is a mistake.

    Args:
        word: the process that it shares; None or empty for one of its own.
        plain: what the node says of how it runs.
        env: its variables, and where each is said.
        complain: takes the mistakes.
    """
    if not word:
        return
    said = {key: plain[key].position for key in _OWN if key in plain}
    if env:
        said["env"] = next(iter(env.values()))
    for key, where in said.items():
        text = "a command cannot share" if key == "run" else f"{key} is for a whole process: a node cannot have it in"
        complain(where, f"{text} the process {word}; process: '' gives this node one of its own")


def check_together(processes: Sequence[tuple[ProcessPlan, Position]], complain: Complain) -> None:
    """Nodes of one process run on the same hosts, and a process is called as no node is.

    Args:
        processes: all of a launch, and where each is said.
        complain: takes the mistakes.
    """
    nodes = {plan.full_name for plan, _ in processes}
    first: dict[str, ProcessPlan] = {}
    for plan, where in processes:
        if plan.process is None:
            continue
        other = first.setdefault(plan.process, plan)
        if other is plan and plan.process in nodes:
            complain(where, f"process {plan.process} has the name of a node; call it something else")
        if plan.limits and other.limits and plan.limits != other.limits:
            text = f"limits: {other.full_name} has other ones for the process {plan.process}, which both share"
            complain(where, f"{plan.full_name}: {text}; say them once, in the group or at one node")
        if plan.limits and not other.limits:
            first[plan.process] = plan
        if {*other.hosts} != {*plan.hosts}:
            text = f"shares the process {plan.process} with {other.full_name}, which is on {_listed(other.hosts)}"
            complain(where, f"{plan.full_name}, on {_listed(plan.hosts)}, {text}")


def with_shared_limits(processes: Sequence[ProcessPlan]) -> list[ProcessPlan]:
    """The same processes; what one node says of the limits of the process that it shares is said of all its nodes."""
    said = {plan.process: plan.limits for plan in processes if plan.process is not None and plan.limits}
    return [msgspec.structs.replace(plan, limits=said.get(plan.process or "", plan.limits)) for plan in processes]


def _listed(hosts: Iterable[str]) -> str:
    return ", ".join(hosts) or "no host"
