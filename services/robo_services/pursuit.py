"""Pure pursuit along a way of waypoints, none of which is cut off: without Zenoh and without a clock.

A robot that looks at a point at a distance d, y to its left, comes there on an arc of the curvature

    κ = 2·y / d²                                                                    (Coulter 1992, section 2)

The point lies on the way, a look-ahead further than the robot. Where the way bends, the robot cuts it short by that.
So it never looks past a waypoint that it has not reached, unless its arc passes that one within tolerance.
A speed v is gone within v·T + v²/(2a): it takes T s until a base obeys, and slows down by a m/s² then. What is ahead,
a bend, a waypoint to stand at, is come to with what is left of v there:

    v = -a·T + √(a²T² + w² + 2·a·s)     at a distance s, with a speed w                                   (1)
"""

import math
from typing import NamedTuple

import msgspec

from robo_services.courses import Course, Waypoint
from robo_services.kinematics import Pose2
from robo_services.laps import Lap, lap_of
from robo_services.limits import clamp, ramp
from robo_services.planar import angle_difference

MARGIN = 0.8
"""How much of a waypoint's tolerance is used on purpose: the rest is for a base that does not follow its arc."""
NEAR = 0.01
"""A robot is to stand at a point to so many m, or else where it has passed it within tolerance."""
BEHIND = 2.6
"""What is further to one side, rad, is as near by a turn to the other one."""
ALIGNED = 0.1
"""A turn on the spot towards the way ends at this angle, rad."""
EXACT_YAW = 0.02
"""A turn to a yaw that is asked for ends at this angle, rad, or else where it has passed it within tolerance."""
SLOWEST_TURN = 0.1
"""rad/s; it would never end with less."""
HEADROOM = 0.5
"""How far commands may be ahead of what the base does, s of its acceleration."""
JUMP = 1.0
"""Between two poses that are further from each other, m, nobody has driven."""
HEADWAY = (0.02, 0.05)
"""Getting nearer by this way, m, or turning by this angle, rad, is progress."""


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """How it drives."""

    max_velocity: float
    """m/s."""
    min_velocity: float
    """No approach is slower, m/s: a base would stop before."""
    max_angular_velocity: float
    """rad/s."""
    max_acceleration: float
    """How it gains speed, m/s²."""
    max_deceleration: float
    """How it loses speed, m/s²."""
    max_angular_acceleration: float
    """rad/s²."""
    max_lateral_acceleration: float
    """In curves, m/s²."""
    reaction_time: float
    """Until the base obeys, s."""
    lookahead_time: float
    """It looks as far ahead as it comes in this time, s."""
    min_lookahead: float
    """m."""
    max_lookahead: float
    """m."""
    tolerance: float
    """A waypoint that is passed at no more than this is reached, m."""
    goal_tolerance: float
    """The same where it stands, m."""
    yaw_tolerance: float
    """The same of a yaw that is asked for, rad."""
    turn_angle: float
    """It turns on the spot towards what is further to the side, rad."""


class Motion(NamedTuple):
    """A command."""

    linear: float = 0.0
    """m/s, forward."""
    angular: float = 0.0
    """rad/s."""


STAND = Motion()


def curvature_to(ahead: float, left: float) -> float:
    """The curvature of the arc to a point in the robot's frame, 1/m; 0 to where it stands."""
    square = ahead * ahead + left * left
    return 2.0 * left / square if square > 1e-12 else 0.0


def speed_before(distance: float, end: float, deceleration: float, reaction: float) -> float:
    """(1): the most at a distance from where no more than `end` is allowed; at least `end`.

    Args:
        distance: m or rad; one that is negative is 0.
        end: m/s or rad/s.
        deceleration: m/s² or rad/s².
        reaction: s.
    """
    lost = deceleration * reaction
    return max(end, math.sqrt(lost * lost + end * end + 2 * deceleration * max(0.0, distance)) - lost)


