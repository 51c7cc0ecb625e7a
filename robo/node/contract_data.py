"""A node class's contract as plain data: what JSON and other processes get of it. Imports no message type."""

import msgspec

from robo.parameters.hints import ParameterInfo
from robo.wire.qos import Priority, QoS


class TopicData(msgspec.Struct, frozen=True):
    """A topic that a node class publishes or subscribes."""

    topic: str
    """As declared: relative, absolute or private."""
    type: str
    qos: QoS


class SubscriptionData(TopicData, frozen=True):
    """A topic that a node class subscribes."""

    turn: str = ""
    """Which turn its callback takes; empty for the node's own. So for services and timers."""
    sole_source: str = ""
    """The parameter that says whose messages alone count; empty where those of all do."""


class ServiceData(msgspec.Struct, frozen=True):
    """A service that a node class answers or calls."""

    service: str
    type: str


class ServedData(ServiceData, frozen=True):
    """A service that a node class answers."""

    turn: str = ""


class ClientData(ServiceData, frozen=True):
    """A service that a node class calls."""

    timeout: float
    """s."""
    priority: Priority = "data"


class TimerData(msgspec.Struct, frozen=True):
    """What a node class does at a steady rate."""

    method: str
    rate: float | str
    """The rate, Hz, or the name of the parameter that says it."""
    turn: str = ""


class CheckData(msgspec.Struct, frozen=True):
    """What a node class tells of how well it does."""

    check: str
    """What is checked."""
    method: str


class ActionData(msgspec.Struct, frozen=True):
    """An action that a node class executes."""

    action: str
    type: str
    policy: str
    """What becomes of a goal that comes while another one is under way."""
    turn: str = ""


class ActionClientData(msgspec.Struct, frozen=True):
    """An action to which a node class sends goals."""

    action: str
    type: str
    timeout: float
    """How long its server may take to answer, s."""


class ContractData(msgspec.Struct, frozen=True, kw_only=True):
    """All that a node class declares."""

    class_name: str
    """`module:Class`."""
    name: str
    """The node's default name."""
    description: str
    publishers: tuple[TopicData, ...]
    subscriptions: tuple[SubscriptionData, ...]
    services: tuple[ServedData, ...]
    clients: tuple[ClientData, ...]
    timers: tuple[TimerData, ...]
    parameters: tuple[ParameterInfo, ...]
    managed: bool = False
    """Whether it is a managed node, a `LifecycleNode`."""
    actions: tuple[ActionData, ...] = ()
    action_clients: tuple[ActionClientData, ...] = ()
    checks: tuple[CheckData, ...] = ()
    requires: dict[str, str] = {}
    """Modules that it imports only when it runs, and what to install for each."""

    @property
    def parameter_types(self) -> dict[str, str]:
        """The parameters' types by name."""
        return {info.name: info.type for info in self.parameters}
