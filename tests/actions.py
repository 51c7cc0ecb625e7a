"""Whoever sends goals, for tests of actions."""

import pytest

from robo import ActionClient, ActionError, Node
from robo_messages import Fibonacci
from tests.support import PATIENCE


class Caller(Node):
    fibonacci = ActionClient(Fibonacci.Goal, Fibonacci.Result, Fibonacci.Feedback, "fibonacci", timeout=PATIENCE)


def settle(caller: Caller) -> None:
    """Wait until the server, which has a goal under way, knows all that was asked before; it answers in order."""
    with pytest.raises(ActionError, match="takes one at a time"):
        caller.fibonacci.send_goal(Fibonacci.Goal(0))
