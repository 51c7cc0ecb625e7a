"""All that a node's process is told, resolved."""

import os
from collections.abc import Mapping, Sequence

import msgspec

from robo.environment import SUPERVISED_VARIABLE
from robo.wire.codec import jsonable
from robo.wire.network import OWN_ROUTER_WITHIN, Mode, Network
from robo.wire.qos import Quality
from robo.wire.reports import Setting


class InRos(msgspec.Struct, frozen=True, kw_only=True):
    """The graph of ROS 2 in which a node is by itself."""

    domain: int = 0
    """ROS_DOMAIN_ID."""
    connect: str = "tcp/localhost:7447"
    """Where its router is."""


class NodeSpec(msgspec.Struct, frozen=True, kw_only=True):
    """All that a node's process needs to know, resolved."""

    service: str = ""
    """`package.module:Class` or `package.module`; empty for a command that may run any node."""
    name: str | None = None
    namespace: str | None = None
    settings: Mapping[str, Sequence[Setting]] = {}
    """By parameter, all that was said of it, from the weakest to what holds."""
    remappings: dict[str, str] = {}
    qos: dict[str, Quality] = {}
    """By topic, what the launch says of its ends."""
    memory: str = ""
    """The file that its launch has made for what it keeps over restarts."""
    needs: tuple[str, ...] = ()
    """Full names of nodes that this one must see before it starts."""
    autostart: bool = True
    """Whether a managed node is brought to active; else it waits in unconfigured."""
    mode: Mode | None = None
    """None for one that nobody has launched: ROBO_MODE says it, or it is a router of its own."""
    ros2: InRos | None = None
    """None for a node that is in robo's network alone."""
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, object]:
        """The values that hold, by name."""
        return {name: settings[-1].value for name, settings in self.settings.items()}

    def network(self) -> Network:
        """How the node joins the network. Its supervisor cares for the router, and both wait for it as long.

        Raises:
            NetworkError: the folder in which this user's robots meet is not to be trusted, or cannot be made.
        """
        network = Network.from_environment(self.mode or "router", self.connect, self.listen)
        if SUPERVISED_VARIABLE in os.environ:
            network = msgspec.structs.replace(network, timeout=OWN_ROUTER_WITHIN)
        return network

    def as_json(self) -> str:
        """For an environment. What holds stands there once more as `parameters`, for commands in other languages."""
        data = msgspec.to_builtins(self) | {"parameters": self.parameters}
        return msgspec.json.encode(jsonable(data)).decode()


class Order(msgspec.Struct, frozen=True, kw_only=True):
    """What a process that several nodes share is told of one of them."""

    number: int
    """Of its stay there."""
    spec: str = ""
    """Its `NodeSpec` as JSON, where it is to begin: a descriptor for its output and one for its heartbeats come with
    it. Empty where it is to end."""
    where: bool = False
    """It hangs, and shall say where; it is not to end for that."""
    level: str | None = None
    """The least level that it prints."""
    period: float = 1.0
    """The time from one heartbeat to the next, s."""


class Ended(msgspec.Struct, frozen=True):
    """What such a process answers: a node of it has ended."""

    number: int
    """Of its stay there."""
    code: int
    """Its exit code."""
    closing: bool = False
    """Whether the process ends with its other nodes: no more may come."""