def passes(point: tuple[float, float], target: tuple[float, float], distance: float, *, turning: bool) -> bool:
    """Whether a robot that goes to a target comes within a distance of a point; both in its frame, m.

    Args:
        point: that is to be passed.
        target: where it goes to.
        distance: m.
        turning: whether it turns on the spot and goes straight, instead of on the arc.
    """
    (x, y), (tx, ty) = point, target
    if min(math.hypot(x, y), math.hypot(x - tx, y - ty)) <= distance:
        return True
    curvature = curvature_to(tx, ty)
    if turning or abs(curvature) < 1e-6:
        square = tx * tx + ty * ty
        share = max(0.0, min(1.0, (x * tx + y * ty) / square)) if square else 0.0
        return math.hypot(x - share * tx, y - share * ty) <= distance
    if tx <= 0.0:
        return False  # the arc would lead around behind it
    bend, radius = math.copysign(1.0, curvature), 1.0 / abs(curvature)
    angle, whole = math.atan2(x, radius - bend * y), math.atan2(tx, radius - bend * ty)
    return 0.0 <= angle <= whole and abs(math.hypot(x, radius - bend * y) - radius) <= distance


class Follower:
    """Follows one course, from wherever the robot is; knows how far it has come."""

    def __init__(self, course: Course, motion: Motion = STAND) -> None:
        """`motion` is what was commanded last."""
        self.course = course
        self.lap = 0
        """Its number, from 0."""
        self.motion = motion
        """What was commanded last."""
        self.finished = False
        self.turning = False
        """Whether it turns on the spot."""
        self.missed: list[int] = []
        """Numbers of the waypoints that were given up, in order."""
        self.idle = 0.0
        """For how long it has not got on, s."""
        self.way: Lap | None = None
        """The present lap's; None before the first step."""
        self._next = 0
        self._along = 0.0
        self._arrived = False
        self._last: Pose2 | None = None
        self._best = (math.inf, math.inf)

    @property
    def waypoint(self) -> int:
        """The number in the course of the waypoint that is next; of the last one at the end."""
        if self.way is None:
            return self.course.first
        return self.way.numbers[min(self._next, self.way.size - 1)]

    @property
    def left(self) -> float:
        """The way to the end of this lap, m; NaN before the first step."""
        return math.nan if self.way is None else max(0.0, self.way.route.marks[self.way.size - 1] - self._along)

    def step(self, pose: Pose2, speed: float, limits: Limits, dt: float) -> Motion:
        """What to command now; to stand, once it is finished.

        Args:
            pose: where the robot is, in the course's frame; finite.
            speed: how fast it drives ahead, m/s.
            limits: of the drive.
            dt: since the last step, s.
        """
        lap = self.way = self.way or lap_of(self.course, 0, (pose.x, pose.y), limits.tolerance)
        if not self.finished:
            lap = self._reach(lap, pose, limits)
        if self.finished:
            self.motion = STAND
            return STAND
        ahead, left = self._aim(lap, pose, limits)
        yaw = lap.goals[self._next].yaw if self._arrived else None
        angle = math.atan2(left, ahead) if yaw is None else angle_difference(yaw, pose.yaw)
        if abs(angle) > BEHIND and angle * self.motion.angular < 0.0:
            angle -= math.copysign(math.tau, angle)  # it goes on the way round that it has begun
        self.turning = yaw is not None or abs(angle) > (ALIGNED if self.turning else limits.turn_angle)
        if self._arrived and yaw is None:
            wanted = STAND
        elif self.turning:
            wanted = Motion(0.0, _turn(angle, limits))
        else:
            wanted = self._drive(lap, curvature_to(ahead, left), limits)
        self._watch(lap, pose, angle, dt)
        self.motion = _ramped(self.motion, wanted, speed, limits, dt)
        return self.motion

    def wait(self, dt: float) -> None:
        """Stand for `dt` s, as nobody knows where the robot is."""
        self.motion = STAND
        self.idle += dt

    def give_up(self, tolerance: float) -> None:
        """Leave out the waypoint that is next: it counts as missed.

        Args:
            tolerance: as in `Limits`, m.
        """
        if self.way is not None and not self.finished:
            self.missed.append(self.waypoint)
            self._advance(self.way, tolerance)

    def _reach(self, lap: Lap, pose: Pose2, limits: Limits) -> Lap:
        """Count what has been reached. At most a lap is ended by one step."""
        before = self._last if self._last is not None else pose
        if math.hypot(pose.x - before.x, pose.y - before.y) > JUMP:
            before = pose
        self._last = pose
        for _ in range(self._next, lap.size):
            goal = lap.goals[self._next]
            if lap.route.stands[self._next]:
                if not self._stands(lap, pose, limits):
                    break
            elif _distance(goal, before, pose) > (goal.tolerance or limits.tolerance):
                break
            lap = self._advance(lap, limits.tolerance)
            if self.finished:
                return lap
            if self._next <= 1 and lap.size > 1:
                break  # a lap has just begun
        route = lap.route
        low = route.marks[self._next - 1] if self._next else 0.0
        high = min(route.marks[self._next], self._along + max(limits.max_lookahead, JUMP))
        self._along = route.nearest(pose.x, pose.y, max(low, self._along - JUMP), max(low, high))
        return lap

    def _stands(self, lap: Lap, pose: Pose2, limits: Limits) -> bool:
        """Whether it stands where it is to stand, and as it is to stand there."""
        goal = lap.goals[self._next]
        ahead, left = _seen(pose, goal.x, goal.y)
        distance, tolerance = math.hypot(ahead, left), goal.tolerance or min(limits.tolerance, limits.goal_tolerance)
        passed = distance <= NEAR or abs(math.atan2(left, ahead)) >= limits.turn_angle
        arrived, self._arrived = self._arrived, distance <= tolerance and (passed or self._arrived)
        if self._arrived and not arrived:  # how straight it has come here says nothing of the turn that it ends with
            self._best = self._best[0], math.inf
        if not self._arrived or self.motion.linear > limits.min_velocity:
            return False
        if goal.yaw is None:
            return True
        error = angle_difference(goal.yaw, pose.yaw)
        if abs(self.motion.angular) > 2 * SLOWEST_TURN:
            return False
        return abs(error) <= EXACT_YAW or (abs(error) <= limits.yaw_tolerance and error * self.motion.angular <= 0.0)

    def _advance(self, lap: Lap, tolerance: float) -> Lap:
        """Go on to the next waypoint, and lap."""
        self._along = max(self._along, lap.route.marks[self._next])
        self._next += 1
        self._arrived = False
        self.idle, self._best = 0.0, (math.inf, math.inf)
        if self._next < lap.size:
            return lap
        if self.course.laps and self.lap + 1 >= self.course.laps:
            self.finished = True
            return lap
        self.lap += 1
        self.way = lap_of(self.course, self.lap, (0.0, 0.0), tolerance)
        self._next, self._along = 1, self.way.route.marks[0]
        return self.way

    def _aim(self, lap: Lap, pose: Pose2, limits: Limits) -> tuple[float, float]:
        """The point to look at, in the robot's frame, m."""
        route = lap.route
        here = route.marks[self._next]
        lookahead = max(limits.min_lookahead, min(limits.max_lookahead, self.motion.linear * limits.lookahead_time))
        # An arc to a point that is nearer than the way is to the robot would be sharp.
        furthest = min(self._along + lookahead, route.halts[self._next])
        for share in (1.0, 0.75, 0.5, 0.25):
            along = here + share * (furthest - here)
            if furthest <= here:
                break
            target = _seen(pose, *route.at(along)[:2])
            if self._passes_all(lap, pose, target, along, limits):
                return target
        if furthest < here:
            return _seen(pose, *route.at(furthest)[:2])
        goal = lap.goals[self._next]
        if self._along >= here - NEAR or route.stands[self._next]:
            return _seen(pose, goal.x, goal.y)  # nearest to it, and not there yet
        return _seen(pose, *route.at(here)[:2])

    def _passes_all(self, lap: Lap, pose: Pose2, target: tuple[float, float], along: float, limits: Limits) -> bool:
        """Whether who goes to a target misses none of the waypoints before it."""
        # While it turns, the point must not depend on how far it has come round, or it may turn for ever.
        turning = self.turning or abs(math.atan2(target[1], target[0])) > limits.turn_angle
        for index in range(self._next, len(lap.goals)):
            if lap.route.marks[index] >= along:
                return True
            goal = lap.goals[index]
            distance = MARGIN * (goal.tolerance or limits.tolerance)
            if not passes(_seen(pose, goal.x, goal.y), target, distance, turning=turning):
                return False
        return True

    def _drive(self, lap: Lap, curvature: float, limits: Limits) -> Motion:
        """How to drive on an arc, as fast as may be."""
        goal = lap.goals[self._next]
        most = min(limits.max_velocity, goal.speed or math.inf)
        speed = min(most, _speed_of(curvature, limits), self._speed_ahead(lap, limits))
        speed = max(speed, min(limits.min_velocity, most))
        return Motion(speed, clamp(curvature * speed, limits.max_angular_velocity))

    def _speed_ahead(self, lap: Lap, limits: Limits) -> float:
        """The most here, for what comes on the way, m/s."""
        route, here = lap.route, self._along
        until = min(route.halts[self._next], route.length)
        speed = speed_before(until - here, 0.0, limits.max_deceleration, limits.reaction_time)
        for piece in route.pieces[route.number(here) :]:
            distance = piece.start - here
            if speed_before(distance, 0.0, limits.max_deceleration, limits.reaction_time) >= limits.max_velocity:
                break
            allowed = min(lap.goals[piece.goal].speed or math.inf, _speed_of(piece.curvature, limits))
            if distance <= 0.0:
                speed = min(speed, allowed)
            elif math.isfinite(allowed):
                speed = min(speed, speed_before(distance, allowed, limits.max_deceleration, limits.reaction_time))
        return speed

    def _watch(self, lap: Lap, pose: Pose2, angle: float, dt: float) -> None:
        """See whether it gets on."""
        goal = lap.goals[self._next]
        distance = math.hypot(goal.x - pose.x, goal.y - pose.y) + lap.route.marks[self._next] - self._along
        nearest, straightest = self._best
        if distance < nearest - HEADWAY[0] or (self.turning and abs(angle) < straightest - HEADWAY[1]):
            self.idle = 0.0
            self._best = min(nearest, distance), min(straightest, abs(angle))
        else:
            self.idle += dt


