"""Numbers of recordings: how far a robot has come, and what a plan asks for."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from robo.bag.look.fields import number
from robo.bag.of_robot import only_robot
from robo.bag.read.readable import Readable
from robo.bag.read.reader import Bag
from robo.batch.plan import Metric, Take, Value
from robo.errors import UsageError
from robo.interfaces.parts import Field, Missing
from robo.text.suggestions import suggest
from robo_messages import Quaternion

_POSES = {
    "nav/Odometry": "pose.pose",
    "geometry/PoseStamped": "pose",
    "geometry/PoseWithCovarianceStamped": "pose.pose",
}
"""By type, where its pose is."""


def standard(said: Bag, recording: Bag) -> dict[str, Value]:
    """What is told of each replay, where it is known: the way, and where it ends.

    Args:
        said: what nodes have said.
        recording: what they have heard.

    Returns:
        `distance` (m), `x`, `y` (m) and `heading` (rad) of the first topic with poses that nodes have said, or else of
        the recording's.
    """
    for bag in (said, recording):
        for name, topic in bag.topics.items():
            if topic.type in _POSES and topic.known is not None and topic.count:
                return way(_poses(bag, name, _POSES[topic.type]))
    return {}


def way(poses: Iterable[tuple[float, float, float]]) -> dict[str, Value]:
    """How far a robot has come, and where it is at the end, of x, y (m) and heading (rad). Pure."""
    distance, last = 0.0, None
    for pose in poses:
        if last is not None:
            distance += math.hypot(pose[0] - last[0], pose[1] - last[1])
        last = pose
    return {} if last is None else {"distance": distance, "x": last[0], "y": last[1], "heading": last[2]}


def asked(metrics: Mapping[str, Metric], said: Bag, recording: Bag) -> dict[str, Value]:
    """What a plan asks for.

    Raises:
        UsageError: there is no such topic or field, or it is no number.
    """
    return {name: _taken(name, metric, said, recording) for name, metric in metrics.items()}


def reduced(values: Sequence[float], take: Take) -> float | int:
    """One number of many. Pure."""
    if take == "count":
        return len(values)
    if take == "sum":
        return math.fsum(values)
    if take == "mean":
        return math.fsum(values) / len(values)
    if take in ("min", "max"):
        return min(values) if take == "min" else max(values)
    return values[0] if take == "first" else values[-1]


def _taken(name: str, metric: Metric, said: Bag, recording: Bag) -> Value:
    bag, topic = _found(metric.topic, said, recording)
    field = Field(metric.field)
    values: list[float] = []
    try:
        for _, message in Readable().of(bag.messages(topic)):
            value = field.of(message)
            figure = number(int(value) if isinstance(value, bool) else value)
            if figure is None:
                raise UsageError(f"{name}: {topic} {metric.field} is no number")
            values.append(figure)
    except Missing as error:
        raise UsageError(f"{name}: {topic} {metric.field}: {error}") from None
    if not values and metric.take != "count":
        raise UsageError(f"{name}: no message of {topic} can be read")
    figure = reduced(values, metric.take)
    return figure if math.isfinite(figure) else str(figure)


def _found(name: str, said: Bag, recording: Bag) -> tuple[Bag, str]:
    for bag in (said, recording):
        for candidate in (name, f"{only_robot(recording)}/{name}"):
            if candidate in bag.topics:
                return bag, candidate
    known = dict.fromkeys([*said.topics, *recording.topics])
    raise UsageError(f"there is no topic {name}; {suggest(name, known)}")


def _poses(bag: Bag, name: str, path: str) -> Iterator[tuple[float, float, float]]:
    field = Field(path)
    for _, message in Readable().of(bag.messages(name)):
        pose: Any = field.of(message)
        yield pose.position.x, pose.position.y, yaw(pose.orientation)


def yaw(turn: Quaternion) -> float:
    """The heading of a turn about z, rad (REP-103)."""
    return math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))
