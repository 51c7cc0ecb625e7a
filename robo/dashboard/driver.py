"""Driving from pages: one driver for each robot, commands on a topic of their own, and zeros when nobody commands.

The robot's own chain, its mux, smoother and safety monitor, has the last word: this topic is one of the mux's inputs.

Who drives has a grip: it begins when a hand takes hold, and an emergency stop ends all of them. Grips are numbered by
how many were ended before: one of a lower number than the last end of a robot moves it no more.
"""

import logging
import os
import re
import threading
from contextlib import suppress
from typing import NamedTuple

import msgspec
import zenoh

from robo.dashboard import clock
from robo.dashboard.delivery import is_robot
from robo.dashboard.ears import Ears
from robo.dashboard.lease import MOST_AGE, Lease
from robo.dashboard.requests import STOP
from robo.errors import RoboError
from robo.samples.publishing import Sender
from robo.text.unreadable import UNREADABLE
from robo.wire import names
from robo.wire.keys import source_id
from robo.wire.qos import QoS
from robo_messages import Bool, Twist, Vector3, decode, encode

TOPIC = "cmd_vel_dashboard"
_PERIOD = 0.05
"""How often it is looked whether a robot is to be told to stand, s."""
_MOST_ROBOTS = 100
"""That are remembered: pages may make up names."""
_CLOSING = 2.0
"""How long the last zeros may take where the network is held up, s."""
_OTHERS = 0.5
"""Another dashboard that has said nothing for so long drives no more, s; the mux lets the next one in after that."""
_ACQUAINTANCE = 1.0
"""So long after its first command it may take until it is known whether a robot listens, s."""
_SLOTS = 256
"""Commands on the network that wait for a look."""
NEW_GRIP = "it takes a new grip"
_logger = logging.getLogger("robo.dashboard")


class _Wanted(NamedTuple):
    """A command that is to be sent."""

    linear: float
    """m/s."""
    angular: float
    """rad/s."""
    since: float
    """When it came, s by the clock that never goes back."""


class _Robot(msgspec.Struct):
    lease: Lease
    ended: int
    """Grips of a lower number count no more."""
    wanted: _Wanted | None = None
    known: float | None = None
    """Since when it is known, s; None before its first command is sent."""
    is_deaf: bool = False
    """Whether nobody listens to it."""


class _Other(msgspec.Struct):
    """Somebody else on the network who drives a robot."""

    source: str
    until: float
    name: str = "another dashboard"


class Drivers(msgspec.Struct, frozen=True):
    """Who drives, for pages."""

    drivers: dict[str, str]
    """By robot."""
    grip: int
    """The number of a grip that begins now."""
    ended: dict[str, int]
    """By robot: grips of a lower number count no more."""


