"""A node class's contract, for people and as plain data."""

from collections.abc import Sequence

import robo_messages
from robo.node.contract import ClientDeclaration, ServiceDeclaration, contract_of
from robo.node.contract_data import ClientData, ContractData, ServiceData, TimerData, TopicData
from robo.node.declare import Declares


def contract_data(cls: type[Declares]) -> ContractData:
    """All that a node class declares, as plain data.

    Raises:
        ContractError: as `contract_of`.
    """
    contract = contract_of(cls)
    type_name = robo_messages.type_name
    return ContractData(
        class_name=f"{cls.__module__}:{cls.__qualname__}",
        name=contract.name,
        description=contract.description,
        publishers=tuple(TopicData(p.topic, type_name(p.message_type), p.depth) for p in contract.publishers),
        subscriptions=tuple(TopicData(s.topic, type_name(s.message_type), s.depth) for s in contract.subscriptions),
        services=tuple(ServiceData(s.service, _service_type(s)) for s in contract.services),
        clients=tuple(ClientData(c.service, _service_type(c), c.timeout) for c in contract.clients),
        timers=tuple(TimerData(t.method, t.rate) for t in contract.timers),
        parameters=contract.parameters,
    )


def contract_text(contract: ContractData) -> str:
    """What a node subscribes, publishes, serves and calls, and how it is tuned."""
    sections = {
        "subscribes": [(s.topic, s.type) for s in contract.subscriptions],
        "publishes": [(p.topic, p.type) for p in contract.publishers],
        "services": [(s.service, s.type) for s in contract.services],
        "calls": [(c.service, c.type) for c in contract.clients],
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


def _service_type(declared: ServiceDeclaration | ClientDeclaration) -> str:
    return robo_messages.service_type_name(declared.request_type, declared.response_type)


def _table(rows: Sequence[tuple[str, str]]) -> list[str]:
    width = max(18, *(len(row[0]) for row in rows))
    return [f"  {left:{width}} {right}" for left, right in rows]
