"""Where a robot has driven, as a path that viewers draw: made of its odometry. Pure."""

import math
from collections import deque

from robo_messages import Header, Odometry, Path, PoseStamped

STEP = 0.05
"""Between two poses that are kept, m."""
MOST_POSES = 1_000
"""The last 50 m."""
PERIOD = 500_000_000
"""A path is told at most so often, ns: it is whole each time."""


class Trail:
    """The trail of one robot."""

    def __init__(self) -> None:
        self._poses: deque[PoseStamped] = deque(maxlen=MOST_POSES)
        self._told = 0
        self._frame = ""

    def take(self, odometry: Odometry, now: int) -> Path | None:
        """See where the robot is; the path, where it is time to tell it.

        Args:
            odometry: where it is.
            now: ns, by a clock that is the same at each call.
        """
        pose = odometry.pose.pose
        place = pose.position
        if not (math.isfinite(place.x) and math.isfinite(place.y) and math.isfinite(place.z)):
            return None
        # A simulation that has begun again, and a recording in which somebody goes back, begin another one.
        last = self._poses[-1] if self._poses else None
        if last is not None and (odometry.header.frame_id != self._frame or _before(odometry.header, last.header)):
            self._poses.clear()
            last = None
        self._frame = odometry.header.frame_id
        if last is None or _far(last, odometry):
            self._poses.append(PoseStamped(Header(odometry.header.stamp, self._frame), pose))
        if abs(now - self._told) < PERIOD:
            return None
        self._told = now
        return Path(Header(odometry.header.stamp, self._frame), list(self._poses))


def _before(one: Header, other: Header) -> bool:
    return one.stamp.to_nanoseconds() < other.stamp.to_nanoseconds()


def _far(last: PoseStamped, odometry: Odometry) -> bool:
    before, now = last.pose.position, odometry.pose.pose.position
    return math.dist((before.x, before.y, before.z), (now.x, now.y, now.z)) >= STEP
