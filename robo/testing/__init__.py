"""Testing nodes and robots with pytest: the names to annotate its fixtures with.

def test_it_closes(run_node: RunNode, clock: Clock) -> None:
    node = run_node(Gripper, rate=10.0)
    clock.advance(0.1)
    assert node.published("grip")[-1].data == 0.5
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robo.testing.bench import NodeEnded
    from robo.testing.call import Call, StillWaiting
    from robo.testing.clock import Clock
    from robo.testing.cut import CannotCut
    from robo.testing.ending import NodeDied
    from robo.testing.goal import Goal
    from robo.testing.launch import Launch
    from robo.testing.leaks import Leak
    from robo.testing.node import NodeUnderTest, NotThere, RunNode
    from robo.testing.regression.api import ReplayDiffers, replay
    from robo.testing.robot import Robot
    from robo.testing.run import LaunchFailed
    from robo.testing.stepper import Hung

__all__ = [
    "Call",
    "CannotCut",
    "Clock",
    "Goal",
    "Hung",
    "Launch",
    "LaunchFailed",
    "Leak",
    "NodeDied",
    "NodeEnded",
    "NodeUnderTest",
    "NotThere",
    "ReplayDiffers",
    "Robot",
    "RunNode",
    "StillWaiting",
    "replay",
]

_HOMES = {
    "bench": ("NodeEnded",),
    "call": ("Call", "StillWaiting"),
    "clock": ("Clock",),
    "cut": ("CannotCut",),
    "ending": ("NodeDied",),
    "launch": ("Launch",),
    "leaks": ("Leak",),
    "goal": ("Goal",),
    "node": ("NodeUnderTest", "NotThere", "RunNode"),
    "regression.api": ("ReplayDiffers", "replay"),
    "robot": ("Robot",),
    "run": ("LaunchFailed",),
    "stepper": ("Hung",),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    """Import what is asked for: pytest imports this package in every run."""
    if name not in _HOME:
        raise AttributeError(f"module 'robo.testing' has no attribute {name!r}")
    value: object = getattr(importlib.import_module(f"robo.testing.{_HOME[name]}"), name)
    globals()[name] = value
    return value
