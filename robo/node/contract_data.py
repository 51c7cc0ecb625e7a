"""A node class's contract as plain data: what JSON and other processes get of it. Imports no message type."""

import msgspec

from robo.parameters.hints import ParameterInfo


class TopicData(msgspec.Struct, frozen=True):
    """A topic that a node class publishes or subscribes."""

    topic: str
    """As declared: relative, absolute or private."""
    type: str
    depth: int


class ServiceData(msgspec.Struct, frozen=True):
    """A service that a node class has."""

    service: str
    type: str


class ClientData(ServiceData, frozen=True):
    """A service that a node class calls."""

    timeout: float
    """s."""


class TimerData(msgspec.Struct, frozen=True):
    """What a node class does at a steady rate."""

    method: str
    rate: float | str
    """The rate, Hz, or the name of the parameter that says it."""


class ContractData(msgspec.Struct, frozen=True, kw_only=True):
    """All that a node class declares."""

    class_name: str
    """`module:Class`."""
    name: str
    """The node's default name."""
    description: str
    publishers: tuple[TopicData, ...]
    subscriptions: tuple[TopicData, ...]
    services: tuple[ServiceData, ...]
    clients: tuple[ClientData, ...]
    timers: tuple[TimerData, ...]
    parameters: tuple[ParameterInfo, ...]

    @property
    def parameter_types(self) -> dict[str, str]:
        """The parameters' types by name."""
        return {info.name: info.type for info in self.parameters}
