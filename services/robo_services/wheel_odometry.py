"""Where a base is by its wheels: exact arcs, wheels that wrap around or begin anew, and how sure that is.

    drive = DiffDrive(wheel_separation=0.3, wheel_radius=0.05, max_wheel_velocity=30.0)
    odometry = WheelOdometry(drive)
    odometry.take_positions([left], [right], time)          # rad, s: whenever they are measured
    publisher.publish(odometry.message(Header(stamp, "odom"), "base_link"))

Pure: no network, no clock. A reading that is not finite, or that the wheels cannot have reached, moves nothing; it is
counted, and what may have been driven unseen makes the pose less sure.
"""

import math
from collections.abc import Sequence

from robo_messages import Header, Odometry, Point, Pose, PoseWithCovariance, Twist, TwistWithCovariance, Vector3
from robo_services.drives import Drive, Wheels
from robo_services.kinematics import ORIGIN, Pose2, Twist2, advance
from robo_services.planar import quaternion_from_yaw
from robo_services.uncertainty import NOISE, Noise, PoseCovariance, twist_covariance

MARGIN = 1.5
"""How much faster than its limit a wheel may seem: stamps jitter."""
LEAST = 0.1
"""Stamps are good to this time, s: no step is too long for `LEAST` at full speed."""
SHORTEST = 1e-4
"""Over less time, s, positions give no velocity."""
LONGEST = 1.0
"""Velocities say nothing of what was so long ago, s."""
LONGEST_UNSEEN = 1.0
"""For so long at most it may have driven on as it did, s: of whom nobody hears any more, nobody lets drive on."""
PUSHED = 0.1
"""While nobody counts it may be pushed by so much, m, and turned, rad."""
FURTHEST = 1e4
"""In one step no base drives further, m, or turns more, rad, also where nobody says how fast its wheels are."""
LEAST_VARIANCE = 1e-6
"""Of a velocity, m²/s² and rad²/s²."""


class Encoders:
    """How far each of some wheels has turned, from their positions."""

    def __init__(self, *, wrap: float = 0.0, max_velocity: float = math.inf, slack: float = 0.0) -> None:
        """
        Args:
            wrap: after how many rad a position begins anew, such as 2π, or 65,536 ticks; 0 for never. Between two
                readings a wheel has to turn by less than half of it.
            max_velocity: a wheel that turns faster, rad/s, was not turned: its encoder has begun anew.
            slack: by so much, rad, it may always have turned: some ticks of a coarse encoder.
        """
        self.resets = 0
        """How often they began anew, or jumped."""
        self.refused = 0
        """Readings that were not finite."""
        self._wrap, self._max_velocity, self._slack = wrap, max_velocity, slack
        self._before: tuple[float, ...] = ()

    def turned(self, positions: Sequence[float], elapsed: float) -> list[float] | None:
        """How far each has turned since the last reading, rad; None where that is not known.

        Args:
            positions: of all wheels, in the same order each time, rad.
            elapsed: since the last reading, s.
        """
        if not all(map(math.isfinite, positions)):
            self.refused += 1
            return None  # what was turned meanwhile is in the next one
        before, self._before = self._before, tuple(positions)
        if len(before) != len(positions):
            return None
        ways = [self._way(old, new) for old, new in zip(before, positions, strict=True)]
        furthest = max(self._max_velocity * max(elapsed, LEAST) * MARGIN, self._slack)
        if all(abs(way) <= furthest and math.isfinite(way) for way in ways):
            return ways
        self.resets += 1
        return None

    def begin_anew(self) -> None:
        """Forget where they were: nobody knows how far they turn until the next reading."""
        self._before = ()

    def _way(self, old: float, new: float) -> float:
        way = new - old
        return math.remainder(way, self._wrap) if self._wrap and math.isfinite(way) else way


