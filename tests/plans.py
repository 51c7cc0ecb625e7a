"""Plans for tests that start nothing."""

import msgspec

from robo.launch.plan import LogPlan, ProcessPlan, ReadyPlan, RestartPlan, StopPlan, TopicPlan
from robo.text.tree import Position

_PLAIN = ProcessPlan(
    name="node",
    namespace="r1",
    group="g",
    hosts=(),
    service="package.module",
    run=(),
    prefix=(),
    args=(),
    cwd=None,
    settings={},
    remap={},
    env={},
    needs={},
    watchdog=5.0,
    required=False,
    restart=RestartPlan(),
    stop=StopPlan(),
    ready=ReadyPlan(),
    log=LogPlan(),
    priority=None,
    cpus=(),
    publishes={},
    subscribes={},
    sources={},
    source=Position("robot.yaml", 1, 1),
)


def process_plan(**changes: object) -> ProcessPlan:
    """A node that nothing is said of, with some fields changed."""
    return msgspec.structs.replace(_PLAIN, **changes)


def topic_plan(key: str, *, min_rate: float | None = None, max_age: float | None = None) -> TopicPlan:
    """A promise about a topic: messages per second, and the age of the newest one, s."""
    place = Position("robot.yaml", 2, 1)
    return TopicPlan(
        key=key, type=None, min_rate=min_rate, max_rate=None, max_age=max_age, external=False, source=place
    )
