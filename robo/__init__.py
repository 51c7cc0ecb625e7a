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

from robo.contract import Publisher, subscribe, timer
from robo.errors import (
    ContractError,
    InvalidName,
    ManifestError,
    NetworkError,
    ParameterError,
    ParameterFileError,
    RoboError,
    UsageError,
)
from robo.node import Node, NodeStatus
from robo.parameters import Parameters
from robo.qos import KEEP_ALL
from robo.runner import run
from robo.session import Network, open_session

__all__ = [
    "KEEP_ALL",
    "ContractError",
    "InvalidName",
    "ManifestError",
    "Network",
    "NetworkError",
    "Node",
    "NodeStatus",
    "ParameterError",
    "ParameterFileError",
    "Parameters",
    "Publisher",
    "RoboError",
    "UsageError",
    "open_session",
    "run",
    "subscribe",
    "timer",
]