class WheelOdometry:
    """Follows a base by its wheels: one or more on each side, whose mean counts."""

    def __init__(
        self, drive: Drive, noise: Noise = NOISE, *, pose: Pose2 = ORIGIN, wrap: float = 0.0, slack: float = 0.0
    ) -> None:
        """
        Args:
            drive: the base's wheels; faster than its `max_wheel_velocity` none of them turns.
            noise: how the base errs.
            pose: where it is.
            wrap: as for `Encoders`.
            slack: likewise.
        """
        self.pose = pose
        self.twist = Twist2()
        """How it moved in the last step, m/s and rad/s."""
        self.covariance = PoseCovariance()
        self.left_out = 0
        """Readings that were not believed."""
        self._drive = drive
        self.noise = noise
        """How the base errs, as it may turn out while it drives."""
        self._variances = LEAST_VARIANCE, LEAST_VARIANCE
        self._encoders = Encoders(wrap=wrap, max_velocity=drive.max_wheel_velocity, slack=slack)
        self._time: float | None = None
        self._steering = 0.0
        self._begins = True

    def take_positions(
        self, left: Sequence[float], right: Sequence[float], time: float, *, steering: float = 0.0
    ) -> bool:
        """Move on to where the wheels are now. The first reading moves nothing.

        Args:
            left: how far each wheel of this side has turned since whenever, rad.
            right: likewise.
            time: when that was, s. Where time steps back, the way counts all the same.
            steering: the angle of a wheel in the middle of the front axle, rad; between two readings their mean counts.

        Returns:
            Whether it is believed.
        """
        if not _usable(left, right, time, steering):
            self.left_out += 1
            return False  # what was driven meanwhile is in the next reading
        is_first = self._time is None
        elapsed, begins = self._elapsed(time), self._begins
        middle = steering if begins else (self._steering + steering) / 2
        self._steering, self._begins = steering, False
        ways = self._encoders.turned((*left, *right), elapsed)
        if ways is not None:
            return self.roll(Wheels(_mean(ways[: len(left)]), _mean(ways[len(left) :]), middle), elapsed)
        if not is_first:
            self._lose(elapsed)
        if not begins:
            self.left_out += 1
        return begins

    def take_velocities(
        self, left: Sequence[float], right: Sequence[float], time: float, *, steering: float = 0.0
    ) -> bool:
        """Move on as the wheels turn now, since the last reading. The first one moves nothing.

        Args:
            left: how fast each wheel of this side turns, rad/s.
            right: likewise.
            time: when that was, s. Where time does not go on, nothing is driven.
            steering: as above.

        Returns:
            Whether it is believed.
        """
        limit = self._drive.max_wheel_velocity * MARGIN
        if not _usable(left, right, time, steering) or max(map(abs, (*left, *right))) > limit:
            self.left_out += 1
            return False
        elapsed = self._elapsed(time)
        if elapsed <= 0.0:
            return True
        if elapsed > LONGEST:
            self._lose(elapsed)
            self.left_out += 1
            return False
        return self.roll(Wheels(_mean(left) * elapsed, _mean(right) * elapsed, steering), elapsed)

    def roll(self, ways: Wheels, elapsed: float) -> bool:
        """Move on by what the wheels have turned.

        Args:
            ways: rad, and the steering meanwhile.
            elapsed: in this time, s.

        Returns:
            Whether it is believed: not where it is further than any base drives.
        """
        distance, turn = self._drive.twist(ways)
        if abs(distance) <= FURTHEST and abs(turn) <= FURTHEST:
            pose = advance(self.pose, distance, turn, 1.0)
            covariance = self.covariance.after(distance, turn, self.pose.yaw, self.noise)
            if all(map(math.isfinite, (*pose, *covariance))):
                self.pose, self.covariance = pose, covariance
                if elapsed >= SHORTEST:
                    self.twist = Twist2(distance / elapsed, turn / elapsed)
                    self._variances = twist_variances(self.twist, self.noise, elapsed)
                return True
        self.left_out += 1
        return False

    def begin_anew(self) -> None:
        """Take the next positions as the first ones: the encoders count from somewhere else, and what was driven
        meanwhile is not known.
        """
        self._encoders.begin_anew()
        self._begins = True

    def message(self, header: Header, base_frame: str) -> Odometry:
        """What it has found so far.

        Args:
            header: when the last reading was taken, and the frame of the pose.
            base_frame: the frame of the velocities.
        """
        return odometry_message(header, base_frame, self.pose, self.twist, self.covariance, self._variances)

    def _elapsed(self, time: float) -> float:
        before, self._time = self._time, time
        return 0.0 if before is None else time - before

    def _lose(self, elapsed: float) -> None:
        """Nobody knows what was driven: it may have driven on as it did, and a hand may have moved it."""
        unseen = min(max(elapsed, 0.0), LONGEST_UNSEEN)
        self.covariance = self.covariance.after_unknown(
            abs(self.twist.linear) * unseen + PUSHED, abs(self.twist.angular) * unseen + PUSHED
        )


def odometry_message(
    header: Header,
    base_frame: str,
    pose: Pose2,
    twist: Twist2,
    covariance: PoseCovariance,
    variances: tuple[float, float],
) -> Odometry:
    """The message of a base in the plane.

    Args:
        header: when it was there, and the frame of the pose.
        base_frame: the frame of the velocities.
        pose: where it is.
        twist: how it moves, m/s and rad/s.
        covariance: of the pose.
        variances: of the velocities, m²/s² and rad²/s².
    """
    return Odometry(
        header,
        base_frame,
        PoseWithCovariance(Pose(Point(pose.x, pose.y), quaternion_from_yaw(pose.yaw)), covariance.six_by_six()),
        TwistWithCovariance(Twist(Vector3(x=twist.linear), Vector3(z=twist.angular)), twist_covariance(*variances)),
    )


def twist_variances(twist: Twist2, noise: Noise, elapsed: float) -> tuple[float, float]:
    """Of the mean velocities over `elapsed` s: who adds such velocities up is as unsure as the pose says.

    Args:
        twist: m/s and rad/s.
        noise: how the base errs.
        elapsed: s.

    Returns:
        m²/s² and rad²/s².
    """
    way, turn = noise.variances(twist.linear, twist.angular)
    return way / elapsed + LEAST_VARIANCE, turn / elapsed + LEAST_VARIANCE


def _usable(left: Sequence[float], right: Sequence[float], time: float, steering: float) -> bool:
    return bool(left) and bool(right) and all(map(math.isfinite, (*left, *right, time, steering)))


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)  # `statistics` brings along 4 MB