class Driver:
    """Sends what pages command, by a thread of its own: a network that is held up holds up no page."""

    def __init__(self, session: zenoh.Session, topic: str = TOPIC) -> None:
        self._session = session
        self._topic = topic
        self._node = "dashboard_" + re.sub(r"\W", "_", os.uname().nodename, flags=re.ASCII)[:50]
        self._robots: dict[str, _Robot] = {}
        self._others: dict[str, _Other] = {}
        self._grip = self._forgotten = 0
        """The number of a new grip; and the highest that counts no more of a robot that is not remembered."""
        # Only the thread has these, until it has ended.
        self._senders: dict[str, Sender] = {}
        self._ears: dict[str, Ears] = {}
        self._own: set[str] = set()
        """Ids of senders: their commands come back."""
        self._changed = threading.Condition()
        self._over = False
        self._heard = session.declare_subscriber(names.join("**", topic), zenoh.handlers.RingChannel(_SLOTS))
        # Whoever presses it, wherever: another dashboard, a viewer, a terminal. Those of own pages come back.
        pressed = zenoh.handlers.Callback(self._stopped, indirect=False)
        self._pressed = session.declare_subscriber(names.join("**", STOP), pressed)
        self._thread = threading.Thread(target=self._run, name="robo-dashboard-driver", daemon=True)
        self._thread.start()

    def command(self, robot: str, who: str, linear: float, angular: float, grip: int) -> str:
        """Have a robot move; m/s forwards, rad/s to the left. Returns why that is not done, empty where it is.

        Args:
            robot: its namespace.
            who: the page.
            linear: m/s.
            angular: rad/s.
            grip: the number that the page was told last when this grip began.
        """
        with self._changed:
            found, now = self._robot(robot), clock.steady()
            if self._over or not self._thread.is_alive():
                return "this dashboard drives no more: it has to be started again"
            if found is None:
                return "so many robots are driven at once that there is no room"
            if found.lease.expire(now):
                self._end_grips(found)
            if (other := self._other(robot, who, now)) is not None:
                return f"{other} drives {robot}"
            if grip < found.ended:
                return self._deaf(robot) if found.is_deaf else NEW_GRIP
            if not found.lease.command(who, now):
                return f"somebody else drives {robot}"
            found.wanted, found.is_deaf = _Wanted(linear, angular, now), False
            self._changed.notify()
            return ""

    def hold(self, robot: str, who: str) -> None:
        """Who drives a robot has said something that came too late to be done: it is slow, and not gone."""
        with self._changed:
            found, now = self._robots.get(robot), clock.steady()
            if found is not None and found.lease.driver == who and not found.lease.is_over(now):
                found.lease.take(who, now)

    def other(self, robot: str, who: str) -> str | None:
        """Who else drives a robot; None where nobody does."""
        with self._changed:
            return self._other(robot, who, clock.steady())

    def leave(self, who: str) -> None:
        """Somebody drives no more: has let go, or is gone."""
        with self._changed:
            for found in self._robots.values():
                if found.lease.driver == who:
                    found.wanted = None
                    found.lease.give(who)
            self._changed.notify()

    def end(self, robot: str) -> None:
        """Nobody's grip on a robot counts any more, and it is told to stand: of an emergency stop, and its reset."""
        with self._changed:
            if not is_robot(robot):
                return  # nobody drives it
            if (found := self._robot(robot)) is not None:
                self._end_grips(found)
            else:
                self._grip += 1
                self._forgotten = self._grip
            self._changed.notify()

    def drivers(self) -> Drivers:
        """Who drives which robot, here or by another dashboard of the network."""
        with self._changed:
            now = clock.steady()
            others = {robot: other.name for robot, other in self._others.items() if now < other.until}
            own = {robot: found.lease.driver for robot, found in self._robots.items() if found.lease.driver}
            ended = {robot: found.ended for robot, found in self._robots.items() if found.ended}
            return Drivers({**others, **own}, self._grip, ended)

    def close(self) -> None:
        """Have all robots stand that were told to move, and say no more."""
        with self._changed:
            if self._over:
                return
            for found in self._robots.values():
                found.wanted = None
                found.lease.end()
            self._over = True
            self._changed.notify()
        self._thread.join(_CLOSING)
        if self._thread.is_alive():
            return  # the network takes nothing; the mux has stopped the robot
        with suppress(zenoh.ZError):
            self._heard.undeclare()
            self._pressed.undeclare()
        for robot in [*self._ears, *self._senders]:
            self._forget(robot)

    def _robot(self, robot: str) -> _Robot | None:
        """A robot by name; None where there are too many that are driven."""
        if robot not in self._robots and len(self._robots) >= _MOST_ROBOTS:
            idle = next((name for name, found in self._robots.items() if found.lease.is_idle), None)
            if idle is None:
                return None
            self._forgotten = max(self._forgotten, self._robots.pop(idle).ended)
        return self._robots.setdefault(robot, _Robot(Lease(), self._forgotten))

    def _other(self, robot: str, who: str, now: float) -> str | None:
        own = self._robots.get(robot)
        if own is not None and own.lease.driver not in (None, who):
            return own.lease.driver
        other = self._others.get(robot)
        return other.name if other is not None and now < other.until else None

    def _end_grips(self, found: _Robot) -> None:
        self._grip += 1
        found.ended, found.wanted = self._grip, None
        found.lease.end()

    def _deaf(self, robot: str) -> str:
        key = names.join(robot, self._topic)
        return f"nobody listens to {key}: the robot is gone, or its mux has no such input (docs/dashboard.md)"

    def _run(self) -> None:
        over = False
        while not over:
            with self._changed:
                self._changed.wait_for(self._has_work, _PERIOD)
                due = [(robot, said) for robot, found in self._robots.items() for said in self._due(found)]
                gone = [robot for robot in {*self._senders, *self._ears} if not self._is_known(robot)]
                over = self._over and all(found.lease.is_idle for found in self._robots.values())
            for robot, (linear, angular) in due:
                self._guarded(robot, linear, angular)
            for robot in gone:
                self._forget(robot)
            self._listen()

    def _has_work(self) -> bool:
        now = clock.steady()
        return any(found.wanted is not None or found.lease.is_due(now) for found in self._robots.values())

    def _is_known(self, robot: str) -> bool:
        return robot in self._robots or robot in self._others

    def _due(self, robot: _Robot) -> list[tuple[float, float]]:
        """What is to be sent to a robot now."""
        now = clock.steady()
        if robot.lease.expire(now):
            self._end_grips(robot)
        wanted, robot.wanted = robot.wanted, None
        if wanted is not None and now - wanted.since <= MOST_AGE:  # else the network has held up the one before
            return [(wanted.linear, wanted.angular)]
        return [(0.0, 0.0)] if robot.lease.is_to_stand(now) else []

    def _guarded(self, robot: str, linear: float, angular: float) -> None:
        """Send a command; whatever becomes of that, other robots are driven on."""
        try:
            self._sender(robot).send(encode(Twist(Vector3(x=linear), Vector3(z=angular))))
        except (zenoh.ZError, RoboError):
            pass  # the network has been left, and the mux stops the robot
        except BaseException:  # a panic of Zenoh's is no Exception; its sender is of no use any more
            _logger.exception("%s cannot be driven", robot)
            self._senders.pop(robot, None)

    def _sender(self, robot: str) -> Sender:
        sender = self._senders.get(robot)
        if sender is None:
            key, node = names.join(robot, self._topic), "/" + names.join(robot, self._node)
            sender = self._senders[robot] = Sender(self._session, key, "geometry/Twist", QoS.COMMAND, node)
            self._own.add(sender.id)
        return sender

    def _stopped(self, sample: zenoh.Sample) -> None:
        """An emergency stop is said on its topic: it ends grips here, too. On Zenoh's own thread."""
        with suppress(*UNREADABLE):
            if decode(sample.payload.to_bytes(), Bool).data:
                self.end(str(sample.key_expr).removesuffix(STOP).strip("/"))

    def _listen(self) -> None:
        """Take note of who else drives, and of robots that hear nothing."""
        spoken: dict[str, str] = {}
        with suppress(zenoh.ZError):
            while (sample := self._heard.handler.try_recv()) is not None:
                source = source_id(sample.source_info.source_id) if sample.source_info is not None else ""
                robot = str(sample.key_expr).removesuffix(self._topic).strip("/")
                if source not in self._own and is_robot(robot):
                    spoken[robot] = source
        with self._changed:
            self._note_others(spoken)
            driven = {robot for robot, found in self._robots.items() if found.lease.driver is not None}
            heard = {*driven, *self._others}
        with suppress(zenoh.ZError):
            for robot in heard - self._ears.keys():
                self._ears[robot] = Ears(self._session, names.join(robot, self._topic))
        with self._changed:
            now = clock.steady()
            for robot, other in self._others.items():
                if name := self._ears[robot].name(other.source) if robot in self._ears else "":
                    other.name = f"another dashboard, {name},"
                if (mine := self._robots.get(robot)) is not None and mine.lease.driver is not None:
                    self._end_grips(mine)  # both began at once: then neither drives
            for robot in driven & self._robots.keys() & self._ears.keys():
                self._hear(self._robots[robot], self._ears[robot], now)

    def _note_others(self, spoken: dict[str, str]) -> None:
        """Remember who else has just driven which robot, and forget who drives no more."""
        now = clock.steady()
        for robot, source in spoken.items():
            if len(self._others) < _MOST_ROBOTS or robot in self._others:
                known = self._others.get(robot)
                if known is None or known.source != source:
                    known = self._others[robot] = _Other(source, now)
                known.until = now + _OTHERS
        for robot in [robot for robot, other in self._others.items() if other.until <= now]:
            del self._others[robot]

    def _hear(self, robot: _Robot, ears: Ears, now: float) -> None:
        """Whether a robot that is driven listens: where nobody does a hand has to take hold anew."""
        if robot.known is None:
            robot.known = now
        if robot.lease.driver is not None and now - robot.known > _ACQUAINTANCE and not ears.somebody_listens:
            self._end_grips(robot)
            robot.is_deaf = True

    def _forget(self, robot: str) -> None:
        for ends in (self._senders, self._ears):
            end: Sender | Ears | None = ends.pop(robot, None)
            if end is not None:
                with suppress(zenoh.ZError):
                    end.close()
