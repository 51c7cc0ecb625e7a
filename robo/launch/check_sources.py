"""Whose messages alone count: a name that no publisher of the topic has, so that nothing would ever be obeyed."""

import re
from collections.abc import Iterable, Mapping, Sequence

from robo.launch.plan import ProcessPlan
from robo.launch.resolve import Resolution
from robo.node.message_info import PLAIN
from robo.text.suggestions import suggest
from robo.text.tree import Position, Problem
from robo.wire import names

_PLACE = re.compile(r"(.+):(\d+):(\d+)")


def position_of(process: ProcessPlan, parameter: str) -> Position | None:
    """Where the value of a parameter is written; None where that is in no file."""
    settings = process.settings.get(parameter)
    place = _PLACE.fullmatch(settings[-1].source) if settings else None
    return Position(place[1], int(place[2]), int(place[3])) if place is not None else None


def unheard(resolution: Resolution, publishers: Mapping[str, Sequence[str]]) -> Iterable[Problem]:
    """The subscriptions that take the messages of a node alone which does not publish their topic.

    Args:
        resolution: of the manifest.
        publishers: full names of the nodes that publish a topic, by key.
    """
    for process in resolution.plan.processes:
        contract = resolution.contracts.get(process.full_name)
        if contract is None:
            continue
        defaults = {info.name: info.default for info in contract.parameters}
        for topic in contract.subscriptions:
            parameter = topic.sole_source
            wanted = process.parameters.get(parameter, defaults.get(parameter, ""))
            key = names.resolve(topic.topic, namespace=process.namespace, node=process.name, remappings=process.remap)
            there = publishers.get(key, ())
            if not isinstance(wanted, str) or wanted in ("", PLAIN) or not there:
                continue  # nobody is named, or who publishes it is said elsewhere
            if names.absolute(wanted, process.namespace) not in there:
                position = position_of(process, parameter) or resolution.positions[process.full_name]
                text = f"{process.full_name} takes {key} of {wanted} alone ({parameter}), which does not publish it"
                yield Problem(position, f"{text}; {suggest(wanted, [name.rpartition('/')[2] for name in there])}")
