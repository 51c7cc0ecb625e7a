"""A node class's contract, for people and as plain data."""

from collections.abc import Sequence

import msgspec

import robo_messages
from robo.node.contract import ClientDeclaration, Contract, ServiceDeclaration


def contract_text(contract: Contract) -> str:
    """What a node subscribes, publishes, serves and calls, and how it is tuned."""
    sections = {
        "subscribes": [(s.topic, robo_messages.type_name(s.message_type)) for s in contract.subscriptions],
        "publishes": [(p.topic, robo_messages.type_name(p.message_type)) for p in contract.publishers],
        "services": [(s.service, _service_type(s)) for s in contract.services],
        "calls": [(c.service, _service_type(c)) for c in contract.clients],
        "timers": [(t.method, t.rate if isinstance(t.rate, str) else f"{t.rate:g} Hz") for t in contract.timers],
    }
    lines = []
    for title, rows in sections.items():
        if rows:
            lines += [f"{title}:", *_table(rows)]
    if contract.parameters:
        width = max(len(p.name) for p in contract.parameters)
        lines.append("parameters:")
        lines += [f"  {p.name:{width}} {p.default!r:8} {p.about}".rstrip() for p in contract.parameters]
    return "\n".join(lines)


def contract_data(contract: Contract) -> dict[str, object]:
    """The same as plain data."""
    return {
        "name": contract.name,
        "description": contract.description,
        "publishers": [
            {"topic": p.topic, "type": robo_messages.type_name(p.message_type), "depth": p.depth}
            for p in contract.publishers
        ],
        "subscriptions": [
            {"topic": s.topic, "type": robo_messages.type_name(s.message_type), "depth": s.depth}
            for s in contract.subscriptions
        ],
        "services": [{"service": s.service, "type": _service_type(s)} for s in contract.services],
        "clients": [{"service": c.service, "type": _service_type(c), "timeout": c.timeout} for c in contract.clients],
        "timers": [{"method": t.method, "rate": t.rate} for t in contract.timers],
        "parameters": msgspec.to_builtins(contract.parameters),
    }


def _service_type(declared: ServiceDeclaration | ClientDeclaration) -> str:
    return robo_messages.service_type_name(declared.request_type, declared.response_type)


def _table(rows: Sequence[tuple[str, str]]) -> list[str]:
    width = max(18, *(len(row[0]) for row in rows))
    return [f"  {left:{width}} {right}" for left, right in rows]
