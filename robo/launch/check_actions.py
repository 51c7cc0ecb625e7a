"""Wiring faults of actions: what the contracts of a plan's node classes say of each other. Pure."""

from collections.abc import Iterable

from robo.launch.resolve import Resolution
from robo.text.suggestions import suggest
from robo.text.tree import Problem
from robo.wire import names


def unexecuted(resolution: Resolution, *, all_known: bool) -> Iterable[tuple[Problem, bool]]:
    """The clients of actions that nobody executes, or that somebody executes with other types.

    Args:
        resolution: the plan and its contracts.
        all_known: whether the contracts of all nodes are there.

    Returns:
        Each with whether it is a fault: who executes an action may be no part of this plan.
    """
    executed: dict[str, tuple[str, str]] = {}
    wanted: list[tuple[str, str, str]] = []
    for process in resolution.plan.processes:
        contract = resolution.contracts.get(process.full_name)
        if contract is None:
            continue
        here = {"namespace": process.namespace, "node": process.name}
        for action in contract.actions:
            key = names.resolve(action.action, **here, remappings=process.remap)
            executed[key] = (process.full_name, action.type)
        for client in contract.action_clients:
            key = names.resolve(client.action, **here, remappings=process.remap)
            wanted.append((process.full_name, key, client.type))
    for node, key, type_name in wanted:
        position = resolution.positions[node]
        if key not in executed:
            if all_known:
                text = f"nobody executes {key}, to which {node} sends goals ({type_name})"
                yield Problem(position, f"{text}; {suggest(key, executed)}"), False
        elif executed[key][1] != type_name:
            server, other = executed[key]
            yield (
                Problem(position, f"two types on {key}: {node} sends goals of {type_name}, {server} takes {other}"),
                True,
            )
