"""Plans for tests of a single process that start nothing."""

from typing import Any

from robo.launch.plan import ProcessPlan, TopicPlan
from robo.text.tree import Position
from tests.processes import process_plan


def node_plan(**changes: Any) -> ProcessPlan:
    """A node in a group, with a watchdog; some fields may be changed."""
    usual: dict[str, Any] = {"group": "g", "service": "package.module", "watchdog": 5.0}
    return process_plan("/r1/node", **usual | changes)


def topic_plan(key: str, *, min_rate: float | None = None, max_age: float | None = None) -> TopicPlan:
    """A promise about a topic: messages per second, and the age of the newest one, s."""
    place = Position("robot.yaml", 2, 1)
    return TopicPlan(
        key=key, type=None, min_rate=min_rate, max_rate=None, max_age=max_age, external=False, source=place
    )
