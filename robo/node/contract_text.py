"""A node class's contract, for people and as plain data."""

from collections.abc import Sequence

import robo_messages
from robo.node.contract import ClientDeclaration, ServiceDeclaration, contract_of
from robo.node.contract_data import (
    ActionClientData,
    ActionData,
    CheckData,
    ClientData,
    ContractData,
    ServedData,
    SubscriptionData,
    TimerData,
    TopicData,
)
from robo.node.declare import Declares
from robo.packages.absent import installing
from robo.wire.qos import QoS


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
        publishers=tuple(TopicData(p.topic, type_name(p.message_type), p.qos) for p in contract.publishers),
        subscriptions=tuple(
            SubscriptionData(s.topic, type_name(s.message_type), s.qos, s.turn, s.sole_source or "")
            for s in contract.subscriptions
        ),
        services=tuple(ServedData(s.service, _service_type(s), s.turn) for s in contract.services),
        clients=tuple(ClientData(c.service, _service_type(c), c.timeout, c.priority) for c in contract.clients),
        timers=tuple(TimerData(t.method, t.rate, t.turn) for t in contract.timers),
        parameters=contract.parameters,
        managed=contract.managed,
        actions=tuple(ActionData(a.action, a.types.name, a.policy, a.turn) for a in contract.actions),
        action_clients=tuple(ActionClientData(c.action, c.types.name, c.timeout) for c in contract.action_clients),
        checks=tuple(CheckData(c.name, c.method) for c in contract.checks),
        requires=dict(cls.REQUIRES),
    )


def contract_text(contract: ContractData) -> str:
    """What a node subscribes, publishes, serves and calls, and how it is tuned."""
    sections = {
        "subscribes": [(s.topic, _carried(s) + _turn(s.turn)) for s in contract.subscriptions],
        "publishes": [(p.topic, _carried(p)) for p in contract.publishers],
        "services": [(s.service, s.type + _turn(s.turn)) for s in contract.services],
        "calls": [(c.service, c.type) for c in contract.clients],
        "actions": [(a.action, f"{a.type}, {a.policy}{_turn(a.turn)}") for a in contract.actions],
        "sends goals to": [(c.action, c.type) for c in contract.action_clients],
        "timers": [(t.method, _rate(t.rate) + _turn(t.turn)) for t in contract.timers],
        "checks": [(c.check, c.method) for c in contract.checks],
        "needs the modules": [(module, installing(what)) for module, what in contract.requires.items()],
    }
    lines = ["a managed node, see `robo lifecycle`"] if contract.managed else []
    for title, rows in sections.items():
        if rows:
            lines += [f"{title}:", *_table(rows)]
    if contract.parameters:
        width = max(len(p.name) for p in contract.parameters)
        lines.append("parameters:")
        lines += [f"  {p.name:{width}} {_default(p.default):8} {p.about}".rstrip() for p in contract.parameters]
    return "\n".join(lines)


def _default(value: object) -> str:
    return "needed" if value is None else repr(value)


def _carried(topic: TopicData) -> str:
    """What a topic carries; and how, where something is said of it."""
    return topic.type if topic.qos == QoS.DEFAULT else f"{topic.type}  {topic.qos}"


def _service_type(declared: ServiceDeclaration | ClientDeclaration) -> str:
    return robo_messages.service_type_name(declared.request_type, declared.response_type)


def _rate(rate: float | str) -> str:
    return rate if isinstance(rate, str) else f"{rate:g} Hz"


def _turn(name: str) -> str:
    return f", turn {name}" if name else ""


def _table(rows: Sequence[tuple[str, str]]) -> list[str]:
    width = max(18, *(len(row[0]) for row in rows))
    return [f"  {left:{width}} {right}" for left, right in rows]
