"""What a node says that it has seen, without a network."""

from typing import Any

import pytest

from robo import Node
from robo.node.endpoints import Endpoints
from robo.node.status import Status
from robo.node.turns import Turns
from robo.wire.reports import Refused


class End:
    """Stands for a live end: it has the counters that it was given."""

    def __init__(self, **counters: Any) -> None:
        vars(self).update(counters)


def subscription(topic: str, received: int = 0, malformed: int = 0, dropped: int = 0, refused: Any = ()) -> Any:
    return End(topic=topic, received=received, malformed=malformed, dropped=dropped, refused=list(refused))


@pytest.fixture
def clock() -> list[float]:
    return [50.0]


def test_counters_of_all_ends_are_summed_up_by_topic_and_service(clock: list[float]) -> None:
    refused = [Refused("/r1/joystick", 3, 0.5)]
    ends: Any = Endpoints()
    ends.publishers += [End(topic="r1/out", published=7), End(topic="r1/log", published=0)]
    ends.subscriptions += [subscription("r1/odom", 5, 1, 2), subscription("r1/cmd_vel", 4, refused=refused)]
    ends.services.append(End(key="r1/reset", served=2))
    status = Status("/r1/base", Turns(), lambda: clock[0]).of(ends, callback_errors=6)
    assert status.node == "/r1/base"
    assert status.published == {"r1/out": 7, "r1/log": 0}
    assert status.received == {"r1/odom": 5, "r1/cmd_vel": 4}
    assert status.malformed == {"r1/odom": 1, "r1/cmd_vel": 0}
    assert status.dropped == {"r1/odom": 2, "r1/cmd_vel": 0}
    assert status.refused == {"r1/cmd_vel": refused}, "only topics of which somebody was refused"
    assert status.served == {"r1/reset": 2}
    assert status.callback_errors == 6


def test_timers_of_one_callback_count_their_missed_ticks_together(clock: list[float]) -> None:
    ends: Any = Endpoints()
    ends.timers += [End(name="tick", missed=2), End(name="beat", missed=0), End(name="tick", missed=3)]
    assert Status("/base", Turns(), lambda: clock[0]).of(ends, 0).missed == {"tick": 5, "beat": 0}


def test_the_callback_that_runs_counts_as_busy_already(clock: list[float]) -> None:
    turns = Turns()
    turn, status = turns.own, Status("/base", turns, lambda: clock[0])
    turn.busy = 1.5
    clock[0] += 10.0
    idle = status.of(Endpoints(), 0)
    assert (idle.uptime, idle.busy, idle.running, idle.running_for) == (10.0, 1.5, "", 0.0)
    turn.running, turn.since = "on_scan", clock[0]
    clock[0] += 2.0
    held_up = status.of(Endpoints(), 0)
    assert (held_up.uptime, held_up.busy, held_up.running, held_up.running_for) == (12.0, 3.5, "on_scan", 2.0)


def test_a_callback_that_began_after_the_look_at_the_clock_has_run_for_no_time(clock: list[float]) -> None:
    turns = Turns()
    turns.own.running, turns.own.since = "tick", clock[0] + 0.001
    assert Status("/base", turns, lambda: clock[0]).of(Endpoints(), 0).running_for == 0.0


def test_a_node_that_has_not_started_has_seen_nothing() -> None:
    class Base(Node):
        """Has nothing to do."""

    status = Base(namespace="r1").status
    assert status.node == "/r1/base"
    assert (status.published, status.received, status.missed, status.callback_errors) == ({}, {}, {}, 0)
