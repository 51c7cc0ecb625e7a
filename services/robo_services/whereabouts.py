"""Where a robot is, in odometry's frame or another one, or why that is not known."""

from robo.tf import Buffer, TransformError
from robo_messages import Odometry
from robo_services.arrivals import Newest
from robo_services.kinematics import Pose2
from robo_services.odometry_check import fix_of
from robo_services.planar import normalize_angle
from robo_services.safety import is_finite


class Lost(Exception):
    """It is not known where the robot is; says why."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason
        """A short word for the cause."""


class Whereabouts:
    """Keeps the newest odometry, and tells poses in any frame."""

    def __init__(self, topic: str, buffer: Buffer) -> None:
        """`topic` is that of odometry, for what is told; `buffer` has the transforms."""
        self._topic = topic
        self._buffer = buffer
        self._newest: Newest[Odometry] = Newest()

    def take(self, odometry: Odometry, sent: float, now: float) -> bool:
        """Take odometry; times as for `Newest`. Returns whether it is finite: other counts as silence."""
        if fix_of(odometry, 0.0) is None or not is_finite(odometry.twist.twist):
            return False
        self._newest.take(odometry, sent, now)
        return True

    @property
    def frame(self) -> str:
        """Of odometry; empty before the first."""
        odometry = self._newest.message
        return odometry.header.frame_id.removeprefix("/") if odometry is not None else ""

    @property
    def speed(self) -> float:
        """Ahead, m/s; 0 before the first odometry."""
        odometry = self._newest.message
        return odometry.twist.twist.linear.x if odometry is not None else 0.0

    def pose(self, frame: str, now: float, timeout: float) -> Pose2:
        """Where the robot is.

        Args:
            frame: in which; empty: that of odometry.
            now: as for `take`, s.
            timeout: older odometry is none, s.

        Raises:
            Lost: there is no odometry, or the frame cannot be looked up.
        """
        odometry = self._newest.message
        fix = fix_of(odometry, 0.0) if odometry is not None else None
        if fix is None:
            raise Lost("no_odometry", f"no odometry so far on {self._topic}")
        if self._newest.age(now) > timeout:
            raise Lost("stale_odometry", f"the last odometry on {self._topic} is too old")
        if frame in ("", self.frame):
            return Pose2(fix.x, fix.y, fix.yaw)
        try:
            there = self._buffer.lookup(frame, self.frame)
        except TransformError as error:
            raise Lost("no_transform", f"where the robot is in {frame} is not known: {error}") from None
        x, y, _ = there.apply(fix.x, fix.y, 0.0)
        return Pose2(x, y, normalize_angle(fix.yaw + there.rpy()[2]))
