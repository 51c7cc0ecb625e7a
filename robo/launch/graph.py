"""The graph of a launch, nodes and topics, in forms that other tools draw."""

from collections.abc import Sequence

import msgspec

from robo.launch.check import End
from robo.launch.plan import Plan

FORMATS = ("mermaid", "dot", "json")


def draw(plan: Plan, ends: Sequence[End], form: str) -> str:
    """The graph in one of `FORMATS`."""
    return {"mermaid": _mermaid, "dot": _dot, "json": _json}[form](plan, ends)


def _topics(ends: Sequence[End]) -> dict[str, list[str]]:
    """The types on each key."""
    found: dict[str, list[str]] = {}
    for end in ends:
        types = found.setdefault(end.key, [])
        if end.type not in types:
            types.append(end.type)
    return found


def _mermaid(plan: Plan, ends: Sequence[End]) -> str:
    nodes = {p.full_name: f"n{i}" for i, p in enumerate(plan.processes)}
    topics = {key: f"t{i}" for i, key in enumerate(_topics(ends))}
    lines = ["flowchart LR"]
    lines += [f'  {node}["{name}"]' for name, node in nodes.items()]
    lines += [f'  {topics[key]}(["{key}<br/>{" / ".join(types)}"])' for key, types in _topics(ends).items()]
    lines += [
        f"  {nodes[end.node]} --> {topics[end.key]}"
        if end.kind == "publishes"
        else f"  {topics[end.key]} --> {nodes[end.node]}"
        for end in ends
    ]
    return "\n".join(lines)


def _dot(plan: Plan, ends: Sequence[End]) -> str:
    lines = ["digraph robot {", "  rankdir=LR;"]
    lines += [f'  "{p.full_name}" [shape=box];' for p in plan.processes]
    lines += [
        f'  "{key}" [shape=ellipse, label="{key}\\n{" / ".join(types)}"];' for key, types in _topics(ends).items()
    ]
    lines += [
        f'  "{end.node}" -> "{end.key}";' if end.kind == "publishes" else f'  "{end.key}" -> "{end.node}";'
        for end in ends
    ]
    return "\n".join([*lines, "}"])


def _json(plan: Plan, ends: Sequence[End]) -> str:
    data = {
        "nodes": [{"name": p.full_name, "service": p.service, "group": p.group} for p in plan.processes],
        "topics": [
            {
                "key": key,
                "types": types,
                "publishers": [end.node for end in ends if end.key == key and end.kind == "publishes"],
                "subscribers": [end.node for end in ends if end.key == key and end.kind == "subscribes"],
            }
            for key, types in _topics(ends).items()
        ],
    }
    return msgspec.json.format(msgspec.json.encode(data)).decode()