def _seen(pose: Pose2, x: float, y: float) -> tuple[float, float]:
    """A point in the robot's frame: ahead and to the left, m."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    dx, dy = x - pose.x, y - pose.y
    return cos * dx + sin * dy, cos * dy - sin * dx


def _distance(goal: Waypoint, a: Pose2, b: Pose2) -> float:
    """How near the robot came to a waypoint on its way from `a` to `b`, m."""
    dx, dy = b.x - a.x, b.y - a.y
    square = dx * dx + dy * dy
    share = max(0.0, min(1.0, ((goal.x - a.x) * dx + (goal.y - a.y) * dy) / square)) if square else 0.0
    return math.hypot(goal.x - a.x - share * dx, goal.y - a.y - share * dy)


def _speed_of(curvature: float, limits: Limits) -> float:
    """The most on an arc, m/s."""
    bend = abs(curvature)
    if bend < 1e-9:
        return math.inf
    return min(limits.max_angular_velocity / bend, math.sqrt(limits.max_lateral_acceleration / bend))


def _turn(angle: float, limits: Limits) -> float:
    """The yaw rate of a turn on the spot by what is left of its angle, rad/s."""
    speed = speed_before(abs(angle), 0.0, limits.max_angular_acceleration, limits.reaction_time)
    slowest = min(SLOWEST_TURN, limits.max_angular_velocity)
    return math.copysign(max(slowest, min(limits.max_angular_velocity, speed)), angle)


def _ramped(motion: Motion, wanted: Motion, speed: float, limits: Limits, dt: float) -> Motion:
    """The next command on the way to what is wanted.

    A base that was held up gains its speed anew: what is commanded is never far ahead of what it does.
    """
    begin = min(motion.linear, max(0.0, speed) + limits.max_acceleration * HEADROOM)
    acceleration = limits.max_angular_acceleration
    return Motion(
        ramp(begin, wanted.linear, dt, limits.max_acceleration, limits.max_deceleration),
        ramp(motion.angular, wanted.angular, dt, acceleration, acceleration),
    )
