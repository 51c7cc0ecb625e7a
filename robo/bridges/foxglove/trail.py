"""Where a robot has driven, as a path that viewers draw: made of its odometry. Pure."""

import math
from collections import deque

from robo_messages import Header, Odometry, Path, PoseStamped

STEP = 0.05
"""Between two poses that are kept, m."""
MOST_POSES = 1_000
"""The last 50 m."""
_JUMP, _FASTEST = 1.0, 10.0
"""Who is so far, m, from where he was, and came there faster than so, m/s, has jumped."""
_UNSEEN = 2_000_000_000
"""How a robot has come so far is not known where nobody has looked for so long, ns."""
PERIOD = 500_000_000
"""A path is told at most so often, ns: it is whole each time."""


class Trail:
    """The trail of one robot."""

    def __init__(self) -> None:
        self._poses: deque[PoseStamped] = deque(maxlen=MOST_POSES)
        self._told = self._seen = 0
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
        if last is not None and _jumps(_distance(last, odometry), now - self._seen):
            self._poses.clear()
            last = None
        self._seen = now
        self._frame = odometry.header.frame_id
        if last is None or _distance(last, odometry) >= STEP:
            self._poses.append(PoseStamped(Header(odometry.header.stamp, self._frame), pose))
        if abs(now - self._told) < PERIOD:
            return None
        self._told = now
        return Path(Header(odometry.header.stamp, self._frame), list(self._poses))


def _before(one: Header, other: Header) -> bool:
    return one.stamp.to_nanoseconds() < other.stamp.to_nanoseconds()


def _distance(last: PoseStamped, odometry: Odometry) -> float:
    before, now = last.pose.position, odometry.pose.pose.position
    return math.dist((before.x, before.y, before.z), (now.x, now.y, now.z))


def _jumps(distance: float, unseen: int) -> bool:
    return distance > _JUMP and (unseen > _UNSEEN or distance > _FASTEST * unseen / 1e9)
