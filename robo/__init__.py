"""robo: robots as microservices over Zenoh.

import robo
from robo_messages import String

class Talker(robo.Node):
    chatter = robo.Publisher(String, "chatter")

    @robo.timer(rate=1.0)
    def speak(self) -> None:
        self.chatter.publish(String("hello"))

if __name__ == "__main__":
    robo.run(Talker)
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robo.errors import (
        ActionError,
        ActionTimeout,
        ContractError,
        InvalidName,
        LifecycleError,
        ManifestError,
        NetworkError,
        NotActive,
        NotKept,
        ParameterError,
        ParameterFileError,
        RoboError,
        ServiceError,
        ServiceTimeout,
        UsageError,
    )
    from robo.node.actions import ActionClient, GoalCanceled, action
    from robo.node.declare import Client, Publisher, check, service, subscribe, timer
    from robo.node.health import Health
    from robo.node.lifecycle import LifecycleState, TransitionCallbackReturn
    from robo.node.managed import LifecycleNode
    from robo.node.message_info import MessageInfo
    from robo.node.node import Node
    from robo.node.part import Part
    from robo.parameters.hints import NON_FINITE, READ_ONLY, Step, Subscribes, Unit
    from robo.parameters.model import Parameters
    from robo.process.runner import run
    from robo.wire.goals import GoalState
    from robo.wire.network import Network
    from robo.wire.qos import KEEP_ALL, QoS
    from robo.wire.reports import NodeStatus
    from robo.wire.session import open_session

__all__ = [
    "KEEP_ALL",
    "NON_FINITE",
    "READ_ONLY",
    "ActionClient",
    "ActionError",
    "ActionTimeout",
    "Client",
    "ContractError",
    "GoalCanceled",
    "GoalState",
    "Health",
    "InvalidName",
    "LifecycleError",
    "LifecycleNode",
    "LifecycleState",
    "ManifestError",
    "MessageInfo",
    "Network",
    "NetworkError",
    "Node",
    "NodeStatus",
    "NotActive",
    "NotKept",
    "ParameterError",
    "ParameterFileError",
    "Parameters",
    "Part",
    "Publisher",
    "QoS",
    "RoboError",
    "ServiceError",
    "ServiceTimeout",
    "Step",
    "Subscribes",
    "TransitionCallbackReturn",
    "Unit",
    "UsageError",
    "action",
    "check",
    "open_session",
    "run",
    "service",
    "subscribe",
    "timer",
]

_HOMES = {
    "node.actions": ("ActionClient", "GoalCanceled", "action"),
    "node.declare": ("Client", "Publisher", "check", "service", "subscribe", "timer"),
    "node.health": ("Health",),
    "node.lifecycle": ("LifecycleState", "TransitionCallbackReturn"),
    "node.managed": ("LifecycleNode",),
    "node.message_info": ("MessageInfo",),
    "node.node": ("Node",),
    "node.part": ("Part",),
    "parameters.hints": ("NON_FINITE", "READ_ONLY", "Step", "Subscribes", "Unit"),
    "parameters.model": ("Parameters",),
    "process.runner": ("run",),
    "wire.goals": ("GoalState",),
    "wire.network": ("Network",),
    "wire.qos": ("KEEP_ALL", "QoS"),
    "wire.reports": ("NodeStatus",),
    "wire.session": ("open_session",),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import what is asked for: the command line and a router need neither a node nor its imports."""
    if name not in __all__:
        raise AttributeError(f"module 'robo' has no attribute {name!r}")
    value: object = getattr(importlib.import_module(f"robo.{_HOME.get(name, 'errors')}"), name)
    globals()[name] = value
    return value
